# SPDX-License-Identifier: Apache-2.0
"""Point tracks: points stay on their surfaces, and are visible where a ray from the camera reaches them."""

from dataclasses import replace

import numpy as np
import pytest

import tiscene as ts
from tests.usd.helpers import write
from tiscene.export import export
from tiscene.export.point_tracks import POINTS, chosen_pixels
from tiscene.render.view import View

BUFFERS = ("instance", "position", "depth", "forward_flow", "forward_occlusion")
FRAMES = 5


@pytest.fixture(scope="module")
def stream():
    path = [ts.Waypoint((-0.6, 0.0, 0.4)), ts.Waypoint((0.6, 0.1, 0.4), (0, 90, 0))]
    objects = [
        ts.Object("cube", "Cube", (-0.6, 0.0, 0.4), dynamic=ts.LinearWaypoints(path, total_time=0.4)),
        ts.Object("ball", "Sphere", (0.3, 0.0, -0.5)),
    ]
    camera = ts.Camera.look_at((0.0, 0.3, 2.5), (0.0, 0.0, 0.0))
    scenario = ts.Scenario("object_view", objects, camera=camera)
    return ts.Stream(scenario, width=48, height=36, buffers=BUFFERS)


@pytest.fixture(scope="module")
def exported(stream):
    return ts.Stream(stream.scenario, width=48, height=36, buffers=("instance",))


@pytest.fixture(scope="module")
def tracks(exported, tmp_path_factory):
    folder = tmp_path_factory.mktemp("tracks")
    export(exported, folder, format="tracks", frames=range(FRAMES))
    with np.load(folder / "tracks" / "000000.npz") as clip:
        return dict(clip)


def test_clip_has_the_arrays_of_tap_vid(stream, tracks):
    count = len(tracks["query_points"])
    assert tracks["target_points"].shape == (count, FRAMES, 2)
    assert tracks["occluded"].shape == (count, FRAMES)
    np.testing.assert_array_equal(tracks["frames"], np.arange(FRAMES))
    assert "video" not in tracks  # the stream has no rgb
    assert set(np.unique(tracks["instance"])) == {row.id for row in stream[0].objects if row.visible_pixels}


@pytest.mark.parametrize(("frames", "query_frames"), [(range(5), {0}), (range(8, 16, 2), {2}), (range(13, 15), set())])
def test_queries_are_in_frames_that_a_part_of_a_clip_has(exported, tmp_path, frames, query_frames):
    export(exported, tmp_path, format="tracks", frames=frames)
    with np.load(tmp_path / "tracks" / "000000.npz") as clip:
        query, target, occluded = clip["query_points"], clip["target_points"], clip["occluded"]
        assert len(clip["instance"]) == len(query) == len(occluded)
    assert set(query[:, 0]) == query_frames
    rows, place = np.arange(len(query)), query[:, 0].astype(int)
    np.testing.assert_array_equal(target[rows, place], query[:, :0:-1])
    assert not occluded[rows, place].any()


def first(tracks):
    """The rows of the points that were chosen in frame 0, and their pixels."""
    rows = np.flatnonzero(tracks["query_points"][:, 0] == 0)
    y, x = (tracks["query_points"][rows, 1:] - 0.5).astype(int).T
    return rows, x, y


def test_points_move_by_the_flow_to_the_next_frame(stream, tracks):
    frame = stream[0]
    rows, x, y = first(tracks)
    target = tracks["target_points"][rows]
    np.testing.assert_array_equal(target[:, 0], np.stack([x, y], axis=1) + 0.5)
    moved = target[:, 1] - target[:, 0]
    np.testing.assert_allclose(moved, frame.forward_flow[y, x], atol=1e-3)
    np.testing.assert_array_equal(tracks["occluded"][rows, 1], frame.forward_occlusion[y, x])
    assert not tracks["occluded"][rows, 0].any()


def test_points_stay_on_their_objects(stream, tracks):
    start, end = stream[0], stream[FRAMES - 1]
    rows, x, y = first(tracks)
    on_cube = tracks["instance"][rows] == start.objects.by_name("cube").id
    rows, x, y = rows[on_cube], x[on_cube], y[on_cube]
    assert len(rows) > 10
    before = start.objects.by_name("cube").world_from_object
    after = end.objects.by_name("cube").world_from_object
    points = np.column_stack([start.position[y, x], np.ones(len(rows))])
    moved = points @ np.linalg.inv(before).T @ after.T @ end.camera.camera_from_world.T
    pixels = moved[:, :3] @ end.camera.K_at(0.5).T
    np.testing.assert_allclose(tracks["target_points"][rows, -1], pixels[:, :2] / pixels[:, 2:], atol=1e-3)
    # In a picture twenty times as large, the surface at a visible point is the point's own; a hidden one has another.
    cameras = stream.world.state(FRAMES - 1).cameras[0]
    large = stream.render_view(FRAMES - 1, View(*cameras, width=20 * 48, height=20 * 36), ("depth",))
    column, row = (20 * tracks["target_points"][rows, -1]).astype(int).T
    behind = moved[:, 2] - large.depth[row, column]
    hidden = tracks["occluded"][rows, -1]
    assert hidden.any()
    assert (np.abs(behind[~hidden]) < 0.04).mean() > 0.9
    assert (behind[hidden] > 0.04).mean() > 0.9


