# SPDX-License-Identifier: Apache-2.0
"""Edits of a running world: from the next frame on, kept, replayed to the bit."""

from fractions import Fraction

import numpy as np
import pytest

import tiscene as ts
from tests.world.test_collisions import EMPTY, STAGE, TEMPLATE, bouncer, path
from tiscene.errors import ObjectNotFound, ScenarioError, TemplateNotFound
from tiscene.frame.events import Event
from tiscene.scenario.edits import Despawn, Move, Spawn
from tiscene.scene.placement import Placement
from tiscene.world.world import World


def load(name):
    if name != "Cube":
        raise TemplateNotFound("template", name, ["Cube"])
    return TEMPLATE


def world(scenario, stage=STAGE):
    return World(scenario, stage, load, 25.0)


def same(a: Placement, b: Placement) -> bool:
    return all(
        getattr(a, name).tobytes() == getattr(b, name).tobytes()
        for name in ("mesh", "instance_id", "category_id", "world_from_object", "box_from_object")
    )


WAY = path((-1, 0, 0), (0, 0, 1))
SCENARIOS = {
    "still": (ts.Scenario("room", [ts.Object("a", "Cube", (-1, 0, 0))]), STAGE),
    "path": (ts.Scenario("room", [ts.Object("a", "Cube", dynamic=WAY)]), EMPTY),
    "blocked path": (ts.Scenario("room", [ts.Object("a", "Cube", dynamic=path((-1, 0, 0), (1.6, 0, 0.1)))]), STAGE),
    "bouncing": (ts.Scenario("room", [bouncer("a")], timings=ts.AllTogether(0.2)), STAGE),
    "walls": (ts.Scenario("room", [bouncer("a", position=(0, 0, -2))], camera=ts.Camera((0, 0, 2)),
                          frustum=ts.Frustum(6.0)), STAGE),
}  # fmt: skip


def played(made: World) -> dict[int, Placement]:
    """A stream's way through an edited world: what it has seen, by frame."""
    seen = {}
    for frame in range(60):
        made.next_frame = frame
        if frame == 10:
            made.spawn("Cube", (-1.0, 1.0, 1.0), dynamic=ts.UniformMovementRandomBounce(1.0, seed=3), id="b")
        if frame == 20:
            made.move("a", (0.0, 1.0, -1.0), (0, 45, 0))
            made.spawn("Cube", (0.0, -1.0, -1.0), (0, 30, 0), WAY, scale=0.5)
        if frame == 40:
            made.despawn("a")
            made.move("b", (-2.0, 0.0, 0.0))
        seen[frame] = made.state(frame).placement
    return seen


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_replay_shows_what_was_seen(name, tmp_path):
    scenario, stage = SCENARIOS[name]
    made = world(scenario, stage)
    seen = played(made)
    made.scenario.save(tmp_path / "edited.json")
    replay = world(ts.Scenario.load(tmp_path / "edited.json"), stage)
    for frame in (59, 9, 10, 19, 20, 21, 39, 40, 0, 30):
        for shown in (replay.state(frame).placement, made.state(frame).placement):
            # Objects that come later have no rows.
            assert same(shown, seen[frame]), f"frame {frame}"
            np.testing.assert_array_equal(shown.present, seen[frame].present)


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_world_that_follows_another_shows_the_same(name):
    scenario, stage = SCENARIOS[name]
    edited, follower = world(scenario, stage), world(scenario, stage)
    for frame in range(60):
        follower.state(frame)  # ahead of the edits, in vain
    seen = played(edited)
    middle = edited.edit_count // 2
    follower.follow(0, edited.edits(0, middle))
    follower.follow(middle - 1, edited.edits(middle - 1, edited.edit_count))  # the first of these is made already
    assert follower.scenario == edited.scenario
    assert all(same(follower.state(frame).placement, edited.state(frame).placement) for frame in seen)


