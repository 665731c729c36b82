# SPDX-License-Identifier: Apache-2.0
"""Stages that are joined in spite of what they hold, and what of them is named."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSemantics, UsdShade

from tests.usd.joining.rooms import OPENING, edit, two_rooms, view, write_room
from tiscene.errors import StageError, StageWarning
from tiscene.usd import join
from tiscene.usd.read.stage_reader import read_stage


@pytest.mark.parametrize(
    "change",
    [
        lambda stage: stage.GetDefaultPrim().SetInstanceable(True),
        lambda stage: UsdGeom.Xformable(stage.GetDefaultPrim()).SetResetXformStack(True),
        lambda stage: UsdGeom.Mesh(stage.GetPrimAtPath("/Room/Door/Shape")).GetExtentAttr().Set([(0, 0, 0), (1, 1, 1)]),
    ],
    ids=["instanceable", "reset transforms", "wrong extent"],
)
def test_rooms_that_say_otherwise_are_placed_and_cut(tmp_path: Path, change: Callable[[Usd.Stage], object]) -> None:
    rooms = two_rooms(tmp_path)
    edit(Path(rooms[0].file), change)
    frame = view(join(rooms, tmp_path / "flat.usda", openings=[OPENING]))
    assert frame.depth[12, 16] == pytest.approx(6.4, abs=1e-4)
    assert {row.room for row in frame.objects} == {"west", "east"}


def test_names_of_what_is_added_are_new(tmp_path: Path) -> None:
    rooms = two_rooms(tmp_path)
    edit(Path(rooms[0].file), lambda stage: UsdGeom.Cube.Define(stage, "/Room/RoomVolume"))
    path = join([rooms[0]._replace(name="Openings"), rooms[1]], tmp_path / "flat.usda", openings=[OPENING])
    stage = Usd.Stage.Open(str(path))
    assert [prim.GetName() for prim in stage.GetDefaultPrim().GetChildren()] == ["Openings", "east", "Openings_2"]
    assert UsdGeom.Cube(stage.GetPrimAtPath("/Flat/east/RoomVolume")).GetPurposeAttr().Get() == "default"
    assert [each.name for each in read_stage(path).rooms] == ["Openings", "east"]


def test_volume_of_a_room_that_its_root_turns_over_is_up_to_its_ceiling(tmp_path: Path) -> None:
    def turn_over(stage: Usd.Stage) -> None:
        UsdGeom.Xformable(stage.GetDefaultPrim()).AddRotateXOp().Set(180.0)
        for prim, label in (("Floor", "ceiling"), ("Ceiling", "floor")):
            UsdSemantics.LabelsAPI(stage.GetPrimAtPath(f"/Room/{prim}"), "class").GetLabelsAttr().Set([label])

    room = write_room(tmp_path, "one")
    edit(room, turn_over)
    (volume,) = read_stage(join([(room, (0, 5, 0))], tmp_path / "flat.usda")).rooms
    corners = np.array([volume.world_from_box @ (*[side] * 3, 1.0) for side in (-1.0, 1.0)])[:, :3]
    np.testing.assert_allclose(np.sort(corners, axis=0), [(-2.2, 2, -2.2), (2.2, 5, 2.2)], atol=1e-5)


def test_names_of_rooms_are_kept_in_any_script(tmp_path: Path) -> None:
    rooms = [
        (write_room(tmp_path, name), (5.0 * k, 0, 0)) for k, name in enumerate(("büro", "bäro", "台所", "up-stairs"))
    ]
    stage = Usd.Stage.Open(str(join(rooms, tmp_path / "münchen.usda")))
    assert stage.GetDefaultPrim().GetName() == "München"
    assert [prim.GetName() for prim in stage.GetDefaultPrim().GetChildren()] == ["büro", "bäro", "台所", "up_stairs"]


def test_prims_outside_of_the_default_prim_are_named(tmp_path: Path) -> None:
    room = write_room(tmp_path, "one")
    edit(room, lambda stage: (UsdShade.Material.Define(stage, "/Looks/Red"), UsdGeom.Scope.Define(stage, "/Notes")))
    with pytest.warns(
        StageWarning, match=r"one\.usda: </Looks> outside of the default prim </Room>: not in .*flat\.usda"
    ):
        join([(room, (0, 0, 0))], tmp_path / "flat.usda")


def test_room_may_be_one_shape(tmp_path: Path) -> None:
    stage = Usd.Stage.CreateNew(str(tmp_path / "block.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetDefaultPrim(UsdGeom.Cube.Define(stage, "/Block").GetPrim())
    stage.Save()
    path = join([(tmp_path / "block.usda", (3.0, 0.0, 0.0))], tmp_path / "flat.usda")
    assert len(read_stage(path).instances) == 1


def test_variant_set_without_variants_is_left_out(tmp_path: Path) -> None:
    room = write_room(tmp_path, "one")
    edit(room, lambda stage: stage.GetDefaultPrim().GetVariantSets().AddVariantSet("mood"))
    stage = Usd.Stage.Open(str(join([(room, (0, 0, 0))], tmp_path / "flat.usda")))
    assert "mood" not in stage.GetDefaultPrim().GetVariantSets().GetNames()


@pytest.mark.parametrize("chosen", ["", "wild"])
def test_variant_set_is_selected_as_in_the_first_room_that_selects_one(tmp_path: Path, chosen: str) -> None:
    def add_moods(stage: Usd.Stage, selection: str) -> None:
        moods = stage.GetDefaultPrim().GetVariantSets().AddVariantSet("mood")
        for name in ("calm", "wild"):
            moods.AddVariant(name)
        moods.SetVariantSelection(selection)

    rooms = two_rooms(tmp_path)
    for room, selection in zip(rooms, ("", chosen), strict=True):
        edit(Path(room.file), partial(add_moods, selection=selection))
    stage = Usd.Stage.Open(str(join(rooms, tmp_path / "flat.usda")))
    moods = stage.GetDefaultPrim().GetVariantSet("mood")
    assert (moods.GetVariantNames(), moods.GetVariantSelection()) == (["calm", "wild"], chosen)


def set_time_codes(stage: Usd.Stage, rate: float, start: float, end: float) -> None:
    stage.SetTimeCodesPerSecond(rate)
    stage.SetStartTimeCode(start)
    stage.SetEndTimeCode(end)


def test_time_codes_span_those_of_all_rooms(tmp_path: Path) -> None:
    files = [write_room(tmp_path, name) for name in ("a", "b", "c")]
    for file, values in ((files[1], (30, 30, 60)), (files[2], (24, 12, 36))):
        edit(file, partial(set_time_codes, rate=values[0], start=values[1], end=values[2]))
    joined = Usd.Stage.Open(
        str(join([(file, (5.0 * k, 0, 0)) for k, file in enumerate(files)], tmp_path / "flat.usda"))
    )
    assert (joined.GetTimeCodesPerSecond(), joined.GetStartTimeCode(), joined.GetEndTimeCode()) == (30, 15, 60)


def test_holes_and_values_of_every_type_are_kept_by_a_cut(tmp_path: Path) -> None:
    room = write_room(tmp_path, "one")
    kinds = [
        "Double",
        "Half",
        "Half3",
        "Quatf",
        "Matrix4d",
        "Bool",
        "UChar",
        "Int64",
        "Int2",
        "Token",
        "String",
        "Asset",
    ]

    def change(stage: Usd.Stage) -> None:
        mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/Room/WallRight/Shape"))
        primvars = UsdGeom.PrimvarsAPI(mesh)
        for kind in kinds:
            of_type = getattr(Sdf.ValueTypeNames, f"{kind}Array")
            primvars.CreatePrimvar(kind, of_type, "uniform").Set(of_type.type.pythonClass(6))
        weights = primvars.CreatePrimvar("weights", Sdf.ValueTypeNames.FloatArray, "vertex", 2)
        weights.Set([0.25, 0.75] * 8)
        mesh.CreateHoleIndicesAttr([2])

    edit(room, change)
    stage = Usd.Stage.Open(str(join([(room, (0, 0, 0))], tmp_path / "flat.usda", openings=[OPENING])))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/Flat/one/WallRight/Shape"))
    points, faces = np.array(mesh.GetPointsAttr().Get()), len(mesh.GetFaceVertexCountsAttr().Get())
    primvars = UsdGeom.PrimvarsAPI(mesh)
    assert {kind: len(primvars.GetPrimvar(kind).Get()) for kind in kinds} == dict.fromkeys(kinds, faces)
    np.testing.assert_allclose(np.array(primvars.GetPrimvar("weights").Get()), [0.25, 0.75] * len(points), rtol=1e-6)
    corners = points[np.array(mesh.GetFaceVertexIndicesAttr().Get())]
    polygons = np.split(corners, np.cumsum(mesh.GetFaceVertexCountsAttr().Get())[:-1])
    assert (
        min(np.cross(each[1] - each[0], each[2] - each[0])[1] for each in polygons) > -1e-6
    )  # face 2 is the lower one


def test_instances_in_an_opening_are_refused_and_others_left_as_they_are(tmp_path: Path) -> None:
    room = write_room(tmp_path, "one")

    def change(stage: Usd.Stage) -> None:
        instancer = UsdGeom.PointInstancer.Define(stage, "/Room/Books")
        book = UsdGeom.Cube.Define(stage, "/Room/Books/Prototypes/Book")
        book.CreateSizeAttr(0.2)
        book.AddTranslateOp().Set(Gf.Vec3d(2.1, 1.0, 0.0))
        instancer.CreatePrototypesRel().AddTarget(book.GetPath())
        instancer.CreateProtoIndicesAttr([0, 0])
        instancer.CreatePositionsAttr([(0, 0, 1.5), (0, 0, 0)])

    edit(room, change)
    with pytest.raises(StageError, match=r"</Flat/one/Books> opening: instances 1 cannot be cut; .* invisibleIds"):
        join([(room, (0, 0, 0))], tmp_path / "flat.usda", openings=[OPENING])
    edit(room, lambda stage: UsdGeom.PointInstancer(stage.GetPrimAtPath("/Room/Books")).CreateInvisibleIdsAttr([1]))
    stage = Usd.Stage.Open(str(join([(room, (0, 0, 0))], tmp_path / "flat.usda", openings=[OPENING])))
    assert stage.GetPrimAtPath("/Flat/one/Books/Prototypes/Book").IsA(UsdGeom.Cube)


def test_guides_and_hidden_surfaces_need_not_be_cut(tmp_path: Path) -> None:
    rooms = two_rooms(tmp_path)

    def change(stage: Usd.Stage) -> None:
        door = UsdGeom.Mesh(stage.GetPrimAtPath("/Room/Door/Shape"))
        door.CreatePurposeAttr("guide")
        door.GetSubdivisionSchemeAttr().Clear()

    edit(Path(rooms[0].file), change)
    assert join(rooms, tmp_path / "flat.usda", openings=[OPENING]).is_file()
