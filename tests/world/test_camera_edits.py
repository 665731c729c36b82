# SPDX-License-Identifier: Apache-2.0
"""Cameras that are moved and turned while a stream runs: replayed, seekable, saved; flow is right across the edits."""

import itertools
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import tiscene as ts
from dynamics import Orbit
from tests.world.test_collisions import EMPTY, STAGE
from tests.world.test_edits import load
from tiscene.errors import CameraNotFound, ScenarioError
from tiscene.scenario.edits import PlaceCamera
from tiscene.scenario.scenario import Scenario
from tiscene.world.world import World

START = ts.Camera((0, 1, 4), name="Eye")


def world(camera=START, **others):
    return World(Scenario("room", camera=camera, **others), EMPTY, load, 10.0)


def test_move_camera_takes_effect_at_the_next_frame_and_stays():
    made = world()
    made.next_frame = 5
    made.move_camera((1, 2, 3))
    assert [made.camera_at(frame).position for frame in (0, 4, 5, 90)] == [(0, 1, 4), (0, 1, 4), (1, 2, 3), (1, 2, 3)]
    assert made.camera_at(5).rotation == START.rotation
    assert made.scenario.edits == (PlaceCamera(5, "Eye", (1, 2, 3), START.rotation),)


def test_edits_are_not_anticipated_and_the_frame_before_is_known():
    made = world()
    made.next_frame = 5
    made.move_camera((1, 2, 3))
    for frame, expected in ((4, (0, 0, 0)), (5, (0, 1, 1)), (6, (1, 1, 1))):
        step = made.state(frame).cameras[0]
        assert [each.position == (1, 2, 3) for each in step] == [bool(each) for each in expected]


def test_turns_add_up_and_are_relative_to_the_view():
    made = world()
    made.turn_camera(yaw=90)
    np.testing.assert_allclose(-made.camera_at(0).axes()[:, 2], (-1, 0, 0), atol=1e-12)  # left of -z
    made.turn_camera(pitch=30)
    np.testing.assert_allclose(-made.camera_at(0).axes()[:, 2], (-(0.75**0.5), 0.5, 0), atol=1e-12)
    made.turn_camera(yaw=-90)
    np.testing.assert_allclose(-made.camera_at(0).axes()[:, 2], (0, 0.5, -(0.75**0.5)), atol=1e-12)
    made.next_frame = 3
    made.move_camera((0, 0, -2), relative=True)
    np.testing.assert_allclose(made.camera_at(3).position, (0, 2, 4 - 3**0.5), atol=1e-12)


def test_thousand_turns_keep_the_rotation_a_unit_quaternion():
    made = world()
    for frame in range(1000):
        made.next_frame = frame
        made.turn_camera(yaw=7.3, pitch=(-1) ** frame * 3.1)
    rotation = np.array(made.camera_at(999).rotation)
    assert np.linalg.norm(rotation) == pytest.approx(1.0, abs=1e-14)
    assert World(made.scenario, EMPTY, load, 10.0).camera_at(700) == made.camera_at(700)


def test_camera_on_a_trajectory_leaves_it():
    made = world(replace(START, dynamic=Orbit(period=4.0)))
    before = made.camera_at(7)
    made.next_frame = 8
    made.turn_camera(yaw=10)
    assert made.camera_at(7) == before
    assert made.camera_at(8).position == made.camera_at(50).position
    made.next_frame = 3  # the stream was sought back: the later edit still counts from its frame on
    made.move_camera((9, 9, 9))
    assert [made.camera_at(frame).position for frame in (3, 7)] == [(9, 9, 9)] * 2
    assert made.camera_at(8).position != (9, 9, 9)


def test_shutter_sees_a_placed_camera_at_rest():
    made = world(replace(START, dynamic=Orbit(period=4.0)))
    made.next_frame = 2
    made.move_camera((1, 1, 1))
    assert {made.between(2, Fraction(part, 4))[1][0].position for part in (-2, 0, 3)} == {(1, 1, 1)}
    assert made.between(1, Fraction(1, 2))[1][0].position not in ((1, 1, 1), START.position)


def test_one_of_several_cameras_is_placed_by_name():
    made = world((START, replace(START, name="Other")))
    made.move_camera((5, 5, 5), camera="Other")
    assert [camera.current.position for camera in made.state(0).cameras] == [(0, 1, 4), (5, 5, 5)]
    assert made.planned_start()[1].current == START


