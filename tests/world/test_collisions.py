# SPDX-License-Identifier: Apache-2.0
"""Objects that collide in a world: with the stage, each other and the frustum; and what the world says of it."""

import numpy as np
import pytest

import tiscene as ts
from dynamics import SteppedSimulation
from tests.dynamics.solids import box
from tests.reference.distance import point_triangle
from tiscene.errors import ScenarioError
from tiscene.frame.events import Event
from tiscene.scene.description import Collider, Instance, Mesh, SceneDescription, SceneObject, Template
from tiscene.world.world import World
from tiscene.world.world_state import CameraStep

ROOM = box((6.0, 4.0, 6.0))[:, ::-1]  # it faces inwards
PILLAR = box((0.5, 4.0, 0.5), (1.5, 0.0, 0.0))
CUBE = box((0.3, 0.3, 0.3))


def mesh(triangles: np.ndarray) -> Mesh:
    rows = np.arange(3 * len(triangles), dtype=np.int32).reshape(-1, 3)
    return Mesh("m", triangles.reshape(-1, 3).astype(np.float32), rows, np.zeros(len(triangles), np.int32))


def at(x: float, y: float, z: float) -> np.ndarray:
    """Return a translation, 4x4."""
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


STAGE = SceneDescription(
    "room",
    (mesh(PILLAR), mesh(ROOM)),
    instances=(Instance(1, 1, np.eye(4)), Instance(0, 0, np.eye(4))),
    objects=(SceneObject("Pillar", "/Pillar", "pillar"), SceneObject("Walls", "/Walls", "wall")),
)
EMPTY = SceneDescription("nothing")
TEMPLATE = Template("Cube", "toy", SceneDescription("Cube", (mesh(CUBE),), instances=(Instance(0, 0, np.eye(4)),)))


def world(*objects: ts.Object, stage: SceneDescription = STAGE, **others: object) -> World:
    return World(ts.Scenario("room", objects, **others), stage, lambda name: TEMPLATE, 25.0)


def bouncer(name: str = "b", **others: object) -> ts.Object:
    values = {"position": (0.0, 0.0, 0.0), "speed": 1.5, "start_direction": (1, 0, 0)} | others
    fields = {key: values.pop(key) for key in ("speed", "start_direction", "angular_speed", "seed") if key in values}
    return ts.Object(name, "Cube", dynamic=ts.UniformMovementRandomBounce(**fields), **values)


def path(*stations: tuple[float, float, float], time: float = 4.0) -> ts.LinearWaypoints:
    return ts.LinearWaypoints([ts.Waypoint(station) for station in stations], total_time=time)


def detour(time: float) -> ts.Keyframes:
    """Return a loop that crosses the pillar's place and comes back within one second, and rests otherwise."""
    here, there = ts.Waypoint((0, 0, 0)), ts.Waypoint((2.5, 0, 0))
    return ts.Keyframes((0, 0.3 * time, 0.3 * time + 0.5, 0.3 * time + 1, time), (here, here, there, here, here), True)


def poses(made: World, frames: range | list[int]) -> np.ndarray:
    return np.array(
        [[(*row.position, *row.rotation) for row in made.state(k).objects if not row.prim_path] for k in frames]
    )


def is_stepped(made: World) -> bool:
    made.state(0)
    return isinstance(made.trajectories.stepped, SteppedSimulation)


def test_a_bouncing_object_stays_out_of_the_stage_and_says_what_it_met():
    made = world(bouncer())
    everything = np.concatenate([ROOM, PILLAR])
    for k in range(0, 250, 5):
        placed = made.state(k).placement
        matrix = placed.world_from_object[1, -1]
        corners = CUBE.reshape(-1, 3) @ matrix[:, :3].T + matrix[:, 3]
        assert point_triangle(corners, everything).min() > 0.0
        assert (np.abs(corners) < (3.0, 2.0, 3.0)).all()
    met = [event for k in range(250) for event in made.state(k).events() if event.kind not in ("enter", "leave")]
    assert met[0] == Event("spawn", 3)
    assert met[1] == Event("contact", 3, other=1), "the pillar comes first"
    assert {event.other for event in met[1:]} == {1, 2}
    assert made.state(0).objects[0].name == "Pillar"