def test_edits_are_effective_on_the_next_frame_and_not_anticipated():
    made = world(*SCENARIOS["still"])
    made.next_frame = 10
    number = made.spawn("Cube", (0, 0, 0), id="new")
    assert number == 4
    made.next_frame = 20
    made.despawn(number)
    made.move("a", (0.0, 1.0, 0.0))
    rows = {k: [(row.id, row.name) for row in made.state(k).objects if row.template] for k in (9, 10, 19, 20)}
    old, new = (3, "a"), (4, "new")
    assert rows == {9: [old], 10: [old, new], 19: [old, new], 20: [old]}
    # Columns: frames before, at and after; rows: two of the stage, a, new.
    present = {k: made.state(k).placement.present[:, 2:].T.tolist() for k in (9, 10, 19, 20, 21)}
    assert present[9] == [[True] * 3], "the spawn at 10 is not known at 9"
    assert present[10] == [[True] * 3, [False, True, True]]
    assert present[19] == [[True] * 3, [True] * 3], "nor the despawn at 20 at 19"
    assert present[20] == [[True] * 3, [True, False, False]]
    assert present[21] == [[True] * 3]
    x = {k: made.state(k).placement.world_from_object[:, -2, :, 3].tolist() for k in (19, 20)}
    assert x[19] == [[-1, 0, 0]] * 3
    assert x[20] == [[-1, 0, 0], [0, 1, 0], [0, 1, 0]]
    assert [row.velocity for row in made.state(19).objects if row.name == "a"] == [(0, 0, 0)]
    assert made.state(10).events() == (Event("spawn", 4), Event("enter", 4))
    assert made.state(20).events() == (Event("despawn", 4), Event("leave", 4))


def test_before_frame_0_the_world_stands_as_edits_of_frame_0_leave_it():
    """Also with an open shutter: nothing moves from where it was authored to where the first edits put it."""
    made = world(*SCENARIOS["still"])
    made.move("a", (0.5, 1.0, -1.0))
    placed = made.spawn("Cube", (1.0, 1.0, 1.0))
    made.move(placed, (1.0, 1.5, 1.0))
    for placement in (made.state(0).placement, made.between(0, Fraction(-1, 2))[0]):
        rows = placement.instance_id > 2
        assert rows.sum() == 2
        for time in range(3):
            np.testing.assert_allclose(
                placement.world_from_object[time, rows, :, 3], [(0.5, 1.0, -1.0), (1.0, 1.5, 1.0)]
            )
    assert not made.state(3).movers.any()


def test_ids_are_never_reused():
    made = world(*SCENARIOS["still"])
    first = made.spawn("Cube")
    made.next_frame = 5
    made.despawn(first)
    second = made.spawn("Cube")
    made.next_frame = 2
    third = made.spawn("Cube")
    assert (first, second, third) == (4, 5, 6)
    assert [edit.object.id for edit in made.scenario.edits if isinstance(edit, Spawn)] == [
        "spawned_1",
        "spawned_2",
        "spawned_3",
    ]


def test_names_that_are_made_are_new():
    made = world(*SCENARIOS["still"])
    made.spawn("Cube", id="spawned_2")
    made.spawn("Cube")
    made.spawn("Cube")
    assert [each.spec.id for each in made.scenario.log().histories] == ["a", "spawned_2", "spawned_3", "spawned_4"]


def test_what_appears_and_vanishes_at_one_frame_was_never_there():
    made = world(*SCENARIOS["still"])
    made.next_frame = 10
    made.despawn(made.spawn("Cube", (0, 0, 0)))
    for frame in (9, 10, 11):
        assert made.state(frame).events() == ()
        assert [row.name for row in made.state(frame).objects if row.template] == ["a"]
        assert made.state(frame).placement.instance_id.tolist() == [1, 2, 3]


def test_a_spawn_changes_nothing_before_it_and_nothing_far_away():
    scenario, stage = SCENARIOS["bouncing"]
    plain, edited = world(scenario, stage), world(scenario, stage)
    before = [plain.state(k).placement for k in range(40)]
    edited.next_frame = 20
    edited.spawn("Cube", (50.0, 0.0, 0.0), dynamic=ts.UniformMovementRandomBounce(2.0))
    for k in range(40):
        shown = edited.state(k).placement.world_from_object[:, : len(before[k].mesh)]
        assert shown.tobytes() == before[k].world_from_object.tobytes()


def test_a_path_stays_a_formula_while_edits_leave_it_free():
    made = world(*SCENARIOS["path"])
    made.next_frame = 1000
    made.spawn("Cube", (5, 5, 5), dynamic=path((5, 5, 5), (6, 6, 6)))
    made.state(10**6)
    assert made.trajectories.stepped is None
    made.next_frame = 5000
    made.spawn("Cube", (-0.5, 0.0, 0.9))
    made.state(5001)
    assert made.trajectories.stepped is not None
    assert min(made.trajectories.stepped._checkpoints) == 4999, "what was free is not stepped again"