def test_points_are_occluded_by_objects_that_did_not_exist_when_they_were_chosen(tmp_path):
    camera = ts.Camera.look_at((0.0, 0.3, 2.5), (0.0, 0.0, 0.0))
    scenario = ts.Scenario("object_view", [ts.Object("cube", "Cube")], camera=camera)
    stream = ts.Stream(scenario, width=48, height=36, buffers=("instance",))
    stream.seek(3)
    late = stream.world.spawn("Sphere", (0.2, 0.1, 1.2))
    export(stream, tmp_path, format="tracks", frames=range(FRAMES))
    with np.load(tmp_path / "tracks" / "000000.npz") as clip:
        tracks = dict(clip)
    rows, x, y = first(tracks)
    np.testing.assert_array_equal(tracks["target_points"][rows, -1], tracks["target_points"][rows, 0])
    hidden = stream[4].instance[y, x] == late
    assert 5 < hidden.sum() < len(rows)
    np.testing.assert_array_equal(tracks["occluded"][rows, 4], hidden)
    assert not tracks["occluded"][rows, 1].any()


STRETCHING = """
def Xform "Room" {
    def Camera "Main" {
        double3 xformOp:translate = (0, 0, 3)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def Mesh "Cloth" {
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points.timeSamples = {
            0: [(-0.5, -0.5, 0), (0.5, -0.5, 0), (0.5, 0.5, 0), (-0.5, 0.5, 0)],
            4: [(-0.5, -0.5, 0), (0.9, -0.5, 0), (0.9, 0.5, 0.3), (-0.5, 0.5, 0)],
        }
    }
}
"""


def test_points_follow_a_surface_that_deforms(tmp_path):
    room = write(tmp_path, STRETCHING, more="timeCodesPerSecond = 25\n    startTimeCode = 0\n    endTimeCode = 4")
    stream = ts.Stream(room, width=48, height=36, buffers=("instance", "forward_flow"))
    exported = ts.Stream(room, width=48, height=36, buffers=("instance",))
    export(exported, tmp_path / "out", format="tracks", frames=range(FRAMES))
    with np.load(tmp_path / "out" / "tracks" / "000000.npz") as clip:
        tracks = dict(clip)
    rows, x, y = first(tracks)
    moved = tracks["target_points"][rows, 1] - tracks["target_points"][rows, 0]
    np.testing.assert_allclose(moved, stream[0].forward_flow[y, x], atol=1e-3)
    assert np.ptp(moved[:, 0]) > 0.2  # it stretches: points do not move alike
    since = View(*(stream.world.state(k).cameras[0].current for k in (4, 0, 1)), width=48, height=36)
    seen = stream.render_view(0, since, ("backward_flow", "backward_occlusion"), since=4)
    moved = tracks["target_points"][rows, 4] - tracks["target_points"][rows, 0]
    np.testing.assert_allclose(moved, seen.backward_flow[y, x], atol=1e-3)
    np.testing.assert_array_equal(tracks["occluded"][rows, 4], seen.backward_occlusion[y, x])


def test_points_are_chosen_evenly_among_objects_and_never_in_the_background():
    instance = np.zeros((40, 40), np.int32)
    instance[:, 10:], instance[0, :5] = 7, 3
    x, y = chosen_pixels(instance, np.random.default_rng(0))
    ids = instance[y, x]
    assert len(ids) == POINTS
    assert (ids == 3).sum() == 5
    assert (ids == 7).sum() == POINTS - 5
    assert len(set(zip(x.tolist(), y.tolist(), strict=True))) == POINTS


def test_points_of_an_orthographic_camera_are_where_its_matrix_projects_them(tmp_path):
    camera = ts.Camera.look_at((0.5, 0.6, 2.5), (0, 0, 0), orthographic_height=2.4, aperture_offset=(0.1, -0.07))
    path = [ts.Waypoint(camera.position, camera.rotation), ts.Waypoint((0.3, 0.5, 2.2), (-12, 8, 10))]
    camera = replace(camera, dynamic=ts.LinearWaypoints(path, total_time=0.4))
    scenario = ts.Scenario("object_view", [ts.Object("ball", "Sphere", (0.3, 0.0, -0.5))], camera=camera)
    with ts.Stream(scenario, width=24, height=18, buffers=("instance",)) as stream:
        export(stream, tmp_path, format="tracks", frames=(0, 4))
    with ts.Stream(scenario, width=24, height=18, buffers=("position",)) as stream:
        position, later = stream[0].position, stream[4].camera
    with np.load(tmp_path / "tracks" / "000000.npz") as clip:
        y, x = (clip["query_points"][:, 1:] - 0.5).astype(int).T
        target = clip["target_points"][:, 1]
    local = np.column_stack([position[y, x], np.ones(len(x))]) @ later.camera_from_world.T
    expected = (later.K_at(0.5) @ [local[:, 0], local[:, 1], np.ones(len(x))])[:2].T
    np.testing.assert_allclose(target, expected, atol=1e-4)