def test_what_nobody_sees_is_in_the_way_and_in_no_picture():
    """The pillar as a collider alone: of no thing, then of the walls."""
    for owner, met in ((-1, {"other": 0, "surface": "/Pillar"}), (0, {"other": 1})):
        stage = SceneDescription(
            "room",
            STAGE.meshes,
            instances=(Instance(1, 0, np.eye(4)),),
            objects=STAGE.objects[1:],
            colliders=(Collider(0, owner, np.eye(4), prim_path="/Pillar"),),
        )
        made = world(bouncer(), stage=stage)
        np.testing.assert_array_equal(poses(made, range(60)), poses(world(bouncer()), range(60)))
        first = next(event for k in range(60) for event in made.state(k).events() if event.kind == "contact")
        assert first == Event("contact", 2, **met)
        assert made.state(0).placement.mesh.tolist() == [1, 2]


def test_a_template_collides_by_its_colliders():
    whole = mesh(box((1.0, 1.0, 1.0))), mesh(CUBE)
    drawn = Instance(0, 0, np.eye(4), collides=False)
    for colliders, reach in (((Collider(1, 0, np.eye(4)),), 0.3), ((), 0.9)):
        description = SceneDescription("Cube", whole, instances=(drawn,), colliders=colliders)
        made = World(
            ts.Scenario("room", [bouncer()]), STAGE, lambda name, it=description: Template("Cube", "toy", it), 25.0
        )
        assert is_stepped(made)
        assert made.trajectories.stepped.movers[0].shape.reach == pytest.approx(reach, rel=0.15)


def test_frames_are_a_function_of_their_number():
    objects = [bouncer("a"), bouncer("b", position=(-1, 0, 0), start_direction=(0, 1, 0.3))]
    straight = poses(world(*objects), range(60))
    made = world(*objects)
    for k in (50, 3, 51, 20):
        assert poses(made, [k])[0].tobytes() == straight[k].tobytes()
    placement = world(*objects).state(50).placement
    np.testing.assert_array_equal(placement.world_from_object[0, -1, :, 3], straight[49, 1, :3])
    np.testing.assert_array_equal(placement.world_from_object[2, -1, :, 3], straight[51, 1, :3])


def test_a_follower_is_held_up_and_returns():
    made = world(ts.Object("f", "Cube", dynamic=path((-1, 0, 0), (1.6, 0, 0.1))))
    free = world(ts.Object("f", "Cube", dynamic=path((-1, 0, 0), (1.6, 0, 0.1)), collide=False))
    blocked = [made.state(k).objects[-1].blocked for k in range(100)]
    assert is_stepped(made)
    assert not is_stepped(free)
    assert True in blocked[30:60]
    same = [made.state(k).objects[-1].position == free.state(k).objects[-1].position for k in range(100)]
    assert same[:20] == [True] * 20
    assert not all(same)
    assert same[99], "back on its path"
    assert Event("contact", 3, 1) in [event for k in range(40, 55) for event in made.state(k).events()]