def test_cameras_walk_along_the_axes_of_their_small_steps_from_the_first_one_on():
    made = world()
    for frame, place in ((3, None), (5, (0.3, 1, 4)), (8, (0.3, 1, 9)), (9, (0.3, 1, 8.7)), (12, (0.3, 1.2, 8.7))):
        made.next_frame = frame
        if place is None:
            made.turn_camera(20)
        else:
            made.move_camera(place)
    walks = {0: set(), 4: set(), 5: {0}, 8: {0}, 9: {0, 2}, 11: {0, 2}, 12: {0, 1, 2}, 900: {0, 1, 2}}
    assert {frame: made.camera_walks(frame, 0) for frame in walks} == walks
    again = World(made.scenario, EMPTY, load, 10.0)
    assert {frame: again.camera_walks(frame, 0) for frame in walks} == walks
    made.next_frame = 2  # after a seek
    made.move_camera((0, 1, 4.1))
    assert [made.camera_walks(frame, 0) for frame in (1, 2, 5)] == [set(), {2}, {0, 2}]


def test_a_camera_walks_along_an_axis_from_the_first_of_several_steps_on():
    made = world()
    for frame, x in ((3, 0.0), (4, 0.2), (9, 0.4)):
        made.next_frame = frame
        made.move_camera((x, 1, 4))
    assert [made.camera_walks(frame, 0) for frame in (3, 4, 8, 9)] == [set(), {0}, {0}, {0}]


def test_a_placement_between_others_makes_the_next_one_a_step():
    made = world()
    for frame, x in ((3, 0.0), (9, 2.0), (6, 1.8)):  # jumps, and after a seek a step
        made.next_frame = frame
        made.move_camera((x, 1, 4))
    assert [made.camera_walks(frame, 0) for frame in (6, 8, 9)] == [set(), set(), {0}]


def test_cameras_walk_along_the_axes_along_which_their_trajectory_moves_them():
    pauses = ts.Keyframes((0.0, 1.0, 9.0), [ts.Waypoint((0, 1, 0)), ts.Waypoint((0, 1, 2)), ts.Waypoint((0, 1, 2))])
    pans = ts.Keyframes((0.0, 1.0), [ts.Waypoint((0, 1, 0)), ts.Waypoint((0, 1, 0), (0, 40, 0))])
    motions = {"circles": Orbit((0, 0, 0), period=4.0), "pauses": pauses, "pans": pans, "stands": None}
    made = world([replace(START, name=name, dynamic=motion) for name, motion in motions.items()])
    assert [made.camera_walks(40, row) for row in range(4)] == [{0, 2}, {2}, set(), set()]


def test_walls_of_the_frustum_stay_and_are_placed_anew():
    made = world(frustum=ts.Frustum(5.0))
    walls = made.trajectories.walls(Fraction(1))
    made.move_camera((3, 0, 0))
    assert np.array_equal(made.trajectories.walls(Fraction(1)), walls)
    made.set_frustum_walls(ts.Frustum(5.0))
    assert not np.array_equal(made.trajectories.walls(Fraction(1)), walls)


def test_walls_enclose_the_view_of_a_camera_by_name():
    moving = replace(START, name="Side", dynamic=Orbit((0, 0, 0), period=4.0))
    made = world([START, moving], frustum=ts.Frustum(5.0))
    made.next_frame = 7
    made.set_frustum_walls(ts.Frustum(5.0), "Side")
    (by_name,) = made.scenario.edits
    made.set_frustum_walls(ts.Frustum(5.0), made.camera_at(7, "Side"))
    assert made.scenario.edits[1] == by_name
    assert by_name.camera.position == made.camera_at(7, "Side").position != START.position


def test_wrong_camera_edits_raise_and_change_nothing():
    made = world()
    for wrong, error, message in (
        (lambda: made.move_camera((1, 2)), ScenarioError, "position"),
        (lambda: made.move_camera((1, 2, 3), (0, 0)), ScenarioError, "rotation"),
        (lambda: made.move_camera((1, 2, 3), camera="Eyes"), CameraNotFound, "'Eyes'.*Did you mean 'Eye'"),
        (lambda: made.turn_camera("left"), ScenarioError, "yaw='left'"),
        (lambda: PlaceCamera(0, "Eye", (0, 0, 0), (0, 90, 0)), ScenarioError, "must be a quaternion"),
        (lambda: PlaceCamera(-1, "Eye", (0, 0, 0), (1, 0, 0, 0)), ScenarioError, "frame=-1"),
        (lambda: world(edits=[PlaceCamera(0, "I", (0, 0, 0), (1, 0, 0, 0))]), CameraNotFound, "'I'"),
    ):
        with pytest.raises(error, match=message):
            wrong()
    assert not made.scenario.edits