STILL_STAGE = SCENARIOS["still"][1]


def test_things_of_the_stage_are_moved_and_taken_away():
    scenario, stage = SCENARIOS["still"]
    made = world(scenario, stage)
    thing = stage.objects[0]
    before = [made.state(k).placement for k in range(12)]
    made.next_frame = 5
    made.move(thing.prim_path, (1.0, 2.0, 3.0), (0, 90, 0))
    made.next_frame = 8
    made.despawn(1)
    assert made.scenario.edits == (Move(5, thing.prim_path, (1, 2, 3), (0, 90, 0)), Despawn(8, thing.prim_path))
    for k in range(5):
        assert same(made.state(k).placement, before[k]), "what was shown stays what it was, edits are not anticipated"
    rows = {k: {row.id: row for row in made.state(k).objects} for k in (4, 5, 7, 8)}
    assert rows[5][1].position == rows[7][1].position == (1, 2, 3)
    assert 1 not in rows[8]
    part = 0  # those of the first thing come first
    moved = made.state(5).placement.world_from_object[:, part]
    np.testing.assert_array_equal(moved[0], np.eye(4)[:3])
    np.testing.assert_allclose(moved[1, :, 3], (1, 2, 3), atol=1e-12)
    np.testing.assert_array_equal(moved[1], moved[2])
    assert made.state(8).placement.present[:, part].tolist() == [True, False, False]
    assert Event("despawn", 1) in made.state(8).events()
    replayed = world(made.scenario, stage)
    for k in (9, 2, 7, 5, 4, 8):
        assert same(replayed.state(k).placement, made.state(k).placement)
        assert replayed.state(k).objects == made.state(k).objects
        assert replayed.state(k).events() == made.state(k).events()
    assert made.state(7).movers[part]
    assert not made.state(4).movers[part]
    with pytest.raises(ObjectNotFound, match=thing.prim_path):
        made.move(thing.prim_path, (0, 0, 0))
    with pytest.raises(ScenarioError, match=r"no object '/Pilar'.*did you mean '/Pillar'"):
        world(ts.Scenario("room", edits=[Despawn(0, "/Pilar")]), stage)


def test_what_bounces_meets_a_thing_where_it_was_put(tmp_path):
    """The pillar stands in its way from frame 10 on, and is gone at frame 80."""
    flying = ts.Object("b", "Cube", (-2.0, 0.0, 0.0), dynamic=ts.UniformMovementRandomBounce(1.0, 0.0, (1, 0, 0)))
    scenario = ts.Scenario("room", [flying])
    made, plain = world(scenario, STILL_STAGE), world(scenario, STILL_STAGE)
    made.next_frame = 10
    made.move("/Pillar", (-2.0, 0.0, 0.0))
    made.next_frame = 30
    made.spawn("Cube", (0.0, 1.0, 2.0))
    made.next_frame = 80
    made.despawn("/Pillar")
    first = next((k, event) for k in range(80) for event in made.state(k).events() if event.kind == "contact")
    assert first[1] == Event("contact", 3, 1)
    assert 20 < first[0] < 40, "it met the pillar at its new place"
    for k in (9, 10, 11):
        assert (
            made.state(k).placement.world_from_object[1, 2].tobytes()
            == plain.state(k).placement.world_from_object[1, 2].tobytes()
        )
    made.scenario.save(tmp_path / "run.json")
    again = world(ts.Scenario.load(tmp_path / "run.json"), STILL_STAGE)
    for k in (120, 35, 79, 81, 29):
        assert same(again.state(k).placement, made.state(k).placement), f"frame {k}"