@pytest.mark.parametrize(
    ("objects", "stage", "frustum", "stepped"),
    [
        ([ts.Object("f", "Cube", dynamic=path((-1, 0, 0), (0, 0, 1)))], STAGE, None, False),
        ([ts.Object("f", "Cube", dynamic=path((-1, 0, 0), (1.6, 0, 0.4)))], STAGE, None, True),
        ([ts.Object("f", "Cube", dynamic=path((-1, 0, 0), (1.6, 0, 1)))], EMPTY, None, False),
        ([ts.Object("f", "Cube", dynamic=path((-1, 0, 0), (1.6, 0, 1)))], EMPTY, ts.Frustum(), True),
        ([ts.Object("f", "Cube", dynamic=path((-1, 0, 0), (1, 0, 1)), frustum_limited=False)], EMPTY, ts.Frustum(),
         False),
        ([ts.Object("f", "Cube", dynamic=path((-1, 0, 0), (1, 0, 1))), ts.Object("s", "Cube")], EMPTY, None, True),
        ([ts.Object("f", "Cube", dynamic=path((-1, 0, 0), (1, 0, 1))), ts.Object("s", "Cube", collide=False)], EMPTY,
         None, False),
        ([ts.Object("f", "Cube", dynamic=path((5, 0, 0), (9, 0, 1))), ts.Object("s", "Cube")], EMPTY, None, False),
        ([ts.Object("s", "Cube", (1.5, 0, 0)), ts.Object("t", "Cube", (1.5, 0, 0))], STAGE, None, False),
        ([bouncer(collide=False)], EMPTY, None, True),
        ([ts.Object("f", "Cube", dynamic=detour(4.0))], STAGE, None, True),
        ([ts.Object("f", "Cube", dynamic=detour(100.0))], STAGE, None, True),
        ([ts.Object("f", "Cube", dynamic=detour(100.0)), ts.Object("s", "Cube", (1.5, 0, 0))], EMPTY, None, True),
        ([ts.Object("f", "Cube", dynamic=detour(100.0)), ts.Object("s", "Cube", (1.5, 1, 0))], EMPTY, None, False),
        ([ts.Object("f", "Cube", dynamic=path(*[(-1, 0, 0), (2.5, 0, 0)] * 64))], STAGE, None, True),
        ([ts.Object("f", "Cube", dynamic=ts.Keyframes((0, 1), (ts.Waypoint((0, 0, 0)), ts.Waypoint((0, 0, 1)))))],
         STAGE, None, False),
    ],
)  # fmt: skip
def test_only_what_can_meet_something_is_stepped(objects, stage, frustum, stepped):
    made = world(*objects, stage=stage, frustum=frustum)
    assert is_stepped(made) is stepped
    # A frame that is far away costs nothing then.
    if not stepped:
        made.state(10**7)


def test_move_before_later_edits_that_are_considered_already_is_shown():
    made = world(ts.Object("a", "Cube", dynamic=path((-1, 0, 0), (1, 0, 0))), stage=EMPTY)
    made.next_frame = 8
    made.spawn("Cube", (0, 9, 0))
    made.state(10)
    made.next_frame = 5
    made.move("a", (3, 3, 3))
    assert made.state(5).objects[0].position == (3, 3, 3)


WALLS = ts.Frustum(6.0), ts.Camera((0, 0, 3), vertical_fov=0.6), 1.0  # they hold an object at the origin below 0.93 m
RISES = path((0, 0, 0), (0, 9, 0), time=2.0)


def test_object_is_held_by_walls_of_an_earlier_edit_though_they_are_known_to_vanish():
    made = world(stage=EMPTY)
    made.next_frame = 10
    made.set_frustum_walls(*WALLS)
    made.next_frame = 20
    made.set_frustum_walls(None)
    made.state(25)
    made.next_frame = 15
    made.spawn("Cube", dynamic=RISES)
    assert poses(made, range(15, 20))[:, 0, 1].max() < 0.93


def test_walls_hold_a_limited_object_beside_one_that_is_not():
    made = world(
        ts.Object("f", "Cube", dynamic=RISES), ts.Object("s", "Cube", (9, 0, 0), frustum_limited=False), stage=EMPTY
    )
    made.set_frustum_walls(*WALLS)
    assert poses(made, range(25))[:, 0, 1].max() < 0.93


def test_object_of_the_stage_that_is_moved_onto_a_path_is_in_the_way():
    made = world(ts.Object("f", "Cube", dynamic=path((-2, 0, 0), (0, 0, 0))))
    assert not is_stepped(made)
    made.next_frame = 5
    made.move("/Pillar", (-2.5, 0, 0))  # from x = 1.5 to x = -1
    assert Event("contact", 3, other=1) in [event for k in range(40) for event in made.state(k).events()]


def test_the_frustum_holds_objects_and_moves_with_the_camera():
    turning = ts.Camera((0, 0, 0), vertical_fov=1.0, near=0.5, dynamic=ts.Orbit((0, 0, 0), period=20.0))
    objects = [
        bouncer("b", position=(0.0, 0.0, -3.0), speed=0.8),
        ts.Object("s", "Cube", (0.5, 0.2, -3.0)),
        ts.Object("outside", "Cube", (0.0, 6.0, -3.0)),
        ts.Object("free", "Cube", (0.0, 9.0, -3.0), frustum_limited=False),
    ]
    made = world(*objects, stage=EMPTY, camera=turning, frustum=ts.Frustum(6.0))
    for k in range(0, 200, 4):
        planes = made.state(k).cameras[0].current.frustum_planes(4 / 3, 6.0)
        placed = made.state(k).placement.world_from_object[1]
        for row, matrix in enumerate(placed[:3]):
            corners = CUBE.reshape(-1, 3) @ matrix[:, :3].T + matrix[:, 3]
            if row < 2 or k > 75:
                assert (corners @ planes[:, :3].T + planes[:, 3]).min() > 0.0, f"object {row} at frame {k}"
        np.testing.assert_array_equal(placed[3][:, 3], (0.0, 9.0, -3.0))
    walls = {event.surface for k in range(200) for event in made.state(k).events() if event.kind == "contact"}
    assert "left" in walls or "right" in walls


