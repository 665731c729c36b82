# SPDX-License-Identifier: Apache-2.0
"""Which edits are accepted: their values, the objects that they name, and logs of several."""

import json
from dataclasses import replace

import numpy as np
import pytest

import tiscene as ts
from tests.world.test_collisions import STAGE
from tests.world.test_edits import SCENARIOS, same, world
from tiscene.errors import (
    ArgumentError,
    ArgumentTypeError,
    CameraNotFound,
    ObjectNotFound,
    ScenarioError,
    TemplateNotFound,
)
from tiscene.scenario.edits import Despawn, Move, SetFrustumWalls, Spawn


@pytest.mark.parametrize(
    ("edit", "error", "match"),
    [
        (lambda made: made.despawn("nobody"), ObjectNotFound, "no object 'nobody'"),
        (lambda made: made.despawn("/Nothing"), ObjectNotFound, "no object '/Nothing'"),
        (lambda made: made.despawn(99), ObjectNotFound, "no object 99 at frame 0. There are: .*a \\(3\\)"),
        (lambda made: made.despawn(True), ObjectNotFound, "no object True"),
        (lambda made: made.despawn([3]), ArgumentError, r"object=\[3\]: must be an instance id, a name or a prim path"),
        (lambda made: made.set_frustum_walls("walls"), ScenarioError, "frustum='walls': must be a Frustum or None"),
        (
            lambda made: made.set_frustum_walls(ts.Frustum(), 3),
            ScenarioError,
            "camera=3: must be a Camera, the name of one or None",
        ),
        (lambda made: made.set_frustum_walls(ts.Frustum(), "Mine"), CameraNotFound, "no camera 'Mine'"),
        (lambda made: made.move("a", (0, float("nan"), 0)), ScenarioError, "position"),
        (lambda made: made.move(99, (0, 0, 0)), ObjectNotFound, "no object 99"),
        (lambda made: made.spawn("Cub"), TemplateNotFound, "Did you mean 'Cube'"),
        (lambda made: made.spawn("Cube", id="a"), ScenarioError, "not reused"),
        (lambda made: made.spawn(ts.Object("b", "Cube")), ArgumentTypeError, r"must be a name; of an Object, spawn\("),
        (lambda made: made.spawn("Cube", scale=-1), ScenarioError, "scale"),
        (lambda made: made.spawn("Cube", dynamic="fast"), ScenarioError, "dynamic"),
        (lambda made: made.spawn("Cube", colour=1), ArgumentTypeError, "colour: world.spawn has no .* collide, scale"),
        (lambda made: made.spawn("Cube", free=1), ArgumentTypeError, "free=1: must be True or False"),
        (lambda made: made.spawn("Cube", region=(0, 0, 0.5, 1)), ArgumentError, "add free=True"),
        (lambda made: made.move_camera((0, 1, 0), relative="yes"), ScenarioError, "relative='yes': must be True"),
        (lambda made: made.camera_at("x"), ArgumentTypeError, "frame='x': must be a whole number"),
        (lambda made: made.camera_at(-1), ArgumentError, "frame=-1: must be at least 0"),
        (lambda made: made.spawn("Cube", first_frame=3), ArgumentTypeError, "first_frame: world.spawn has no such"),
    ],
)
def test_what_cannot_be_done_changes_nothing(edit, error, match):
    made = world(*SCENARIOS["still"])
    before = made.scenario, made.state(3).placement
    with pytest.raises(error, match=match):
        edit(made)
    assert made.scenario == before[0]
    assert same(made.state(3).placement, before[1])


@pytest.mark.parametrize(
    ("edits", "match"),
    [
        ([Despawn(3, "x")], r"edits\[0\]: no object 'x' exists before this edit"),
        ([Despawn(3, "a"), Move(3, "a", (0, 0, 0))], r"edits\[1\]: the object 'a' is not alive at frame 3"),
        ([Spawn(2, ts.Object("a", "Cube", first_frame=2))], "not reused"),
        (["spawn"], "must be a Spawn, Despawn, Move, PlaceCamera or SetFrustumWalls"),
        (3, "edits=3"),
    ],
)
def test_logs_that_contradict_themselves(edits, match):
    with pytest.raises(ScenarioError, match=match):
        ts.Scenario("room", [ts.Object("a", "Cube")], edits=edits)


def test_frames_may_be_numbers_of_numpy():
    """And are written to a file all the same."""
    edits = [Move(np.int64(3), "a", (0, 0, 0)), Despawn(np.uint8(4), "a")]
    scenario = ts.Scenario("room", [ts.Object("a", "Cube", scale=np.float32(2))], edits=edits)
    assert [edit["frame"] for edit in scenario.to_json()["edits"]] == [3, 4]
    assert scenario.objects[0].scale == (2.0, 2.0, 2.0)
    assert ts.Scenario.from_json(json.loads(json.dumps(scenario.to_json()))) == scenario


def test_edits_check_their_values():
    with pytest.raises(ScenarioError, match="first_frame is 3"):
        Spawn(3, ts.Object("a", "Cube"))
    with pytest.raises(ScenarioError, match="frame=-1"):
        Despawn(-1, "a")
    with pytest.raises(ScenarioError, match=r"frame=1\.0"):
        Move(1.0, "a", (0, 0, 0))
    for edit in (Despawn, lambda frame, id: Move(frame, id, (0, 0, 0))):
        for id in (5, "", None):
            with pytest.raises(ScenarioError, match=f"id={id!r}: must be a string"):
                edit(3, id)
    with pytest.raises(ScenarioError, match="aspect=0: must be greater"):
        SetFrustumWalls(3, None, ts.Camera(), 0)
    with pytest.raises(ScenarioError, match="frustum=3: must be a Frustum or None"):
        SetFrustumWalls(3, 3, ts.Camera(), 1)
    with pytest.raises(ScenarioError, match="object: must be an Object whose first_frame is 3"):
        Spawn(3, type("Fake", (), {"first_frame": 3})())


def test_a_thing_that_is_not_there_has_a_nearest_one():
    books = tuple(replace(STAGE.objects[0], prim_path=f"/Room/Book{number}") for number in range(30))
    instances = tuple(replace(STAGE.instances[0], object=number) for number in range(30))
    made = world(ts.Scenario("room"), replace(STAGE, objects=books, instances=instances))
    with pytest.raises(ObjectNotFound, match=r"no object '/Room/Bok7' at frame 0\. Did you mean '/Room/Book7'\?"):
        made.despawn("/Room/Bok7")
