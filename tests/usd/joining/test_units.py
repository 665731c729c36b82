# SPDX-License-Identifier: Apache-2.0
"""Rooms of other units and axes in one stage: frames, openings, trajectories and metadata of the stage."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Usd

import tiscene as ts
from dynamics.rotation import quaternion, rotate
from tests.usd.helpers import write
from tests.usd.joining.rooms import OPENING, view, write_room
from tests.usd.joining.studio import RATE, joined, write_studio
from tiscene.errors import StageWarning
from tiscene.usd import RoomPlacement, join
from tiscene.usd.read.stage_reader import read_stage

METERS = [(0.01, "Z"), (0.001, "Y"), (1.0, "Z")]


def frames(file: Path, variants: dict[str, str]) -> list[ts.Frame]:
    buffers = ("hdr", "depth", "position", "normal", "semantic", "part", "instance", "forward_flow", "scene_flow")
    options: dict[str, Any] = {"width": 48, "height": 36, "fps": 10, "spp": 32, "denoise": False, "camera": "Main"}
    stream = ts.Stream(str(file), variants=variants, buffers=buffers, **options)
    return [stream[0], stream[6]]


def names(frame: ts.Frame) -> np.ndarray:
    known = {row.id: row.name for row in frame.objects}
    return np.vectorize(lambda number: known.get(number, ""))(frame.instance)


@pytest.mark.parametrize(("meters", "up"), METERS)
def test_joined_room_has_the_frames_of_the_room_alone(tmp_path: Path, meters: float, up: str) -> None:
    pytest.importorskip("mujoco")
    room = write_studio(tmp_path, meters, up)
    other = "Y" if up == "Z" else "Z"
    home = joined(room, (3.0, 0.5, -2.0), 90.0, up=other)
    x, y, z = np.eye(3)
    turn = np.array([z, y, -x]) if other == "Y" else np.array([-y, x, z])  # by 90 degrees about the new up axis
    axes = turn @ (np.array([x, z, -y]) if up == "Z" else np.array([x, -z, y]))
    for variant in ("day", "night"):
        pairs = zip(frames(room, {"/Room{lighting}": variant}), frames(home, {"/Home{lighting}": variant}), strict=True)
        for alone, with_others in pairs:
            same = (names(alone) == names(with_others)) & (alone.part == with_others.part)
            assert same.mean() > 0.995
            assert (alone.semantic == with_others.semantic).mean() > 0.995
            for name, values in (
                ("depth", alone.depth),
                ("position", alone.position @ axes.T + (3.0, 0.5, -2.0)),
                ("normal", alone.normal @ axes.T),
                ("scene_flow", alone.scene_flow @ axes.T),
                ("forward_flow", alone.forward_flow),
            ):
                hit = same & np.isfinite(alone.depth)
                error = np.abs(values[hit] - with_others[name][hit])
                assert np.quantile(error, 0.99) < (0.02 if name == "forward_flow" else 2e-3), name
            assert with_others.hdr.mean() == pytest.approx(alone.hdr.mean(), rel=0.02)
            blocks = [each.hdr.reshape(6, 6, 8, 6, 3).mean(axis=(1, 3)) for each in (alone, with_others)]
            error = np.abs(blocks[0] - blocks[1]) / (blocks[0] + 0.1 * alone.hdr.mean())
            assert np.quantile(error, 0.9) < 0.1  # the others see caustics of the glass, which are noise
            there = {row.name: row for row in with_others.objects}
            for row in alone.objects:
                assert np.array(row.position) @ axes.T + (3.0, 0.5, -2.0) == pytest.approx(
                    there[row.name].position, abs=1e-3
                )
                assert sorted(row.box_3d.size) == pytest.approx(sorted(there[row.name].box_3d.size), abs=1e-3)
    fallen = [frame.objects.by_name("Würfel").position[1 if up == "Y" else 2] for frame in frames(room, {})]
    assert fallen[0] - fallen[1] == pytest.approx(0.5 * 3.0 * 0.6**2, rel=1e-3)


def test_mesh_that_emits_light_is_as_bright_as_in_the_room_alone(tmp_path: Path) -> None:
    body = """