def test_camera_edits_do_not_touch_the_simulation():
    bouncing = ts.Object("a", "Cube", (0, 0, 0), dynamic=ts.UniformMovementRandomBounce(1.0, start_direction=(1, 0, 0)))
    made = World(Scenario("room", [bouncing], camera=START), STAGE, load, 25.0)
    expected = made.trajectories.poses(60, (0,)).tobytes()
    stepped = made.trajectories.stepped
    made.next_frame = 20
    made.turn_camera(5)
    assert made.trajectories.stepped is stepped
    assert made.trajectories.poses(60, (0,)).tobytes() == expected


@pytest.fixture(scope="module")
def looked(tmp_path_factory) -> tuple[ts.Stream, list[ts.Frame]]:
    """A stream whose camera was turned and moved at frames 2 and 4, with its frames."""
    scenario = Scenario("solid_benchmark")
    buffers = ("depth", "position", "instance", "backward_flow", "forward_flow", "backward_occlusion")
    stream = ts.Stream(scenario, width=32, height=24, buffers=buffers)
    frames = []
    for frame in stream:
        frames.append(frame)
        if frame.index == 1:
            stream.world.turn_camera(yaw=4, pitch=-2)
        if frame.index == 3:
            stream.world.move_camera((0.1, 0.05, -0.3), relative=True)
        if frame.index == 5:
            return stream, frames


def test_edited_stream_replays_seeks_and_saves(looked, tmp_path):
    stream, frames = looked
    for suffix in ("json", "usda"):
        stream.scenario.save(tmp_path / f"run.{suffix}")
        again = ts.Stream(str(tmp_path / f"run.{suffix}"), width=32, height=24, buffers=stream.buffers)
        for index in (4, 1, 5, 2, 3, 0):
            frame = again[index]
            assert frame.camera == frames[index].camera
            for name in stream.buffers:
                assert frame[name].tobytes() == frames[index][name].tobytes(), (index, name)


def test_flow_across_camera_edits_agrees_with_projection(looked):
    """Backward flow shows the turn; forward flow of the frame before does not anticipate it."""
    _, frames = looked
    y, x = np.mgrid[0:24, 0:32]
    for before, frame in itertools.pairwise(frames):
        hit = np.isfinite(frame.depth)
        points = np.append(frame.position, np.ones((24, 32, 1), np.float32), axis=2) @ before.camera.camera_from_world.T
        seen = points[..., :3] @ before.camera.K.T
        expected = seen[..., :2] / seen[..., 2:] - np.stack([x, y], axis=2)
        np.testing.assert_allclose(frame.backward_flow[hit], expected[hit], atol=2e-3)
        assert not np.any(before.forward_flow)
    assert np.abs(frames[2].backward_flow).max() > 1
    assert np.abs(frames[4].backward_flow).max() > 1
    assert not np.any(frames[3].backward_flow)


def test_annotations_follow_the_placed_camera(looked):
    _, frames = looked
    for frame in (frames[1], frames[4]):
        for row in frame.objects:
            if row.visible_pixels and row.visible_box is not None:
                y, x = np.nonzero(frame.instance == row.id)
                assert row.visible_box == (x.min(), y.min(), x.max() + 1, y.max() + 1)
    assert frames[1].objects.by_name("Cube").amodal_box != frames[4].objects.by_name("Cube").amodal_box


def test_render_view_from_a_camera_is_what_a_moved_camera_shows(looked):
    stream, frames = looked
    elsewhere = frames[4].camera.camera
    before, count = stream.position, len(stream.scenario.edits)
    frame = stream.render_view(1, elsewhere, ("depth", "instance"))
    assert frame.depth.tobytes() == frames[4].depth.tobytes()  # nothing else moves in this scene
    assert frame.camera.camera == elsewhere
    assert (stream.position, len(stream.scenario.edits)) == (before, count)
    assert stream[1].depth.tobytes() == frames[1].depth.tobytes()
