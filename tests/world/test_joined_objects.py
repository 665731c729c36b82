# SPDX-License-Identifier: Apache-2.0
"""Joints of scenarios: validation, JSON, and streams of what hangs on them."""

import math

import numpy as np
import pytest

pytest.importorskip("mujoco")

from scipy.special import ellipk

import tiscene as ts
from tests.usd.helpers import write
from tiscene.errors import StageWarning
from tiscene.scenario.edits import Move, Spawn

BUFFERS = ("instance", "depth")
FALL = 60.0  # degrees from the lowest point


def pendulum(**named):
    """Return a ball that hangs on a point of the world, 0.6 m above its center."""
    turned = math.radians(FALL)
    at = (0.6 * math.sin(turned), 1.6 - 0.6 * math.cos(turned), -2.0)
    ball = ts.Object("ball", "Sphere", at, (0, 0, FALL), scale=0.25)
    joint = ts.RevoluteJoint("ball", position=(0, 0.6, 0), axis="Z", parent_rotation=(0, 0, 0))
    return ts.Scenario("object_view", [ball], physics=True, joints=[joint], **named)


def stream_of(scenario):
    return ts.Stream(scenario, width=24, height=18, buffers=BUFFERS, fps=100)


def angle(stream, frame):
    x, y, _ = next(row.position for row in stream[frame].objects if row.name == "ball")
    return math.atan2(x, 1.6 - y)


def test_pendulum_of_a_scenario_has_its_period():
    stream = stream_of(pendulum())
    radius = 0.5 * 0.25 * 0.4  # of the template, scaled; see `tiscene show`
    length = 0.6 + 0.4 * radius**2 / 0.6
    period = 4.0 * math.sqrt(length / 9.81) * ellipk(math.sin(math.radians(FALL / 2)) ** 2)
    at = period * 3 * 100
    low, high = math.floor(at), math.ceil(at)
    assert angle(stream, low) == pytest.approx(math.radians(FALL), abs=2e-3)
    assert angle(stream, high) == pytest.approx(math.radians(FALL), abs=2e-3)
    assert angle(stream, round(at / 2)) == pytest.approx(-math.radians(FALL), abs=2e-3)  # half a period off


def test_seek_returns_the_frames_of_playing_in_another_stream():
    played, sought = stream_of(pendulum()), stream_of(ts.Scenario.from_json(pendulum().to_json()))
    frames = [played[frame] for frame in range(20)]
    for frame in (19, 4, 18):
        for name in BUFFERS:
            assert sought[frame][name].tobytes() == frames[frame][name].tobytes()


def test_object_hangs_on_one_that_moves_along_a_path():
    """A cube on a rope is drawn along by its end."""
    path = ts.LinearWaypoints([ts.Waypoint((-1, 2, -2)), ts.Waypoint((1, 2, -2))], total_time=4.0)
    objects = [
        ts.Object("hook", "Cube", dynamic=path, scale=0.1, collide=False),
        ts.Object("load", "Cube", (-1.0, 1.4, -2.0), scale=0.5, collide=False),
    ]
    joint = ts.SphericalJoint("load", "hook", position=(0, 0.6, 0))
    stream = ts.Stream(ts.Scenario("object_view", objects, physics=True, joints=[joint]), width=8, height=6)
    for frame in (1, 20, 45):
        hook, load = (next(r for r in stream.world.state(frame).objects if r.name == n) for n in ("hook", "load"))
        assert np.linalg.norm(np.subtract(hook.position, load.position)) == pytest.approx(0.6, abs=1e-6)
    assert load.position[0] > -0.6


def test_joint_is_that_of_a_replay_after_its_holder_is_moved_at_the_start():
    """It does not depend on whether a frame was simulated before the edit."""
    objects = [
        ts.Object("hook", "Cube", scale=0.1, collide=False, dynamic=ts.Orbit((0, 2, -2), period=3.0)),
        ts.Object("load", "Cube", (0.0, -0.6, 0.0), scale=0.5, collide=False),
    ]
    joint = ts.SphericalJoint("load", "hook", position=(0, 0.6, 0))
    stream = stream_of(ts.Scenario("object_view", objects, physics=True, joints=[joint]))
    stream.world.state(3)
    stream.world.move("hook", (0.5, 0.0, 0.0))
    replay = stream_of(stream.scenario)
    for frame in (1, 5):
        (here, there) = (each.world.state(frame).objects[-1] for each in (stream, replay))
        assert (here.name, here.position) == ("load", there.position)