def Xform "Room" {
    def Mesh "Glow" (prepend apiSchemas = ["MeshLightAPI"]) {
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [(0, 0, 0), (40, 0, 0), (40, 40, 0), (0, 40, 0)]
        uniform token subdivisionScheme = "none"
        bool inputs:normalize = 1
        float inputs:intensity = 8000
    }
}"""
    room = write(tmp_path, body, name="room.usda", meters=0.01, up="Z", more='defaultPrim = "Room"')
    for file in (room, joined(room)):
        (glow,) = (each for each in read_stage(file).materials if each.name == "Glow")
        assert glow.emissive_color == pytest.approx((5.0, 5.0, 5.0), rel=1e-6)


@pytest.mark.parametrize("meters", [0.01, 0.001])
def test_opening_between_rooms_of_different_units_is_cut(tmp_path: Path, meters: float) -> None:
    rooms = [
        RoomPlacement(write_room(tmp_path, "west"), name="west"),
        RoomPlacement(write_room(tmp_path, "east", meters=meters), (4.4, 0.0, 0.0), 180.0, "east"),
    ]
    for order in (rooms, rooms[::-1]):
        home = join(order, tmp_path / "flat.usda", openings=[OPENING])
        frame = view(home, camera="/Flat/west/Main")
        assert frame.depth[12, 16] == pytest.approx(6.4, abs=1e-4)
        assert frame.objects.by_id(int(frame.instance[12, 16])).room == "east"
        volumes = {each.name: each for each in read_stage(home).rooms}
        low, high = (volumes["east"].world_from_box @ (*[side] * 3, 1.0) for side in (-1.0, 1.0))
        np.testing.assert_allclose(np.sort([low, high], axis=0)[:, :3], [(2.4, 0, -2), (6.4, 3, 2)], atol=1e-5)


def test_volume_of_a_turned_room_is_over_its_floor(tmp_path: Path) -> None:
    home = joined(write_studio(tmp_path, 0.01, "Z"), (3.0, 0.5, -2.0), up="Y")
    volume = next(each for each in read_stage(home).rooms if each.name == "studio")
    corners = np.array([volume.world_from_box @ (*[side] * 3, 1.0) for side in (-1.0, 1.0)])[:, :3]
    np.testing.assert_allclose(np.sort(corners, axis=0), [(1, 0.5, -4), (5, 3, 0)], atol=1e-5)


@pytest.mark.parametrize(("meters", "up"), [(1.0, "Y"), (0.01, "Z")])
@pytest.mark.parametrize("kind", ["linearWaypoints", "keyframes", "orbit", "lookAt", "composite"])
def test_trajectories_of_a_room_go_along_with_it(tmp_path: Path, kind: str, meters: float, up: str) -> None:
    """Positions, turns and distances are those of the room alone, turned and placed."""
    x, y, z = ((100, 0, 0), (0, 100, 0), (0, 0, 100)) if meters == 0.01 else ((1, 0, 0), (0, 1, 0), (0, 0, 1))
    motions = {
        "linearWaypoints": f"""
        uniform point3d[] tiscene:motion:positions = [{x}, {y}]
        uniform double3[] tiscene:motion:rotations = [(0, 10, 0), (0, 50, 0)]""",
        "keyframes": f"""
        uniform point3d[] tiscene:motion:positions = [{x}, {y}]
        uniform double3[] tiscene:motion:rotations = [(0, 10, 0), (0, 0, 0)]
        uniform quatd[] tiscene:motion:orientations = [(0, 0, 0, 0), (0.6, 0, 0.8, 0)]
        uniform double[] tiscene:motion:times = [0, 1]""",
        "lookAt": f"uniform point3d tiscene:motion:target = {x}\nuniform vector3d tiscene:motion:up = (0, 0, 1)",
        "orbit": f"uniform point3d tiscene:motion:center = {x}\nuniform vector3d tiscene:motion:axis = (0, 0, 1)",
        "composite": "rel tiscene:motion:parts = [</Room/First>, </Room/Second>]",
    }
    parts = "".join(
        f"""
    def Scope "{name}" (prepend apiSchemas = ["TisceneMotionAPI"]) {{
        uniform token tiscene:motion:type = "linearWaypoints"
        uniform point3d[] tiscene:motion:positions = [{one}, {two}]
    }}"""
        for name, one, two in (("First", x, y), ("Second", y, z))
    )
    body = f"""
