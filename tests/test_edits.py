"""Edits of a running world: from the next frame on, kept, replayed to the bit."""

import numpy as np
import pytest

import tiscene as ts
from tests.test_collisions import EMPTY, STAGE, TEMPLATE, bouncer, path
from tiscene.edits import Despawn, Move, Spawn
from tiscene.errors import ObjectNotFound, ScenarioError, TemplateNotFound
from tiscene.events import Event
from tiscene.scene.placement import Placement
from tiscene.world import World


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
        seen[frame] = made.placement(frame)
    return seen


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_replay_shows_what_was_seen(name, tmp_path):
    scenario, stage = SCENARIOS[name]
    made = world(scenario, stage)
    seen = played(made)
    made.scenario.save(tmp_path / "edited.json")
    replay = world(ts.Scenario.load(tmp_path / "edited.json"), stage)
    for frame in (59, 9, 10, 19, 20, 21, 39, 40, 0, 30):
        for shown in (replay.placement(frame), made.placement(frame)):
            rows = len(seen[frame].mesh)
            # Objects that come later are there as rows, but not present.
            assert not shown.present[:, rows:].any()
            cut = Placement(
                shown.mesh[:rows],
                shown.instance_id[:rows],
                shown.category_id[:rows],
                shown.world_from_object[:, :rows],
                shown.box_from_object[:rows],
                shown.present[:, :rows],
            )
            assert same(cut, seen[frame]), f"frame {frame}"
            np.testing.assert_array_equal(cut.present, seen[frame].present)


def test_edits_are_effective_on_the_next_frame_and_not_anticipated():
    made = world(*SCENARIOS["still"])
    made.next_frame = 10
    number = made.spawn("Cube", (0, 0, 0), id="new")
    assert number == 4
    made.next_frame = 20
    made.despawn(number)
    made.move("a", (0.0, 1.0, 0.0))
    rows = {k: [(row.id, row.name) for row in made.objects(k) if row.template] for k in (9, 10, 19, 20)}
    old, new = (3, "a"), (4, "new")
    assert rows == {9: [old], 10: [old, new], 19: [old, new], 20: [old]}
    # Columns: frames before, at and after; rows: a, new.
    present = {k: made.placement(k).present[:, -2:].T.tolist() for k in (9, 10, 19, 20)}
    assert present[9] == [[True] * 3, [False] * 3], "the spawn at 10 is not known at 9"
    assert present[10] == [[True] * 3, [False, True, True]]
    assert present[19] == [[True] * 3, [True] * 3], "nor the despawn at 20 at 19"
    assert present[20] == [[True] * 3, [True, False, False]]
    x = {k: made.placement(k).world_from_object[:, -2, :, 3].tolist() for k in (19, 20)}
    assert x[19] == [[-1, 0, 0]] * 3
    assert x[20] == [[-1, 0, 0], [0, 1, 0], [0, 1, 0]]
    assert [row.velocity for row in made.objects(19) if row.name == "a"] == [(0, 0, 0)]
    assert made.events(10) == [Event("spawn", 4), Event("enter", 4)]
    assert made.events(20) == [Event("despawn", 4), Event("leave", 4)]


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


def test_a_spawn_changes_nothing_before_it_and_nothing_far_away():
    scenario, stage = SCENARIOS["bouncing"]
    plain, edited = world(scenario, stage), world(scenario, stage)
    before = [plain.placement(k) for k in range(40)]
    edited.next_frame = 20
    edited.spawn("Cube", (50.0, 0.0, 0.0), dynamic=ts.UniformMovementRandomBounce(2.0))
    for k in range(40):
        shown = edited.placement(k).world_from_object[:, : len(before[k].mesh)]
        assert shown.tobytes() == before[k].world_from_object.tobytes()


def test_a_path_stays_a_formula_while_edits_leave_it_free():
    made = world(*SCENARIOS["path"])
    made.next_frame = 1000
    made.spawn("Cube", (5, 5, 5), dynamic=path((5, 5, 5), (6, 6, 6)))
    made.placement(10**6)
    assert made._motion._stepped is None
    made.next_frame = 5000
    made.spawn("Cube", (-0.5, 0.0, 0.9))
    made.placement(5001)
    assert made._motion._stepped is not None
    assert min(made._motion._stepped._checkpoints) == 4999, "what was free is not stepped again"


@pytest.mark.parametrize(
    ("edit", "error", "match"),
    [
        (lambda made: made.despawn("nobody"), ObjectNotFound, "no object 'nobody'"),
        (lambda made: made.despawn("/Nothing"), ObjectNotFound, "no object '/Nothing'"),
        (lambda made: made.despawn(99), ObjectNotFound, "no object '99'"),
        (lambda made: made.despawn(True), ObjectNotFound, "no object 'True'"),
        (lambda made: made.move("a", (0, float("nan"), 0)), ScenarioError, "position"),
        (lambda made: made.move(99, (0, 0, 0)), ObjectNotFound, "'99'"),
        (lambda made: made.spawn("Cub"), TemplateNotFound, "Did you mean 'Cube'"),
        (lambda made: made.spawn("Cube", id="a"), ScenarioError, "never reused"),
        (lambda made: made.spawn("Cube", scale=-1), ScenarioError, "scale"),
        (lambda made: made.spawn("Cube", dynamic="fast"), ScenarioError, "dynamic"),
    ],
)
def test_what_cannot_be_done_changes_nothing(edit, error, match):
    made = world(*SCENARIOS["still"])
    before = made.scenario, made.placement(3)
    with pytest.raises(error, match=match):
        edit(made)
    assert made.scenario == before[0]
    assert same(made.placement(3), before[1])


@pytest.mark.parametrize(
    ("edits", "match"),
    [
        ([Despawn(3, "x")], r"edits\[0\]: no object 'x' was there before it"),
        ([Despawn(3, "a"), Move(3, "a", (0, 0, 0))], r"edits\[1\]: the object 'a' is not there at frame 3"),
        ([Spawn(2, ts.Object("a", "Cube", first_frame=2))], "never reused"),
        (["spawn"], "must be a Spawn, a Despawn, a Move or an Enclose"),
        (3, "edits=3"),
    ],
)
def test_logs_that_contradict_themselves(edits, match):
    with pytest.raises(ScenarioError, match=match):
        ts.Scenario("room", [ts.Object("a", "Cube")], edits=edits)


def test_edits_check_their_values():
    with pytest.raises(ValueError, match="first_frame is 3"):
        Spawn(3, ts.Object("a", "Cube"))
    with pytest.raises(ValueError, match="frame=-1"):
        Despawn(-1, "a")
    with pytest.raises(TypeError, match=r"frame=1\.0"):
        Move(1.0, "a", (0, 0, 0))
    with pytest.raises(ScenarioError, match=r"edits\[0\].object"):
        ts.Scenario("room", edits=[Spawn(3, type("Fake", (), {"first_frame": 3})())])
