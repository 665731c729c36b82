# SPDX-License-Identifier: Apache-2.0
"""SAILenv's scenario classes, their JSON, and its conversion to tiscene's objects."""

import json

import numpy as np
import pytest

import dynamics
import tiscene
from tiscene import sailenv
from tiscene.errors import ScenarioError
from tiscene.sailenv import (
    AllTogetherTimings,
    CatmullWaypoints,
    DictTimings,
    Frustum,
    LinearWaypoints,
    Object,
    Scenario,
    UniformMovementRandomBounce,
    Vector3,
    WaitUntilCompleteTimings,
    Waypoint,
    json_messages,
)

ZERO = {"x": 0.0, "y": 0.0, "z": 0.0}


def test_vector3_arithmetic_and_indexing():
    v = Vector3(1, 2, 3)
    assert [v[0], v[1], v[2]] == [1, 2, 3]
    assert v + Vector3(1, 1, 1) == Vector3(2, 3, 4)
    assert v + (0, 0, 1) == Vector3(1, 2, 4)  # noqa: RUF005
    assert v + 1 == Vector3(2, 3, 4)
    assert v * 2 == 2 * v == Vector3(2, 4, 6)
    assert v * Vector3(4, 5, 6) == 32
    assert Vector3.from_tuple((7, 8, 9)) == Vector3(7, 8, 9)
    assert tuple(v) == (1, 2, 3)
    with pytest.raises(IndexError):
        v[3]


def test_every_public_name_exists_and_is_documented():
    for name in sailenv.__all__:
        assert getattr(sailenv, name).__doc__
    with pytest.raises(AttributeError, match="Agnet"):
        sailenv.Agnet  # noqa: B018


def test_defaults_and_order_of_arguments_are_those_of_sailenv():
    assert UniformMovementRandomBounce((1, 0, 0), 0.5, 1.0, 7) == UniformMovementRandomBounce(
        start_direction=(1, 0, 0), speed=0.5, angular_speed=1.0, seed=7
    )
    bounce = UniformMovementRandomBounce()
    assert (bounce.start_direction, bounce.speed, bounce.angular_speed, bounce.seed) == (Vector3(0, 0, 1), 5, 2, 42)
    assert CatmullWaypoints([]).total_time == LinearWaypoints([]).total_time == 10.0
    assert Waypoint() == Waypoint(Vector3(0, 0, 0), Vector3(0, 0, 0))
    assert AllTogetherTimings().wait_time == 1.0
    assert DictTimings().times == {}
    assert (Frustum().spawn, Frustum().far_clip_plane) == (True, 15.0)
    scenario = Scenario("object_view/scene", [Object("a", "Cube", Vector3(0, 0, 0), Vector3(0, 0, 0))])
    assert (scenario.n_objects, scenario.objects[0].dynamic, scenario.objects[0].frustum_limited) == (1, None, True)
    assert scenario.frustum == Frustum.default_frustum() == Frustum(False, -1)


def test_asdict_of_a_scenario_is_sailenvs_json():
    scenario = Scenario(
        "room_02/scene",
        [
            Object("a", "Cube", Vector3(1, 2, 3), (0, 0, 0), LinearWaypoints([Waypoint(Vector3(1, 2, 3))], 4.0)),
            Object("b", "Dish 01", np.ones(3), Vector3(0, 0, 0), UniformMovementRandomBounce(seed=np.int64(3)), False),
        ],
        DictTimings({0: 10.0, "b": 5.0}),
        Frustum(True, 2.5),
    )
    content = json.loads(json.dumps(scenario.asdict()))
    assert content == {
        "scene_name": "room_02/scene",
        "objects": [
            {
                "id": "a",
                "prefab": "Cube",
                "position": {"x": 1, "y": 2, "z": 3},
                "rotation": [0, 0, 0],
                "dynamic": {
                    "type": "linear_waypoints",
                    "description": {
                        "waypoints": [{"position": {"x": 1, "y": 2, "z": 3}, "rotation": ZERO}],
                        "total_time": 4.0,
                    },
                },
                "frustum_limited": True,
            },
            {
                "id": "b",
                "prefab": "Dish 01",
                "position": [1.0, 1.0, 1.0],
                "rotation": ZERO,
                "dynamic": {
                    "type": "uniform_movement_random_bounce",
                    "description": {
                        "start_direction": {"x": 0.0, "y": 0.0, "z": 1.0},
                        "speed": 5.0,
                        "angular_speed": 2.0,
                        "seed": 3,
                    },
                },
                "frustum_limited": False,
            },
        ],
        "timings": {"type": "dict", "description": {"times": {"0": 10.0, "b": 5.0}}},
        "frustum": {"spawn": True, "far_clip_plane": 2.5},
    }