def Xform "Room" {{
    def Cube "Mover" (prepend apiSchemas = ["TisceneMotionAPI"]) {{
        double3 xformOp:translate = {z}
        uniform token[] xformOpOrder = ["xformOp:translate"]
        double size = {0.1 / meters}
        uniform token tiscene:motion:type = "{kind}"
        {motions[kind]}
    }}
    {parts if kind == "composite" else ""}
}}"""
    room = write(tmp_path, body, meters=meters, up=up, name="room.usda", more=f'defaultPrim = "Room"\n    {RATE}')
    rows = []
    for file in (room, joined(room, (1.0, 2.0, 3.0), 90.0)):
        stream = ts.Stream(str(file), width=8, height=6, fps=10, buffers=("instance",))
        rows.append([stream[k].objects.by_name("Mover") for k in (0, 7, 23)])
    turn = np.array([(0, 0, 1), (0, 1, 0), (-1, 0, 0)])
    axes = turn @ (np.array([(1, 0, 0), (0, 0, 1), (0, -1, 0)]) if up == "Z" else np.eye(3))
    for alone, placed in zip(*rows, strict=True):
        np.testing.assert_allclose(np.array(alone.position) @ axes.T + (1, 2, 3), placed.position, atol=1e-6)
        own, new = (rotate(quaternion(each.rotation), np.eye(3)) for each in (alone, placed))
        np.testing.assert_allclose(own @ axes.T, new, atol=1e-6)


def test_fallback_types_of_all_rooms_are_kept_and_conflicts_named(tmp_path: Path) -> None:
    text = "fallbackPrimTypes = {{\n        token[] {} = [{}]\n    }}"
    room = write(
        tmp_path,
        'def Xform "Room"\n{\n    def Slab "A" {}\n    def Rod "B" {}\n}',
        name="room.usda",
        more='defaultPrim = "Room"\n    fallbackPrimTypes = {\n        token[] Slab = ["Cube"]\n'
        '        token[] Rod = ["Cone"]\n    }',
    )
    with pytest.warns(StageWarning, match=r"room\.usda: fallbackPrimTypes of Rod are Cone; .* count: Cylinder"):
        home = joined(room, more=text.format("Rod", '"Cylinder"'))
    assert len(read_stage(home).instances) == 3
    kinds = Usd.Stage.Open(str(home)).GetMetadata("fallbackPrimTypes")
    assert {name: list(types) for name, types in kinds.items()} == {"Rod": ["Cylinder"], "Slab": ["Cube"]}


def test_physics_outside_of_the_default_prim_is_named(tmp_path: Path) -> None:
    room = write(
        tmp_path,
        'def Xform "Room" {}\ndef PhysicsScene "Scene" {}',
        name="room.usda",
        more='defaultPrim = "Room"',
    )
    with pytest.warns(StageWarning, match=r"</Scene> outside of the default prim </Room>"):
        joined(room)


def test_rooms_of_equal_units_are_referenced_as_they_are(tmp_path: Path) -> None:
    room = write_studio(tmp_path, 1.0, "Y")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        stage = Usd.Stage.Open(str(joined(room)))
    layer = stage.GetRootLayer()
    assert [str(each.name) for each in layer.GetPrimAtPath("/Home/studio").nameChildren] == ["RoomVolume"]