def test_events_of_life_spans():
    made = world(ts.Object("a", "Cube", (-1, 0, 0), first_frame=3, last_frame=5))
    happened = {k: made.state(k).events() for k in range(8)}
    assert happened.pop(3) == (Event("spawn", 3), Event("enter", 3))
    assert happened.pop(6) == (Event("despawn", 3), Event("leave", 3))
    assert not any(happened.values())


def test_bouncing_scenarios_are_written_and_read(tmp_path):
    scenario = ts.Scenario("room", [bouncer("a", seed=7, angular_speed=0.5)], timings=ts.AllTogether(0.75))
    scenario.save(tmp_path / "run.json")
    assert ts.Scenario.load(tmp_path / "run.json") == scenario
    with pytest.raises(ScenarioError, match="never returns"):
        ts.Scenario("room", [bouncer()], timings=ts.WaitUntilComplete(1.0))


def test_shapes_are_shared_by_template_and_scale():
    made = world(bouncer("a"), bouncer("b", position=(-1, 0, 0)), bouncer("c", position=(-1, 1, 0), scale=2.0))
    assert is_stepped(made)
    movers = made.trajectories.movers
    first, second, third = (mover.shape for mover in movers)
    assert len(movers._shapes) == 2
    assert first is second
    assert third.reach > 1.5 * first.reach


def test_what_enters_and_leaves_the_view():
    """A cube crosses the view of a camera that looks along -z; one comes and goes in view, one is behind the camera."""
    camera = ts.Camera((0, 0, 0), vertical_fov=np.pi / 2)
    objects = [
        ts.Object("crosses", "Cube", dynamic=ts.Keyframes((0, 4), (ts.Waypoint((-6, 0, -3)), ts.Waypoint((6, 0, -3))))),
        ts.Object("short", "Cube", (0, 1, -3), first_frame=10, last_frame=19),
        ts.Object("behind", "Cube", (0, 0, 3)),
    ]
    made = World(ts.Scenario("room", objects, camera=camera), EMPTY, lambda name: TEMPLATE, 25.0, aspect=1.0)
    seen = {kind: [] for kind in ("enter", "leave")}
    for k in range(101):
        for event in made.state(k).events():
            if event.kind in seen:
                seen[event.kind].append((k, event.object))
    # Its near corners lie 2.85 m, its far ones 3.15 m before the camera, which sees as far to the sides.
    enters, leaves = (round((6 + x) / 3 * 25 + 0.5) for x in (-3.15 - 0.15, 3.15 + 0.15))
    assert seen["enter"] == [(10, 2), (enters, 1)]
    assert seen["leave"] == [(20, 2), (leaves, 1)]
    assert made.state(enters).events() == made.state(enters).events(), "a function of the frame"
    # Another camera has events of its own.
    back = ts.Camera((0, 0, 0), (0, 0, 1, 0), vertical_fov=np.pi / 2)
    assert Event("enter", 3) in made.state(0).events(CameraStep(back, back, back), 1.0)
    assert Event("enter", 3) not in made.state(0).events()


def test_a_camera_that_turns_sees_the_stage_come_and_go():
    turning = ts.Camera((0, 0, 0), vertical_fov=0.8, dynamic=ts.Orbit((0, 0, 0), period=4.0))
    made = world(camera=turning)
    events = [(event.kind, event.object) for k in range(100) for event in made.state(k).events()]
    assert ("enter", 1) in events
    assert ("leave", 1) in events
    assert not [event for event in events if event[1] == 2], "the walls are around it, in every view"
