# SPDX-License-Identifier: Apache-2.0
"""home_01: a walk through all its rooms, what is seen at the doorways, and objects that nobody looks at."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path

import numpy as np
import pytest
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray
from pxr import Usd, UsdLux

import tiscene as ts
import usd_scenes
from tiscene.scene.description import DomeLight, SceneDescription
from usd_scenes.author.home_01 import ROOMS, WALK

SCENE = Path(usd_scenes.__file__).parent / "home_01" / "scene.usda"
SECONDS, FPS = 60.0, 2.5
FRAMES = round(SECONDS * FPS)
KITCHEN = (4.1, 7.7, 0.0, 2.7, -9.3, -5.3)  # x, y and z of its interior, m


def walking() -> ts.Camera:
    stops = [ts.Waypoint((x, 1.5, z), (0.0, yaw, 0.0)) for x, z, yaw in WALK]
    dynamic = ts.CatmullWaypoints(stops, total_time=SECONDS, rotation="euler")
    return ts.Camera((0.0, 1.5, 0.0), vertical_fov=1.05, exposure=2.8, dynamic=dynamic)


@pytest.fixture(scope="module")
def stream() -> ts.Stream:
    """Return a walk through the home with labels, a ball that flies in the kitchen, and a bear that sits there."""
    flight = ts.UniformMovementRandomBounce(speed=1.2, start_direction=(0.4, 0.3, -1.0), seed=3)
    objects = [
        ts.Object("ball", "Ball 01", (5.4, 1.6, -7.0), dynamic=flight),
        ts.Object("bear", "Teddy Bear 01", (7.1, 0.25, -5.9)),
    ]
    buffers = ("instance", "depth", "position", "forward_flow", "forward_occlusion")
    scenario = ts.Scenario("home_01", objects, camera=walking())
    return ts.Stream(scenario, width=48, height=36, fps=FPS, buffers=buffers)


@pytest.fixture(scope="module")
def embree(stream: ts.Stream) -> tuple[EmbreeScene, NDArray[np.int64]]:
    """Return the home in Embree, and the instance id of each triangle."""
    stage: SceneDescription = stream.world.stage
    scene, corners, owners = EmbreeScene(), [], []
    for each in stage.instances:
        mesh, matrix = stage.meshes[each.mesh], each.world_from_object
        corners.append((mesh.positions @ matrix[:3, :3].T + matrix[:3, 3])[mesh.triangles].astype(np.float32))
        owners.append(np.full(len(mesh.triangles), each.object + 1))
    TriangleMesh(scene, np.concatenate(corners))
    return scene, np.concatenate(owners)


def cameras(stream: ts.Stream) -> NDArray[np.float64]:
    """Return the camera's positions at all frames of the walk, [n, 3]."""
    return np.array([stream.world.state(k).cameras[0].current.position for k in range(FRAMES)])


def doorways(stream: ts.Stream) -> list[int]:
    """Return the frames at which the camera is in a doorway."""
    at = np.array([(3.82, -0.15), (6.05, -0.15), (6.04, -2.14), (4.94, -5.10)])
    distance = np.linalg.norm(cameras(stream)[:, None, [0, 2]] - at, axis=2).min(axis=1)
    runs = groupby(range(FRAMES), key=lambda k: bool(distance[k] < 0.4))
    return [min(group, key=lambda k: distance[k]) for inside, group in runs if inside]


@pytest.mark.slow
def test_walk_leads_through_all_rooms(stream: ts.Stream) -> None:
    states = (stream.world.state(k) for k in range(FRAMES))
    rooms = [room for room, _ in groupby(state.room_of(state.cameras[0].current) for state in states)]
    home = ["living room", "hall", "bedroom", "hall", "bathroom", "hall", "kitchen", "hall", "living room"]
    assert rooms == home
    assert set(rooms) == set(ROOMS)


@pytest.mark.slow
def test_walk_keeps_clear_of_walls_and_furniture(
    stream: ts.Stream, embree: tuple[EmbreeScene, NDArray[np.int64]]
) -> None:
    places = cameras(stream).astype(np.float32)
    turns = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z], np.float32)
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    origins, directions = np.repeat(places, len(turns), axis=0), np.tile(turns, (len(places), 1))
    distance = embree[0].run(origins, directions, query="DISTANCE").reshape(len(places), -1).min(axis=1)
    assert distance.min() > 0.2, f"frame {int(distance.argmin())} at {places[distance.argmin()]}"
    steps = np.diff(np.concatenate([places, places[:1]]), axis=0)
    length = np.linalg.norm(steps, axis=1)
    ahead = embree[0].run(places, (steps / length[:, None]).astype(np.float32), query="DISTANCE")
    assert (ahead > length).all()


