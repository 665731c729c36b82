# SPDX-License-Identifier: Apache-2.0
"""Edits and frames cost the same however many edits there were: counted in function calls and sizes, not in seconds."""

import gc
import random
import sys
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import tiscene as ts
from tests.world.test_collisions import EMPTY, STAGE, TEMPLATE, bouncer, path
from tiscene.scene.animation import InstanceTrack
from tiscene.scene.description import Instance, SceneObject, SphereLight, Template
from tiscene.world.world import World

LAMP = Template(
    "Lamp",
    "lamp",
    replace(TEMPLATE.description, lights=(SphereLight("Bulb", "/Bulb", np.eye(4), (8.0, 8.0, 8.0), 0.1),)),
)
TEMPLATES = {"Cube": TEMPLATE, "Lamp": LAMP}
LOOP = path((-1, 0, 0), (0, 0, 1))


def make(*objects: ts.Object, stage=EMPTY, **others) -> World:
    return World(ts.Scenario("room", objects, **others), stage, TEMPLATES.__getitem__, 25.0)


def count_calls(action: Callable[[], object]) -> int:
    """Return how many functions are called, those of C included."""
    calls = 0

    def count(_frame, event, _argument):
        nonlocal calls
        calls += event in ("call", "c_call")

    sys.setprofile(count)
    try:
        action()
    finally:
        sys.setprofile(None)
    return calls


def next_frame(world: World) -> None:
    world.state(world.next_frame)
    world.next_frame += 1


def spawn_and_despawn(world: World, template="Cube", **others) -> None:
    """Run four frames: an object is spawned for two of them."""
    spawned = world.spawn(template, (0.0, -1.0, 0.0), **others)
    next_frame(world)
    next_frame(world)
    world.despawn(spawned)
    next_frame(world)
    next_frame(world)


CYCLES = {
    "still": (make, spawn_and_despawn),
    "beside a path": (lambda: make(ts.Object("a", "Cube", (0, 1, 0), dynamic=LOOP)), spawn_and_despawn),
    "beside a bouncing object": (
        lambda: make(bouncer("a"), stage=STAGE, frustum=ts.Frustum(6.0), camera=ts.Camera((0, 0, 2))),
        spawn_and_despawn,
    ),
    "path": (make, lambda world: spawn_and_despawn(world, dynamic=LOOP)),
    "bouncing": (make, lambda world: spawn_and_despawn(world, dynamic=ts.UniformMovementRandomBounce(1.0))),
    "lamp": (make, lambda world: spawn_and_despawn(world, "Lamp")),
    "scaled at random": (make, lambda world: spawn_and_despawn(world, scale=1.0 + world.next_frame / 1e4)),
}


@pytest.mark.parametrize("name", CYCLES)
@pytest.mark.parametrize("edits", [100, pytest.param(600, marks=pytest.mark.slow)])
def test_spawn_and_despawn_make_as_many_calls_after_many_edits_as_after_20(name, edits):
    create, cycle = CYCLES[name]
    world = create()
    calls = []
    cycles = edits // 2
    for number in range(cycles):
        if 5 <= number < 10 or number >= cycles - 5:
            calls.append(count_calls(lambda: cycle(world)))
        else:
            cycle(world)
    assert len(world.scenario.edits) == edits
    assert np.median(calls[5:]) < 1.1 * np.median(calls[:5])


def spawn_and_despawn_quickly(world: World, cycles: int) -> int:
    """Despawn each object at the frame after its spawn; return the id of the last one."""
    for number in range(cycles):
        spawned = world.spawn("Lamp" if number % 2 else "Cube", (0.0, -1.0, 0.0), scale=1.0 + 0.25 * (number % 3))
        world.state(world.next_frame)
        world.next_frame += 1
        world.despawn(spawned)
        world.state(world.next_frame)
    return spawned


def test_nothing_but_the_log_grows_with_600_edits():
    world = make(ts.Object("a", "Cube", (-1, 0, 0)), stage=STAGE)
    last = spawn_and_despawn_quickly(world, 300)
    assert last == 3 + 300, "ids are not reused"
    state = world.state(world.next_frame)
    assert state.placement.instance_id.tolist() == [1, 2, 3, last], "the last one was present at the frame before"
    assert world.state(world.next_frame + 1).placement.instance_id.tolist() == [1, 2, 3]
    assert len(world.trajectories.movers._entries) < 100


