# SPDX-License-Identifier: Apache-2.0
"""Rooms joined to one stage: openings, volumes, variants, sky, cameras, and what is refused."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux

import tiscene as ts
from tests.usd.joining.rooms import OPENING, edit, two_rooms, view, write_room
from tiscene.errors import ArgumentError, ExportError, MissingFile, SceneNotFound, StageError, StageWarning
from tiscene.usd import Opening, RoomPlacement, join
from tiscene.usd.read.stage_reader import read_stage


@pytest.fixture(scope="module")
def joined(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("joined")
    return join(two_rooms(folder), folder / "flat.usda", openings=[OPENING])


@pytest.fixture(scope="module")
def walk(joined: Path) -> ts.Stream:
    """Return a stream of a camera that goes from the west room to the east room in 20 frames."""
    camera = ts.Camera((0.0, 1.2, 0.0), (0.7071068, 0.0, -0.7071068, 0.0))
    poses = [ts.Waypoint((x, 1.2, 0.0), (0.0, -90.0, 0.0)) for x in (0.0, 4.0)]
    dynamic = ts.LinearWaypoints(poses, total_time=4.0)
    still = ts.Object("box", "Cube", (5.6, 0.25, 0.9))
    moving = ts.Object("ball", "Sphere", (0.0, 1.0, 0.0), dynamic=ts.LinearWaypoints(poses, total_time=4.0))
    scenario = ts.Scenario(str(joined), [still, moving], camera=replace(camera, dynamic=dynamic))
    return ts.Stream(scenario, width=32, height=24, fps=10, buffers=("instance", "semantic", "depth"))


def test_broken_prim_of_another_variant_does_not_stop_the_cut(tmp_path: Path) -> None:
    rooms = two_rooms(tmp_path)

    def break_night(stage: Usd.Stage) -> None:
        sets = stage.GetDefaultPrim().GetVariantSet("lighting")
        sets.SetVariantSelection("night")
        with sets.GetVariantEditContext():
            prim = UsdGeom.Cube.Define(stage, "/Room/Bad").GetPrim()
            prim.CreateAttribute("xformOp:foo", Sdf.ValueTypeNames.Double3).Set(Gf.Vec3d(1, 0, 0))
            UsdGeom.Xformable(prim).CreateXformOpOrderAttr(["xformOp:foo"])
        sets.SetVariantSelection("day")

    edit(Path(rooms[0].file), break_night)
    assert join(rooms, tmp_path / "flat.usda", openings=[OPENING]).is_file()


def test_progress_is_reported(tmp_path: Path) -> None:
    reports: list[tuple[str, float]] = []
    join(
        two_rooms(tmp_path), tmp_path / "home.usda", openings=[OPENING], progress=lambda *report: reports.append(report)
    )
    converting, cutting = [("converting west", 0.0), ("converting east", 0.5)], "cutting openings"
    cuts = [(cutting, 0.0), (cutting, 1 / 3), (cutting, 2 / 3)]  # with the two variants of the rooms
    assert reports == [*converting, *cuts, ("joining", 1.0)]


@pytest.mark.parametrize("shape", ["Mesh", "Cube"])
def test_opening_lets_the_camera_see_the_other_room(tmp_path: Path, shape: str) -> None:
    rooms = two_rooms(tmp_path, shape=shape)
    closed, opened = join(rooms, tmp_path / "closed.usda"), join(rooms, tmp_path / "open.usda", openings=[OPENING])
    middle = (12, 16)
    assert view(closed).depth[middle] == pytest.approx(1.97, abs=1e-4)  # the door's leaf
    frame = view(opened)
    assert frame.depth[middle] == pytest.approx(6.4, abs=1e-4)  # the far wall of the other room
    assert frame.objects.by_id(int(frame.instance[middle])).room == "east"
    assert "door" not in {frame.categories[k] for k in np.unique(frame.semantic)}


def test_walls_beside_and_above_the_opening_are_left_as_they_are(tmp_path: Path) -> None:
    rooms = two_rooms(tmp_path)
    paths = join(rooms, tmp_path / "closed.usda"), join(rooms, tmp_path / "open.usda", openings=[OPENING])
    camera = ts.Camera((0.0, 1.2, 0.0), (0.7071068, 0.0, -0.7071068, 0.0), vertical_fov=1.6)
    scenarios = [ts.Scenario(str(path), camera=camera) for path in paths]
    before, after = (ts.Stream(each, width=32, height=24, buffers=("position", "semantic"))[0] for each in scenarios)
    x, y, z = np.moveaxis(before.position, -1, 0)
    outside = (np.abs(z) > 0.46) | (y > 2.06) | (y < 0.0) | (x < 1.9)
    assert 0.5 < outside.mean() < 1.0
    np.testing.assert_allclose(after.position[outside], before.position[outside], atol=1e-5)
    np.testing.assert_array_equal(after.semantic[outside], before.semantic[outside])
    assert (after.position[~outside, 0] > x[~outside] + 0.02).all()


def test_jambs_cover_the_inside_of_the_wall(joined: Path) -> None:
    """From the middle of the passage, rays across and up meet the lining, not the hollow of the walls."""
    frames = [ts.LinearWaypoints([ts.Waypoint((2.2, 1.2, 0.0), turn)] * 2) for turn in ((0.0, 0.0, 0.0), (90.0, 0, 0))]
    for dynamic, distance in zip(frames, (0.45, 2.05 - 1.2), strict=True):
        scenario = ts.Scenario(str(joined), camera=ts.Camera((2.2, 1.2, 0.0), dynamic=dynamic))
        frame = ts.Stream(scenario, width=32, height=24, buffers=("semantic", "instance", "depth"))[0]
        assert frame.depth[12, 16] == pytest.approx(distance, abs=1e-3)
        assert frame.categories[int(frame.semantic[12, 16])] == "door frame"


def test_camera_and_objects_know_their_rooms(walk: ts.Stream) -> None:
    rooms = [walk[k].room for k in (0, 10, 12, 20)]
    assert rooms == ["west", "west", "east", "east"]
    for k in (0, 20):
        objects = walk[k].objects
        assert objects.by_name("box").room == "east"
        assert objects.by_name("ball").room == rooms[0 if k == 0 else -1]
        assert {row.room for row in objects if row.prim_path} == {"west", "east"}
    assert set(walk[0].objects.arrays()["room"]) == {"west", "east"}


def test_changes_of_rooms_are_events_once(walk: ts.Stream) -> None:
    happened = [(k, e.kind, e.object, e.room) for k in range(21) for e in walk[k].events if e.kind.endswith("_room")]
    ball = walk[0].objects.by_name("ball").id
    (k,) = {k for k, *_ in happened}
    assert happened == [
        (k, kind, id, room) for id in (0, ball) for kind, room in (("leave_room", "west"), ("enter_room", "east"))
    ]
    assert walk[k - 1].room == "west"
    assert walk[k].room == "east"


def test_rooms_have_volumes_over_their_floors(joined: Path) -> None:
    west, east = read_stage(joined).rooms
    assert (west.name, east.name) == ("west", "east")
    expected = np.array([[2.0, 0.0, 0.0, 0.0], [0.0, 1.5, 0.0, 1.5], [0.0, 0.0, 2.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    np.testing.assert_allclose(west.world_from_box, expected)
    np.testing.assert_allclose(east.distances(np.array([[4.4, 1.0, 0.0], [7.4, 1.0, 0.0]])), [0.0, 1.0])


def test_authored_volumes_are_kept(tmp_path: Path) -> None:
    file = write_room(tmp_path, "room")
    text = file.read_text()
    volume = (
        'def Cube "Alcove" (\n prepend apiSchemas = ["SemanticsLabelsAPI:room"]\n)\n{\n'
        ' uniform token purpose = "guide"\n token[] semantics:labels:room = ["alcove"]\n}\n'
    )
    file.write_text(text.replace('def Xform "Floor"', volume + 'def Xform "Floor"', 1))
    path = join([(file, (0.0, 0.0, 0.0))], tmp_path / "one.usda")
    assert [each.name for each in read_stage(path).rooms] == ["alcove"]
    assert "alcove" not in {each.category for each in read_stage(path).objects}


def test_one_sky_lights_all_rooms_through_all_portals(joined: Path) -> None:
    stage = Usd.Stage.Open(str(joined))
    domes = [prim for prim in stage.Traverse() if prim.IsA(UsdLux.DomeLight)]
    assert [str(prim.GetPath()) for prim in domes] == ["/Flat/west/Sky"]
    targets = UsdLux.DomeLight(domes[0]).GetPortalsRel().GetForwardedTargets()
    assert [str(path) for path in targets] == ["/Flat/west/Portal", "/Flat/east/Portal"]


def test_sky_of_a_chosen_room_is_kept(tmp_path: Path) -> None:
    stage = Usd.Stage.Open(str(join(two_rooms(tmp_path), tmp_path / "flat.usda", sky="east")))
    assert [str(p.GetPath()) for p in stage.Traverse() if p.IsA(UsdLux.DomeLight)] == ["/Flat/east/Sky"]


def test_variants_of_the_root_select_those_of_all_rooms(joined: Path) -> None:
    stage = Usd.Stage.Open(str(joined))
    root = stage.GetDefaultPrim()
    assert root.GetVariantSet("lighting").GetVariantNames() == ["day", "night"]
    for variant, intensity in (("night", 0.1), ("day", 1.0)):
        root.GetVariantSet("lighting").SetVariantSelection(variant)
        assert stage.GetPrimAtPath("/Flat/east").GetVariantSet("lighting").GetVariantSelection() == variant
        sky = UsdLux.DomeLight(stage.GetPrimAtPath("/Flat/west/Sky"))
        assert sky.GetIntensityAttr().Get() == pytest.approx(intensity)


def test_cameras_of_one_name_are_told_apart_by_their_rooms(joined: Path) -> None:
    cameras = read_stage(joined).cameras
    assert [each.name for each in cameras] == ["Main", "east/Main"]
    np.testing.assert_allclose(cameras[1].position, (4.4, 1.2, 0.0), atol=1e-6)


def test_same_rooms_write_same_bytes_with_relative_references(tmp_path: Path) -> None:
    rooms = two_rooms(tmp_path)
    first = join(rooms, tmp_path / "a" / "flat.usda", openings=[OPENING]).read_bytes()
    assert join(rooms, tmp_path / "b" / "flat.usda", openings=[OPENING]).read_bytes() == first
    assert b"@../room.usda@" in first
    assert str(tmp_path).encode() not in first


def test_rooms_in_centimeters_are_joined_in_meters(tmp_path: Path) -> None:
    path = join(two_rooms(tmp_path, meters=0.01), tmp_path / "flat.usdc", openings=[OPENING])
    frame = view(path)
    assert frame.depth[12, 16] == pytest.approx(6.4, abs=1e-4)
    assert frame.room == "west"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"rooms": []}, "at least one room"),
        ({"rooms": ["a.usda"]}, r"room 0 is 'a.usda'; expected \(file, position\)"),
        ({"twice": True}, "several rooms are called room"),
        ({"sky": "cellar"}, "the rooms are west, east"),
    ],
)
def test_contradictory_arguments_are_refused(tmp_path: Path, arguments: dict[str, Any], message: str) -> None:
    rooms: list[Any] = arguments.get("rooms", two_rooms(tmp_path))
    if arguments.get("twice"):
        rooms = [(rooms[0].file, (0.0, 0.0, 0.0))] * 2
    with pytest.raises(ArgumentError, match=message):
        join(rooms, tmp_path / "flat.usda", sky=arguments.get("sky"))
    assert not (tmp_path / "flat.usda").exists()


@pytest.mark.parametrize("field", ["width", "height", "depth", "clearance"])
def test_openings_without_size_are_refused(field: str) -> None:
    for value in (-1.0, "1", None, math.nan):
        with pytest.raises(ArgumentError, match=f"{field}={value!r}: must "):
            Opening((0.0, 0.0, 0.0), **{field: value})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"position": (math.nan, 0.0, 0.0)}, r"rooms\[0\]: position\[0\]=nan: must be finite"),
        ({"position": (1e300, 0.0, 0.0)}, r"rooms\[0\]: position=\(1e\+300, 0.0, 0.0\): must be numbers of at most"),
        ({"position": (1.0, 2.0)}, r"rooms\[0\]: position=\(1.0, 2.0\): must be 3 numbers, not 2"),
        ({"position": None}, r"rooms\[0\]: position=None: must be 3 numbers"),
        ({"yaw": math.inf}, r"rooms\[0\]: yaw=inf: must be finite"),
        ({"yaw": "left"}, r"rooms\[0\]: yaw='left': must be a number"),
        ({"name": 5}, r"rooms\[0\]: name=5: must be a string"),
        ({"name": "\udcff"}, r"rooms\[0\]: name='\\udcff': must be a string .* without lone surrogates"),
        ({"file": 5}, r"rooms\[0\]: file=5: must be a string"),
    ],
)
def test_placement_with_an_invalid_value_is_refused(tmp_path: Path, arguments: dict[str, Any], message: str) -> None:
    room = RoomPlacement(write_room(tmp_path, "room"))._replace(**arguments)
    with pytest.raises(ArgumentError, match=message):
        join([room], tmp_path / "flat.usda")
    assert not list(tmp_path.glob("*flat*"))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"rooms": None}, "rooms=None: must be a sequence of rooms"),
        ({"openings": OPENING}, r"openings=Opening\(.*: must be a sequence of Opening"),
        ({"openings": [(0, 0, 0)]}, r"openings=\(\(0, 0, 0\),\): must be a sequence of Opening"),
        ({"name": "my flat"}, "name='my flat': must be the name of a prim, such as 'my_flat'"),
        ({"name": 5}, "name=5: must be a string"),
        ({"path": 5}, "path=5: must be a string"),
        ({"path": "a\0.usda"}, r"path='a\\x00.usda': must be a string .* without .* NUL"),
    ],
)
def test_argument_of_another_type_is_named(tmp_path: Path, arguments: dict[str, Any], message: str) -> None:
    given = {"rooms": [("object_view", (0, 0, 0))], "path": tmp_path / "flat.usda"} | arguments
    with pytest.raises(ArgumentError, match=message):
        join(**given)


@pytest.mark.parametrize("target", ["folder.usda", "room.usda/flat.usda"])
def test_file_that_cannot_be_written_is_named(tmp_path: Path, target: str) -> None:
    (tmp_path / "folder.usda").mkdir()
    room = write_room(tmp_path, "room")
    with pytest.raises(ExportError, match=f"cannot write .*{target}"):
        join([(room, (0.0, 0.0, 0.0))], tmp_path / target)
    assert {path.name for path in tmp_path.iterdir()} == {"folder.usda", "room.usda"}


def test_room_whose_file_name_is_not_unicode_is_named(tmp_path: Path) -> None:
    file = tmp_path / os.fsdecode(b"\xff.usda")
    try:
        write_room(tmp_path, "room").rename(file)
    except OSError:
        pytest.skip("the file system takes no such names")
    with pytest.raises(ArgumentError, match=r"rooms\[0\]: file='.*: must be .* without lone surrogates"):
        join([(file, (0.0, 0.0, 0.0))], tmp_path / "flat.usda")
    with pytest.raises(ArgumentError, match=r"path='.*: must be .* without lone surrogates"):
        join([("object_view", (0.0, 0.0, 0.0))], file)


@pytest.mark.parametrize(
    ("name", "message"),
    [("east.usda", r"east.usda'\): is a file of .*east.usda"), ("home.txt", r"must end in \.usda, \.usdc, \.usd")],
)
def test_file_that_must_not_be_written_is_refused(tmp_path: Path, name: str, message: str) -> None:
    west, east = write_room(tmp_path, "west"), write_room(tmp_path, "east")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(ArgumentError, match=message):
        join([(west, (0, 0, 0)), (east, (5, 0, 0))], tmp_path / name)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_wall_in_an_instance_within_another_one_is_cut(tmp_path: Path) -> None:
    room = tmp_path / "room.usda"
    room.write_text("""#usda 1.0
    (
        defaultPrim = "Room"
        metersPerUnit = 1
        upAxis = "Y"
    )
    def Xform "Room" {
        def Xform "Wall" {
            def Cube "Shape" {
                float3[] extent = [(-1, -1, -1), (1, 1, 1)]
            }
        }
        def Xform "Pair" {
            def "Inner" (
                instanceable = true
                references = </Room/Wall>
            ) {}
        }
        def "Outer" (
            instanceable = true
            references = </Room/Pair>
        ) {}
    }
    """)
    path = join([(room, (0.0, 0.0, 0.0))], tmp_path / "flat.usda", openings=[Opening((0.0, 0.0, 0.0))])
    assert Usd.Stage.Open(str(path)).GetPrimAtPath("/Flat/room/Outer/Inner/Shape").IsA(UsdGeom.Mesh)
    assert [each.name for each in read_stage(path).objects] == ["Shape", "Inner", "Outer", "Opening1"]
    layer = Sdf.Layer.FindOrOpen(str(path))
    names = [each.name for each in layer.GetPrimAtPath("/Flat/room").nameChildren]
    assert names == ["RoomVolume", "Pair", "Outer", "Wall"], "the same in every run"


def test_room_is_a_scene_by_its_name(tmp_path: Path) -> None:
    path = join([("object_view", (1.0, 0.0, 0.0))], tmp_path / "flat.usda")
    stage = Usd.Stage.Open(str(path))
    assert stage.GetPrimAtPath("/Flat/object_view").GetChildren()
    with pytest.raises(SceneNotFound, match="Did you mean 'object_view'"):
        join([("objct_view", (0.0, 0.0, 0.0))], tmp_path / "flat.usda")


def test_missing_room_is_named(tmp_path: Path) -> None:
    with pytest.raises(MissingFile, match=r"no file .*cellar\.usda"):
        join([(tmp_path / "cellar.usda", (0.0, 0.0, 0.0))], tmp_path / "flat.usda")


def test_subdivision_surface_in_an_opening_is_refused_by_name(tmp_path: Path) -> None:
    rooms = two_rooms(tmp_path, scheme="catmullClark")
    with pytest.raises(StageError, match=r"</Flat/west/WallRight/Shape> opening: a subdivision surface cannot be cut"):
        join(rooms, tmp_path / "flat.usda", openings=[OPENING])
    assert not list(tmp_path.glob("*flat*"))


def test_opening_without_a_wall_is_named(tmp_path):
    room = write_room(tmp_path, "one")
    astray = replace(OPENING, position=(0.5, 0.0, 0.5))
    with pytest.warns(StageWarning, match=r"openings that cut nothing.*: at \(0\.5, 0\.0, 0\.5\), yaw 90$"):
        join([(room, (0, 0, 0))], tmp_path / "joined.usda", openings=[OPENING, astray])
    assert (tmp_path / "joined.usda").exists()


def test_rigid_body_rolls_through_an_opening(joined: Path) -> None:
    pytest.importorskip("mujoco")
    ball = ts.Object("ball", "Ball 01", (0.5, 0.2, 0.0), dynamic=ts.RigidBody(velocity=(6.0, 0.0, 0.0)))
    frame = ts.Stream(ts.Scenario(str(joined), [ball]), width=32, height=24, fps=10, buffers=("instance",))[8]
    assert frame.objects.by_name("ball").room == "east"