@pytest.mark.slow
def test_labels_at_doorways_agree_with_embree(stream: ts.Stream, embree: tuple[EmbreeScene, NDArray[np.int64]]) -> None:
    frames = doorways(stream)
    assert len(frames) == 8  # there and back
    scene, owners = embree
    in_view = []
    for k in frames:
        frame = stream[k]
        y, x = np.mgrid[:36, :48]
        local = np.linalg.inv(frame.camera.K) @ np.stack([x, y, np.ones_like(x)]).reshape(3, -1)
        pose = frame.camera.world_from_camera
        directions = (pose[:3, :3] @ local).T
        origins = np.tile(pose[:3, 3], (len(directions), 1))
        hits = scene.run(origins.astype(np.float32), directions.astype(np.float32), output=True)
        expected = np.where(hits["primID"] >= 0, owners[hits["primID"]], 0).reshape(36, 48)
        fixed = frame.instance <= len(stream.world.stage.objects)  # without the ball and the bear
        same = frame.instance == expected
        assert same[fixed].mean() > 0.995, k
        seen = same & (expected > 0)
        depth = hits["tfar"].reshape(36, 48)[seen]
        assert np.isclose(frame.depth[seen], depth, rtol=1e-3).mean() > 0.998
        in_view.append(len({frame.objects.by_id(int(id)).room for id in np.unique(frame.instance) if id}))
    assert sum(rooms >= 2 for rooms in in_view) >= 3


@pytest.mark.slow
def test_flow_at_doorways_is_that_of_the_points(stream: ts.Stream) -> None:
    for k in doorways(stream):
        frame, following = stream[k], stream[k + 1].camera
        fixed = (frame.instance > 0) & (frame.instance <= len(stream.world.stage.objects))
        pose = following.camera_from_world
        local = frame.position[fixed] @ pose[:3, :3].T + pose[:3, 3]
        front = local[:, 2] > 0.1
        image = local[front] @ following.K.T
        y, x = np.nonzero(fixed)
        moved = image[:, :2] / image[:, 2:] - np.stack([x, y], axis=1)[front]
        np.testing.assert_allclose(frame.forward_flow[fixed][front], moved, atol=0.02, rtol=1e-3)


@pytest.mark.slow
def test_time_passes_for_objects_that_nobody_looks_at(stream: ts.Stream) -> None:
    """The ball flies on in the kitchen while the camera is elsewhere; the bear stays where it sits."""
    unseen = [
        k
        for k in range(0, FRAMES // 2, 5)
        if stream.world.state(k).room_of(stream.world.state(k).cameras[0].current) != "kitchen"
    ]
    rows = {k: {row.name: row for row in stream.world.state(k).objects if not row.prim_path} for k in unseen}
    places = np.array([rows[k]["ball"].position for k in unseen])
    x0, x1, y0, y1, z0, z1 = KITCHEN
    assert (places > (x0, y0, z0)).all()
    assert (places < (x1, y1, z1)).all()
    assert (np.linalg.norm(np.diff(places, axis=0), axis=1) > 0.01).all()
    assert {rows[k][name].room for k in unseen for name in ("ball", "bear")} == {"kitchen"}
    assert {rows[k]["bear"].position for k in unseen} == {(7.1, 0.25, -5.9)}


def test_home_has_one_sky_and_the_lights_of_all_rooms(stream: ts.Stream) -> None:
    lights = stream.world.stage.lights
    (dome,) = (each for each in lights if isinstance(each, DomeLight))
    assert len(dome.portals) == 9  # living room and hall have three each, other rooms one
    home = Usd.Stage.Open(str(SCENE))
    for room in ROOMS:
        prims = Usd.PrimRange(home.GetPrimAtPath(f"/Home01/{room.replace(' ', '_')}"))
        kinds = [UsdLux.SphereLight, UsdLux.RectLight]
        assert any(prim.IsA(kind) for prim in prims for kind in kinds), room


def test_every_object_of_the_home_is_in_a_room(stream: ts.Stream) -> None:
    rows = [row for row in stream.world.state(0).objects if row.prim_path]
    assert {row.room for row in rows} == set(ROOMS)
    for row in rows:
        folder = row.prim_path.split("/")[2]
        if folder not in ("Doors", "Openings"):
            assert row.room.replace(" ", "_") == folder, row.prim_path