def test_simulation_holds_live_objects_only_and_repeats_edited_frames_only():
    world = make(bouncer("a"), stage=STAGE)
    spawn_and_despawn_quickly(world, 100)
    simulation = world.trajectories.stepped
    assert simulation.frame(world.next_frame).numbers == (0, 100)
    # A state takes its frame and the next one; each edit of a frame invalidates both.
    assert simulation.simulated_frames <= 4 * 100
    assert len(world.trajectories.movers._entries) < 100
    assert len(world.trajectories.movers._shapes) == 6


def test_garbage_collected_objects_per_edit_are_few():
    world = make()
    for _ in range(50):
        spawn_and_despawn(world)
    gc.collect()
    before = len(gc.get_objects())
    for _ in range(300):
        spawn_and_despawn(world)
    gc.collect()
    # Per cycle: two edits, an object with its three tuples, a history with its list, the rows of the log's indices.
    assert (len(gc.get_objects()) - before) / 300 < 16


@pytest.mark.parametrize("target", ["a", "/Pillar"])
@pytest.mark.parametrize("moves", [500, pytest.param(2000, marks=pytest.mark.slow)])
def test_move_makes_as_many_calls_after_many_moves_as_after_20(target, moves):
    world = make(ts.Object("a", "Cube", (-1, 0, 0)), stage=STAGE)
    calls = []
    for number in range(moves):
        move = lambda number=number: world.move(target, (-1.0, 1e-4 * number, 0.0), (0.0, 1.0, 0.0))  # noqa: E731
        if 20 <= number < 40 or number >= moves - 20:
            calls.append(count_calls(move))
        else:
            move()
        if number % 5 == 0:
            calls_of_frame = count_calls(lambda: next_frame(world))
            if number == 100:
                early = calls_of_frame
    assert np.median(calls[20:]) < 1.1 * np.median(calls[:20]) + 5
    assert calls_of_frame < 1.1 * early


def test_trees_of_a_moved_stage_take_the_rows_of_earlier_ones():
    world, used = make(bouncer("a"), stage=STAGE), []
    for number in range(60):
        world.move("/Pillar", (0.0, 1e-4 * number, 0.0))
        next_frame(world)
        used.append(world.trajectories._setting.trees().bvh.used_rows)
    assert used[10] > used[0]
    assert used[-1] == used[10]


def test_frames_evaluate_authored_animation_as_often_when_many_animated_objects_were_moved(monkeypatch):
    count, calls = 8, 0
    matrices = np.tile(np.eye(4)[:3], (2, count, 1, 1))
    matrices[1, :, :, 3] = 1.0
    track = InstanceTrack(np.arange(count, dtype=np.int32), np.array([0.0, 1.0]), matrices, np.ones((2, count), bool))
    instances = tuple(Instance(0, row, np.eye(4)) for row in range(count))
    objects = tuple(SceneObject(f"Lift{row}", f"/Lift{row}") for row in range(count))
    world = make(
        stage=replace(
            TEMPLATE.description, instances=instances, objects=objects, tracks=(track,), object_tracks=(track,)
        )
    )
    at = InstanceTrack.at

    def counted(*arguments):
        nonlocal calls
        calls += 1
        return at(*arguments)

    monkeypatch.setattr(InstanceTrack, "at", counted)
    world.state(3)
    before, world.next_frame = calls, 5
    for row in objects:
        world.move(row.prim_path, (0.0, 1.0, 0.0))
    world.state(5)
    calls = 0
    world.state(9)
    assert calls == before


def random_edits(world: World, seed: int, frames: int, bouncing: bool) -> dict[int, bytes]:
    """Spawn, move and despawn objects at random while frames are shown; return what was shown."""
    random.seed(seed)
    shown, alive = {}, []
    for frame in range(frames):
        world.next_frame = frame
        for _ in range(random.choice((0, 1, 1, 2, 4))):
            position = [round(random.uniform(-2, 2), 2) for _ in range(3)]
            kind = random.random()
            if kind < 0.5:
                dynamic = random.choice((None, LOOP, ts.UniformMovementRandomBounce(1.0) if bouncing else None))
                last = random.choice((None, frame + random.randrange(9)))
                others = {"dynamic": dynamic, "last_frame": last, "collide": random.random() < 0.6}
                alive.append((world.spawn(random.choice(("Cube", "Lamp")), position, **others), last))
            else:
                alive = [(number, last) for number, last in alive if last is None or last >= frame]
                if alive and kind < 0.8:
                    world.despawn(alive.pop(random.randrange(len(alive)))[0])
                elif alive and bouncing:
                    world.move(random.choice(alive)[0], position)
        shown[frame] = summary(world, frame)
    return shown