def test_walls_of_another_view():
    flying = ts.Object("b", "Cube", (0.0, 0.0, 0.0), dynamic=ts.UniformMovementRandomBounce(1.0, 0.0, (1, 0, 0)))
    made = world(ts.Scenario("room", [flying]), EMPTY)
    made.next_frame = 10
    made.set_frustum_walls(ts.Frustum(6.0), ts.Camera((0, 0, 3), vertical_fov=0.6), 1.0)
    made.next_frame = 100
    made.set_frustum_walls(None)
    inside = [made.state(k).objects[0].position for k in range(100)]
    assert max(abs(x) for x, _, _ in inside) < 3.0
    walls = {event.surface for k in range(100) for event in made.state(k).events() if event.kind == "contact"}
    assert walls
    away = [np.linalg.norm(made.state(k).objects[0].position) for k in (100, 300)]
    assert away[1] > away[0] + 5.0, "nothing holds it any more"
    again = world(made.scenario, EMPTY)
    assert same(again.state(99).placement, made.state(99).placement)
    with pytest.raises(ScenarioError, match="aspect"):
        made.set_frustum_walls(None, aspect=0.0)


def test_what_was_put_into_another_comes_out():
    """Two cubes in exactly one place: the one that flies leaves the other."""
    objects = [
        ts.Object("a", "Cube", (-2.0, 0.0, 0.0)),
        ts.Object("b", "Cube", (-2.0, 0.0, 0.0), dynamic=ts.UniformMovementRandomBounce(1.0)),
    ]
    made = world(ts.Scenario("room", objects), STILL_STAGE)
    places = np.array([made.state(k).objects[-1].position for k in range(60)])
    assert np.isfinite(places).all()
    assert np.linalg.norm(places - (-2.0, 0.0, 0.0), axis=1).max() > 0.6


def test_an_edit_of_every_frame_costs_no_frame_twice():
    """As of an agent whose walls go where it goes."""
    scenario, stage = SCENARIOS["bouncing"]
    made, seen = world(scenario, stage), []
    for frame in range(80):
        made.next_frame = frame
        if frame >= 10:
            made.set_frustum_walls(ts.Frustum(4.0), ts.Camera((0, 0, 2 - 0.01 * frame)))
        if frame % 9 == 0:
            made.move("a", (0.0, 0.5, -0.01 * frame), (0, frame, 0))
        seen.append(made.state(frame).placement.world_from_object)
    assert len(made.scenario.edits) == 79
    # Each frame has been computed as the next of the one before it, and again once that is edited.
    assert made.trajectories.stepped.simulated_frames <= 2 * 80
    replay = world(made.scenario, stage)
    for frame in (79, 9, 10, 30, 63):
        np.testing.assert_array_equal(replay.state(frame).placement.world_from_object, seen[frame])
    plain = world(scenario, stage)
    assert not (plain.state(30).placement.world_from_object == seen[30]).all(), "the walls hold what had none before"


def test_walls_set_up_later_but_at_an_earlier_frame_win():
    scenario, stage = SCENARIOS["walls"]
    made = world(scenario, stage)
    for frame, far in ((20, 5.0), (40, 2.5), (30, 4.0)):
        made.next_frame = frame
        made.set_frustum_walls(ts.Frustum(far), ts.Camera((0, 0, 2)))
    planes = {frame: made.trajectories.walls(Fraction(frame, 25)) for frame in (20, 21, 30, 31, 41)}
    far = {frame: round(float(plane[5, 3]), 6) for frame, plane in planes.items()}
    assert far[20] != far[21] == far[30] != far[31] == far[41]
    replay = world(made.scenario, stage)
    for frame in (50, 25, 35):
        assert same(replay.state(frame).placement, made.state(frame).placement)


def test_objects_that_appear_vanish_or_are_moved_are_movers_as_soon_as_that_is_known():
    objects = [
        ts.Object("stays", "Cube", (-1, 0, 0)),
        ts.Object("appears", "Cube", (0, 0, 0), first_frame=9),
        ts.Object("vanishes", "Cube", (1, 0, 0), last_frame=9),
    ]
    made = world(ts.Scenario("room", objects), EMPTY)
    assert made.state(0).movers.tolist() == made.state(20).movers.tolist() == [False, True, True]
    made.next_frame = 5
    made.move("stays", (-1, 1, 0))
    assert [made.state(frame).movers[0] for frame in (4, 5, 20)] == [False, True, True]


def test_an_object_of_the_stage_is_a_mover_from_the_frame_on_that_removes_it():
    made = world(ts.Scenario("room"))
    made.next_frame = 5
    made.despawn("/Pillar")
    assert [made.state(frame).movers.tolist() for frame in (4, 5, 9)] == [[False, False], [True, False], [True, False]]