def test_move_of_a_joined_object_shows_closed_joints_at_once():
    """At the frame of the move it was torn off its joint, and what hangs on it stayed behind."""
    objects = [
        ts.Object("hook", "Cube", (0, 2.5, -3), scale=0.2, dynamic=ts.Still(), collide=False),
        ts.Object("a", "Cube", (0, 2, -3), scale=0.3),
        ts.Object("b", "Cube", (0, 1.5, -3), scale=0.3),
    ]
    joints = [
        ts.SphericalJoint("a", "hook", position=(0, 0.5, 0)),
        ts.SphericalJoint("b", "a", position=(0, 0.5, 0)),
    ]
    stream = stream_of(ts.Scenario("object_view", objects, physics=True, joints=joints))
    stream.world.next_frame = 5
    stream.world.move("a", (1, 2.5, -3), (0, 0, 90))

    def places(frame):
        rows = {row.name: row.position for row in stream.world.state(frame).objects}
        return [*rows["a"], *rows["b"]]

    assert places(4) == pytest.approx([0, 2, -3, 0, 1.5, -3], abs=1e-6)
    turned = [0.5, 2.5, -3, 1.0, 2.5, -3]  # about the hook, as one
    assert places(5) == pytest.approx(turned, abs=1e-6)
    stream.world.state(9)
    assert places(5) == pytest.approx(turned, abs=1e-6)
    stream.world.next_frame = 10
    stream.world.move("hook", (1, 3, -3))
    a = np.subtract(places(10)[:3], (1, 3, -3))
    assert np.linalg.norm(a) == pytest.approx(0.5, abs=1e-6)


@pytest.mark.parametrize("dynamic", [ts.Still(), ts.RigidBody()])
@pytest.mark.parametrize("frame", [0, 4])
def test_move_of_a_holder_takes_along_what_slides_on_it(frame, dynamic):
    """At the frame at which its joint begins, or another object appears, it stayed behind, beyond its limit."""
    objects = [
        ts.Object("rail", "Cube", (0, 2, -3), scale=0.2, dynamic=dynamic, collide=False),
        ts.Object("cart", "Cube", (0.5, 2, -3), scale=0.2, dynamic=ts.RigidBody(), collide=False),
    ]
    joint = ts.PrismaticJoint("cart", "rail", axis="Y", lower_limit=-0.3, upper_limit=0.3)
    other = ts.Object("other", "Cube", (5, 2, -3), dynamic=ts.RigidBody(), first_frame=frame)
    edits = [Spawn(frame, other), Move(frame, "rail", (1, 3, -3), (0, 0, 90))]
    stream = stream_of(ts.Scenario("object_view", objects, joints=[joint], edits=edits))

    def cart(number):
        rows = {row.name: np.array(row.position) for row in stream.world.state(number).objects}
        return rows["cart"] - rows["rail"]

    fallen = -0.5 * 9.81 * 0.04**2 if frame and dynamic == ts.Still() else 0.0
    turned = (-fallen, 0.5, 0.0)
    np.testing.assert_allclose(cart(frame), turned, atol=1e-4)
    np.testing.assert_allclose(cart(frame + 1), turned, atol=5e-3)


def test_despawning_one_of_two_joined_objects_frees_the_other():
    objects = [
        ts.Object("post", "Cube", (0, 2, -2), dynamic=ts.Still(), scale=0.1),
        ts.Object("load", "Cube", (0, 1, -2)),
    ]
    scenario = ts.Scenario("object_view", objects, physics=True, joints=[ts.FixedJoint("load", "post")])
    stream = stream_of(scenario)
    for _ in range(10):
        next(stream)
    stream.world.despawn("post")

    def height(frame):
        return next(row.position[1] for row in stream[frame].objects if row.name == "load")

    assert [height(frame) for frame in (3, 10)] == pytest.approx([1.0, 1.0], abs=1e-9)
    assert height(30) == pytest.approx(1.0 - 0.5 * 9.81 * 0.2**2, abs=1e-7)


def test_joint_begins_with_an_object_that_is_spawned_later():
    spawned = ts.Object("load", "Cube", (0.3, 1, -2), dynamic=ts.RigidBody(), first_frame=6)
    scenario = ts.Scenario("object_view", joints=[ts.FixedJoint("load")], edits=[Spawn(6, spawned)])
    stream = stream_of(scenario)
    for frame in (3, 6, 40):
        rows = [row for row in stream[frame].objects if row.name == "load"]
        assert [row.position for row in rows] == ([] if frame < 6 else [(0.3, 1.0, -2.0)])


JOINTS = [
    ts.FixedJoint("a", "b", (0, 1, 0), (0, 0, 10), (1, 2, 3), (1, 0, 0, 0), collide=True),
    ts.RevoluteJoint("a", axis="Y", lower_limit=-30, upper_limit=60.5),
    ts.PrismaticJoint("b", position=(0.1, 0.2, 0.3), upper_limit=2),
    ts.SphericalJoint("b", "c", parent_position=(0, 0, 1)),
    ts.DistanceJoint("c", "a", min_distance=0.5, max_distance=1.5),
]


def scenario_of(joints, **named):
    return ts.Scenario("object_view", [ts.Object(n, "Cube") for n in "abc"], joints=joints, physics=True, **named)


@pytest.mark.parametrize("joint", JOINTS)
def test_joints_are_the_same_after_a_round_trip_through_json(joint, tmp_path):
    scenario = scenario_of([joint])
    scenario.save(tmp_path / "run.json")
    assert ts.Scenario.load(tmp_path / "run.json") == scenario