def summary(world: World, frame: int) -> bytes:
    state = world.state(frame)
    placement = state.placement
    arrays = [
        placement.mesh,
        placement.instance_id,
        placement.category_id,
        placement.world_from_object,
        placement.present,
        state.movers,
    ]
    lights = [(light.prim_path, light.world_from_light.tolist()) for light in state.lights]
    text = repr((state.objects, state.events(), lights, state.starting_lights, state.has_dynamic_lights))
    return b"".join(array.tobytes() for array in arrays) + text.encode()


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_seeking_and_replaying_show_despawned_objects_as_they_were(seed):
    world = make(ts.Object("a", "Cube", (-1, 0, 0)), bouncer("b", position=(0, 1, -1)), stage=STAGE)
    shown = random_edits(world, seed, 30, bouncing=True)
    replay = make(*world.scenario.objects, stage=STAGE, edits=world.scenario.edits)
    for frame in random.sample(sorted(shown), 12):
        assert summary(world, frame) == shown[frame], f"frame {frame} again"
        assert summary(replay, frame) == shown[frame], f"frame {frame} of the replay"


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_objects_are_simulated_from_the_first_frame_at_which_they_might_collide(seed):
    """A bouncing object far away makes the other world simulate from frame 0: it must show no other pose."""
    worlds = [
        make(ts.Object("a", "Cube", (0, 1, 0), dynamic=LOOP), other)
        for other in (ts.Object("far", "Cube", (99, 0, 0)), bouncer("far", position=(99, 0, 0)))
    ]
    for world in worlds:
        random_edits(world, seed, 25, bouncing=False)
    for frame in (*range(25), 100):
        lazy, eager = (world.state(frame).objects for world in worlds)
        assert [replace(each, velocity=None) for each in lazy if each.name != "far"] == [
            replace(each, velocity=None) for each in eager if each.name != "far"
        ]
    assert worlds[1].trajectories.stepped is not None


def test_edits_at_an_earlier_frame_may_collide_with_later_objects():
    """One that was put into the path of an object that had been spawned for a later frame."""
    world = make(stage=EMPTY)
    world.next_frame = 50
    world.spawn("Cube", dynamic=path((-1, 0, 0), (1, 0, 0.01)), id="later")
    world.state(60)
    assert world.trajectories.stepped is None
    world.next_frame = 10
    world.spawn("Cube", (0.0, 0.0, 0.0), id="earlier")
    free = make(edits=world.scenario.edits[:1])
    frames = range(50, 150)
    poses = [[made.state(k).objects[-1 if made is free else 0].position for k in frames] for made in (world, free)]
    assert world.trajectories.stepped is not None
    assert poses[0] != poses[1]
    replay = make(edits=world.scenario.edits)
    assert [replay.state(k).objects[0].position for k in frames] == poses[0]


def test_lights_of_later_spawns_are_not_anticipated():
    world = make(stage=EMPTY)
    first = summary(world, 0)
    assert world.state(0).placement.lights is None
    world.next_frame = 1
    world.spawn("Lamp", (0.0, 1.0, 0.0))
    world.state(1)
    replay = make(edits=world.scenario.edits)
    assert summary(replay, 0) == summary(world, 0) == first
    assert replay.state(0).placement.lights is None
    assert not replay.state(0).has_dynamic_lights
    assert replay.state(1).has_dynamic_lights


def test_second_move_at_a_frame_keeps_the_rotation_of_the_first():
    world = make(ts.Object("a", "Cube"))
    world.next_frame = 3
    world.move("a", (1.0, 0.0, 0.0), (0.0, 90.0, 0.0))
    world.move("a", (2.0, 0.0, 0.0))
    assert world.scenario.edits[1].rotation == (0.0, 90.0, 0.0)
    assert world.state(3).objects[0].position == (2.0, 0.0, 0.0)


@pytest.mark.slow
def test_cycles_cost_the_same_after_100_000_edits():
    stream = ts.Stream("object_view", width=64, height=48, buffers=("instance",))
    world = stream.world

    def cycle() -> None:
        spawned = world.spawn("Ball 01", (0.0, 0.5, 0.0))
        next(stream)
        world.despawn(spawned)
        next(stream)

    for _ in range(20):
        cycle()
    seen = {frame: stream[frame].instance.copy() for frame in range(20)}
    early = count_calls(cycle)
    for _ in range(50_000 - 21):
        cycle()
    assert len(stream.scenario.edits) == 100_000
    assert count_calls(cycle) < 1.1 * early
    for frame, instance in seen.items():
        np.testing.assert_array_equal(stream[frame].instance, instance)
