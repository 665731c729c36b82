# SPDX-License-Identifier: Apache-2.0
"""Exceptions in the middle of a frame or of an edit, as Ctrl-C raises them: what follows has the right bytes."""

import random
from dataclasses import dataclass, replace
from fractions import Fraction

import pytest

import tiscene as ts
from tests.interruption import interrupted

SETTINGS = {"width": 16, "height": 12, "buffers": ("instance", "depth", "forward_flow")}
FRAMES = 24
EDITING = "tiscene/world", "tiscene/scenario"


def bounce(number: int = 3) -> ts.UniformMovementRandomBounce:
    return ts.UniformMovementRandomBounce(speed=1.5, seed=number)


def scenario() -> ts.Scenario:
    """Return a scenario whose objects bounce off walls and each other, next to one on a path."""
    way = [ts.Waypoint((-0.6, 0.3, -3)), ts.Waypoint((0.6, 0.3, -3.2), (0, 90, 0)), ts.Waypoint((0, 0.9, -2.8))]
    objects = [
        ts.Object("a", "Cube", (-0.3, 0.2, -3), scale=0.4, dynamic=bounce(3)),
        ts.Object("b", "Sphere", (0.4, -0.1, -3), scale=0.5, dynamic=bounce(4)),
        ts.Object("c", "Cube", scale=0.3, dynamic=ts.CatmullWaypoints(way, total_time=2.0)),
    ]
    camera = ts.Camera.look_at((0, 0.5, 0.5), (0, 0, -3))
    return ts.Scenario("object_view", objects, camera=camera, frustum=ts.Frustum(5.0))


def content(frame) -> tuple:
    buffers = tuple(frame[name].tobytes() for name in frame.buffers)
    return frame.index, buffers, tuple(map(repr, frame.objects)), tuple(map(repr, frame.events))


@pytest.fixture(scope="module")
def right() -> list[tuple]:
    stream = ts.Stream(scenario(), **SETTINGS)
    return [content(stream[index]) for index in range(FRAMES)]


@pytest.mark.parametrize("seed", range(2))
def test_frames_after_an_interrupted_one_have_the_right_bytes(right, seed):
    stream, chosen, count = ts.Stream(scenario(), **SETTINGS), random.Random(seed), 0
    for _ in range(25):
        stream.seek(chosen.randrange(FRAMES - 4))
        count += interrupted(lambda: next(stream), chosen.randrange(1, 5000))
        for _ in range(2):
            frame = next(stream)
            assert content(frame) == right[frame.index]
    assert count > 10


def test_interrupted_frame_is_the_next(right):
    stream = ts.Stream(scenario(), **SETTINGS)
    stream.seek(7)
    assert interrupted(lambda: next(stream), 1000)
    assert stream.position == 7
    assert content(next(stream)) == right[7]


def test_stream_that_shares_trees_is_right_after_the_first_frame_of_another_was_interrupted(right):
    stream, chosen = ts.Stream(scenario(), **SETTINGS), random.Random(1)
    for _ in range(6):
        other = stream.another(scenario())
        interrupted(lambda: other[0], chosen.randrange(1, 6000))  # noqa: B023
        assert content(other[3]) == right[3]
        other.close(keep_trees=True)
    stream.restart(scenario())
    assert content(stream[5]) == right[5]


def test_measurements_of_a_frame_that_is_kept_stay_right_after_an_interruption():
    stream = ts.Stream(scenario(), **SETTINGS)
    kept, again = stream[6], ts.Stream(scenario(), **SETTINGS)[6]
    assert interrupted(lambda: stream[12], 1500)
    stream[13]
    assert kept.objects.arrays()["amodal_box"].tobytes() == again.objects.arrays()["amodal_box"].tobytes()


def test_error_of_a_dynamic_comes_again_and_drops_nothing_on_the_device():
    @dataclass(frozen=True)
    class Fails(ts.Stepped):
        def begin(self, start):
            return start.position

        def advance(self, state, number):
            if number > 20:
                raise RuntimeError("out of poses")
            return state

        def pose(self, state):
            return ts.Waypoint(state)

    objects = [
        ts.Object("a", "Cube", (0, 0, -3), dynamic=Fails()),
        ts.Object("b", "Cube", (1, 0, -3), dynamic=bounce()),
    ]
    stream = ts.Stream(ts.Scenario("object_view", objects), **SETTINGS)
    before, scene = content(next(stream)), stream._renderer._scene
    for _ in range(2):
        with pytest.raises(RuntimeError, match="out of poses"):
            stream[12]
    assert content(stream[0]) == before
    assert stream._renderer._scene is scene