@pytest.mark.parametrize(
    ("joints", "message"),
    [
        ([5], r"joints\[0\]=5: must be a joint"),
        ([ts.FixedJoint("x")], r"joints\[0\].body='x': there is no object"),
        ([ts.FixedJoint("a", "x")], r"joints\[0\].parent='x': there is no object"),
        ([ts.FixedJoint("d")], r"neither 'd' nor its parent is a rigid body"),
        ([ts.FixedJoint("a"), ts.RevoluteJoint("a", lower_limit=0)], r"joints\[1\]: its objects are connected already"),
        ("joint", "must be a sequence"),
    ],
)
def test_joints_that_cannot_work_are_errors(joints, message):
    objects = [ts.Object("a", "Cube"), ts.Object("d", "Cube", dynamic=ts.Still())]
    with pytest.raises(ts.TisceneError, match=message):
        ts.Scenario("object_view", objects, joints=joints, physics=True)


@pytest.mark.parametrize(
    "make",
    [
        lambda: ts.RevoluteJoint("a", "a"),
        lambda: ts.RevoluteJoint(""),
        lambda: ts.RevoluteJoint("a", axis="W"),
        lambda: ts.RevoluteJoint("a", lower_limit=2, upper_limit=1),
        lambda: ts.PrismaticJoint("a", lower_limit=math.nan),
        lambda: ts.SphericalJoint("a", position=(1, 2)),
        lambda: ts.DistanceJoint("a", min_distance=-1),
        lambda: ts.DistanceJoint("a", min_distance=2, max_distance=1),
        lambda: ts.DistanceJoint("a", max_distance=0),
        lambda: ts.FixedJoint("a", parent_rotation=(0, 0, 0, 0)),
        lambda: ts.FixedJoint("a", collide=1),
    ],
)
def test_invalid_joints_are_errors(make):
    with pytest.raises(ts.TisceneError):
        make()


def test_rigid_body_that_does_not_collide_falls_through_the_floor():
    ball = ts.Object("ball", "Sphere", (0, 1, 0), collide=False)
    stream = ts.Stream(ts.Scenario("solid_benchmark", [ball], physics=True), width=8, height=6, buffers=("depth",))
    (row,) = (each for each in stream[25].objects if each.name == "ball")
    assert row.position[1] == pytest.approx(1.0 - 0.5 * 9.81, abs=1e-9)


STAGE = """
def Xform "World" {{
    def Camera "Camera" {{
        double3 xformOp:translate = (0, 0, 500)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }}
    def DistantLight "Sun" {{}}
    def Sphere "Bob" (prepend apiSchemas = ["TisceneObjectAPI", "PhysicsRigidBodyAPI"]) {{
        double radius = 0.5
        double3 xformOp:translate = {start}
        double3 xformOp:scale = (10, 10, 10)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
    }}
    def PhysicsRevoluteJoint "Pivot" {{
        rel physics:body1 = </World/Bob>
        point3f physics:localPos0 = (0, 0, 0)
        point3f physics:localPos1 = {pivot}
        uniform token physics:axis = "X"
    }}
}}
"""


@pytest.mark.parametrize(
    ("up", "start", "pivot", "down"),
    [("Y", (0, 0, -80), (0, 0, 8), (0, -0.8, 0)), ("Z", (0, 80, 0), (0, -8, 0), (0, 0, -0.8))],
)
def test_pendulum_that_another_program_has_authored_on_a_stage_swings(tmp_path, up, start, pivot, down):
    """It starts at the height of its pivot; the pivot is given before the scale of the sphere, in centimeters."""
    path = write(tmp_path, STAGE.format(start=start, pivot=pivot), meters=0.01, up=up)
    stream = ts.Stream(path, width=8, height=6, buffers=("depth",), fps=100)
    quarter = math.sqrt((0.8 + 0.4 * 0.05**2 / 0.8) / 9.81) * ellipk(0.5) * 100
    low, high = (
        np.array(next(row.position for row in stream[frame].objects if row.name == "Bob"))
        for frame in (math.floor(quarter), math.ceil(quarter))
    )
    share = quarter - math.floor(quarter)
    np.testing.assert_allclose((1 - share) * low + share * high, down, atol=1e-3)
    assert np.linalg.norm(high - low) > 0.03


SHAPELESS = """
def Xform "Anchor" (prepend apiSchemas = ["TisceneObjectAPI", "PhysicsRigidBodyAPI"]) {}
def Cube "Box" (prepend apiSchemas = ["TisceneObjectAPI", "PhysicsRigidBodyAPI"]) {}
def PhysicsFixedJoint "Held" {
    rel physics:body0 = </Anchor>
    rel physics:body1 = </Box>
}
"""


def test_joint_of_a_rigid_body_without_a_shape_is_left_out_and_named(tmp_path):
    path = write(tmp_path, SHAPELESS)
    with pytest.warns(StageWarning) as caught:
        stream = ts.Stream(path, width=8, height=6, buffers=("instance",), fps=50)
    assert "joints are left out, of objects that have no shape: Anchor" in str(caught[-1].message)
    (box,) = stream.world.state(10).objects
    assert box.position[1] == pytest.approx(-0.5 * 9.81 * 0.2**2, abs=1e-9)