def test_objects_are_converted_to_tiscenes_space():
    waypoints = [Waypoint(Vector3(1, 2, 3), Vector3(10, 20, 30)), Waypoint((0, 0, 0))]
    made = json_messages.object_of(
        Object("a", "Cube", Vector3(1, 2, 3), Vector3(10, 20, 30), CatmullWaypoints(waypoints)).asdict(), "a"
    )
    assert (made.position, made.rotation) == ((1, 2, -3), (-10, -20, 30))
    assert made.dynamic == dynamics.CatmullWaypoints(
        [dynamics.Waypoint((1, 2, -3), (-10, -20, 30)), dynamics.Waypoint((0, 0, 0))]
    )
    bounce = json_messages.dynamic_of("uniform_movement_random_bounce", {"start_direction": [0, 5, 2], "speed": 0.5})
    assert bounce == dynamics.UniformMovementRandomBounce(0.5, 2.0, (0.0, 5.0, -2.0), 42)
    single = json_messages.dynamic_of("linear_waypoints", {"waypoints": [{"position": [1, 2, 3]}]})
    assert len(single.waypoints) == 2


def test_timings_and_frustum_are_converted():
    ids = ["a", "b", "c"]
    assert json_messages.timings_of(AllTogetherTimings(0.75).todict(), ids, ids) == tiscene.AllTogether(0.75)
    assert json_messages.timings_of(WaitUntilCompleteTimings(1.5).todict(), ids, ids) == tiscene.WaitUntilComplete(1.5)
    # Keys are text, as in JSON. Object c is invalid, and 7, z and -1 name no object.
    times = {"1": 5.0, "a": 2.0, "2": 1.0, "7": 1.0, "z": 1.0, "-1": 1.0}
    made = json_messages.timings_of({"type": "dict", "description": {"times": times}}, ids, {"a", "b"})
    assert made == tiscene.DictTimings({"b": 5.0, "a": 2.0})
    assert json_messages.timings_of(None, ids, ids) == tiscene.AllTogether(0.0)
    assert json_messages.frustum_of(Frustum(True, 2.5).asdict()) == tiscene.Frustum(2.5)
    assert json_messages.frustum_of(Frustum(True, -1).asdict()) == json_messages.frustum_of(True) == tiscene.Frustum()
    assert json_messages.frustum_of(Frustum(False).asdict()) is json_messages.frustum_of(False) is None


@pytest.mark.parametrize(
    "content",
    [
        {"position": [1, 2]},
        {"position": {"x": 1}},
        {"position": ["a", 2, 3]},
        {"position": [1, 2, float("nan")]},
        {"position": [1e300, 0, 0]},
        {"dynamic": {"type": "linear_waypoints", "description": {"waypoints": [{"position": [1e300, 0, 0]}]}}},
        {"dynamic": {"type": "teleport"}},
        {"dynamic": {"type": "linear_waypoints", "description": {}}},
        {"dynamic": {"type": "linear_waypoints", "description": {"waypoints": [], "total_time": 1}}},
        {"dynamic": {"type": "catmull_waypoints", "description": {"waypoints": [3]}}},
        {"dynamic": {"type": "uniform_movement_random_bounce", "description": {"speed": "fast"}}},
        {"dynamic": 5},
        {"dynamic": {"type": "linear_waypoints", "description": 5}},
    ],
)
def test_invalid_object_raises_scenario_error(content):
    with pytest.raises(ScenarioError):
        json_messages.object_of({"prefab": "Cube"} | content, "a")


@pytest.mark.parametrize(
    ("kind", "description", "message"),
    [
        ("catmull_waypoints", {}, "dynamic of type catmull_waypoints: waypoints=None: must be a list of waypoints"),
        ("linear_waypoints", {"waypoints": [3]}, r"waypoints=\[3\]: must be a list of waypoints"),
        ("linear_waypoints", {"waypoints": [{}], "total_time": "long"}, "total_time='long': must be a number"),
        ("uniform_movement_random_bounce", {"speed": [1]}, r"random_bounce: speed=\[1\]: must be a number"),
        ("uniform_movement_random_bounce", {"seed": "x"}, "random_bounce: seed='x': must be an integer"),
    ],
)
def test_invalid_dynamics_name_the_value(kind, description, message):
    with pytest.raises(ScenarioError, match=message):
        json_messages.dynamic_of(kind, description)


@pytest.mark.parametrize(
    "content",
    [
        {"type": "never"},
        {"type": "all_together", "description": {"wait_time": "soon"}},
        {"type": "dict", "description": {"times": {"7": 1.0}}},
        {"type": "dict", "description": {"times": {}}},
        5,
        {"type": "dict", "description": {"times": 5}},
    ],
)
def test_invalid_timings_raise_scenario_error(content):
    with pytest.raises(ScenarioError):
        json_messages.timings_of(content, ["a"], ["a"])


def test_names_of_many_objects_with_one_id_are_made_quickly():
    names = json_messages.object_names([{"id": "a"}] * 10_000)  # took minutes
    assert names[:2] == ["a", "a (2)"]
    assert names[-1] == "a (10000)"
    assert json_messages.object_names([{"id": "a (2)"}, {"id": "a"}, {"id": "a"}]) == ["a (2)", "a", "a (3)"]


def test_scenario_with_too_many_objects_is_refused():
    with pytest.raises(ScenarioError, match="objects: there are 10001; the limit is 10000"):
        json_messages.scenario_of({"objects": [{}] * 10_001}, "object_view", lambda name: pytest.fail(name))


def test_object_names_are_unique():
    assert json_messages.object_names([{"id": "a"}, {"id": "a"}, {"id": 3}, {}]) == ["a", "a (2)", "3", "object_3"]