@pytest.mark.parametrize("seed", range(2))
def test_interrupted_edit_leaves_the_state_before_or_after_it(seed):
    stream, chosen, count = ts.Stream(scenario(), **SETTINGS), random.Random(seed), 0
    live: list[int] = []

    def edit():
        kind = chosen.random()
        place = (chosen.uniform(-0.8, 0.8), chosen.uniform(-0.5, 1), chosen.uniform(-4, -2))
        if kind < 0.5 or not live:
            live.append(stream.world.spawn("Sphere", place, dynamic=chosen.choice((None, bounce())), scale=0.5))
        elif kind < 0.8:
            stream.world.move(chosen.choice(live), place)
        else:
            stream.world.despawn(live.pop())

    for _ in range(16):
        before = stream.world.edit_count
        count += interrupted(edit, chosen.randrange(30, 350))
        assert stream.world.edit_count - before in (0, 1)
        live = [each.id for each in stream.world.state(stream.position).objects if each.name.startswith("spawned")]
        next(stream)
    assert count > 3
    replayed = ts.Stream(stream.scenario, **SETTINGS)
    assert stream.categories == replayed.categories
    for index in range(2, 20, 3):
        assert content(stream[index]) == content(replayed[index])


def known(world) -> dict:
    """Return what a world tells without a frame."""
    names = ("templates", "edit_count")
    cameras = tuple(world.camera_at(frame) for frame in range(3))
    walks = world.camera_walks(2, 0), world.camera_is_dynamic(2, 0)
    return {
        **{name: getattr(world, name) for name in names},
        "categories": world.categories,
        "lights": {row: light.radiance for row, light in world.replaced_lights.items()},
        "edits": world.edits(0, 99),
        "cameras": cameras + world.between(1, Fraction(1, 2))[1],
        "walks": walks,
        "stages": [each.meshes for each in world.descriptions],
        "objects": [(each.id, each.name) for each in world.initial_objects],
    }


def test_what_a_world_tells_at_once_after_an_interrupted_edit_is_that_of_before_or_after_it():
    base = ts.Scenario("object_view", camera=ts.Camera((0, 0.5, 0.5)))
    edits = {
        "spawn": lambda world: world.spawn("Chair 01", (0, 0, -3)),
        "camera": lambda world: world.move_camera((0.3, 1, 1)),
        "light": lambda world: world.set_light(0, replace(world.stage.lights[0], radiance=(0.5, 1, 1))),
    }
    stream = ts.Stream(base, **SETTINGS)
    for edit in edits.values():
        stream.restart(base)
        before = known(stream.world)
        edit(stream.world)
        after, line, seen = known(stream.world), 0, []
        stream.restart(base)
        while interrupted(lambda: edit(stream.world), line := line + 1, EDITING):  # noqa: B023
            seen.append(known(stream.world) == before)
            assert seen[-1] or known(stream.world) == after, line
            if not seen[-1]:
                stream.restart(base)
        assert any(seen)
        assert known(stream.world) == after


def test_replaced_light_stays_after_an_interrupted_edit():
    stream = ts.Stream(ts.Scenario("object_view"), **SETTINGS)
    stream.set_light(0, stream.world.stage.lights[0])
    stream.world.spawn("Cube", (0, 0, -3))
    for line in range(150, 350, 20):
        interrupted(lambda: stream.world.spawn("Cube", (0, 1, -3)), line)
        assert list(stream.world.replaced_lights) == [0]
        replayed = ts.Stream(stream.scenario, **SETTINGS)
        assert [each.name for each in stream[1].objects] == [each.name for each in replayed[1].objects]


def test_camera_whose_recorded_poses_end_is_not_played_to_its_end_for_labels():
    """It was run 10 s ahead at frame 0, and its IndexError raised there."""

    @dataclass(frozen=True)
    class Recorded(ts.Stepped):
        def begin(self, start):
            return 0

        def advance(self, state, number):
            return state + 1

        def pose(self, state):
            return ts.Waypoint([(0.01 * i, 0.5, 0.5) for i in range(101)][state])

    camera = ts.Camera((0, 0.5, 0.5), dynamic=Recorded())
    recorded = ts.Scenario("object_view", [ts.Object("a", "Cube", (0, 0, -3))], camera=camera)
    stream = ts.Stream(recorded, width=16, height=12, frames=20, buffers=("instance",))
    assert len(list(stream)) == 20
    assert stream.world.camera_walks(0, 0) == {0, 1, 2}
