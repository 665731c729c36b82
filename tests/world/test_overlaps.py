# SPDX-License-Identifier: Apache-2.0
"""Objects that appear inside of others, or inside of the stage, are reported as events."""

import numpy as np
import pytest

import tiscene as ts
from tests.dynamics.solids import box, quad
from tests.world.test_collisions import CUBE, mesh
from tiscene.frame.events import Event
from tiscene.scene.description import Collider, Instance, SceneDescription, SceneObject, Template
from tiscene.world.world import World

FLOOR, BLOCK, BEAM = 1, 2, 3  # ids of the stage's objects
STAGE = SceneDescription(
    "yard",
    (mesh(quad((0.0, 0.0, 0.0), (0.0, 0.0, 5.0), (5.0, 0.0, 0.0))), mesh(box((1.0, 1.0, 1.0)))),
    instances=(
        Instance(0, 0, np.eye(4)),
        Instance(1, 1, np.array([[1.0, 0, 0, 2], [0, 1, 0, 0.5], [0, 0, 1, 0], [0, 0, 0, 1]])),
        Instance(1, 2, np.array([[0.05, 0, 0, -2], [0, 0.05, 0, 1], [0, 0, 4, 0], [0, 0, 0, 1]])),
    ),
    objects=(
        SceneObject("Floor", "/Floor", "floor"),
        SceneObject("Block", "/Block", "block"),
        SceneObject("Beam", "/Beam", "beam"),
    ),
    colliders=(
        Collider(1, -1, np.array([[0.2, 0, 0, 0], [0, 0.2, 0, 3], [0, 0, 0.2, 0], [0, 0, 0, 1.0]]), prim_path="/Guide"),
    ),
)
TEMPLATES = {
    name: Template(name, "toy", SceneDescription(name, (mesh(surface),), instances=(Instance(0, 0, np.eye(4)),)))
    for name, surface in {"Cube": CUBE, "Crate": box((1.2, 1.2, 1.2)), "Pin": box((0.02, 2.0, 0.02))}.items()
}


def world(*objects: ts.Object, **others) -> World:
    return World(ts.Scenario("yard", objects, **others), STAGE, TEMPLATES.__getitem__, 25.0)


def overlaps(made: World, frame: int = 0) -> list[Event]:
    return [event for event in made.state(frame).events() if event.kind == "overlap"]


@pytest.mark.parametrize(
    ("template", "position", "expected"),
    [
        ("Cube", (0.0, 1.0, 0.0), []),
        ("Cube", (0.0, 0.15, 0.0), []),  # it stands on the floor
        ("Cube", (0.0, 0.147, 0.0), []),  # 3 mm deep
        ("Cube", (0.0, 0.14, 0.0), [(FLOOR, "")]),
        ("Cube", (0.0, -0.5, 0.0), []),  # below the floor, which is no solid
        ("Cube", (1.35, 0.15, 0.0), []),  # beside the block
        ("Cube", (1.45, 0.5, 0.0), [(BLOCK, "")]),
        ("Cube", (2.0, 0.5, 0.0), [(BLOCK, "")]),  # inside, without crossing its surface
        ("Cube", (2.0, 0.1, 0.0), [(FLOOR, ""), (BLOCK, "")]),
        ("Cube", (-2.0, 1.0, 1.0), [(BEAM, "")]),  # a beam through it, longer than it
        ("Crate", (0.0, 3.0, 0.0), [(0, "/Guide")]),  # a collider inside of it
        ("Pin", (0.0, 0.5, 0.0), [(FLOOR, "")]),
    ],
)
def test_object_in_the_stage_is_reported_at_its_first_frame(template, position, expected):
    made = world(ts.Object("a", template, position, first_frame=2))
    assert overlaps(made, 2) == [Event("overlap", 4, other, surface) for other, surface in expected]
    assert overlaps(made, 1) == overlaps(made, 3) == []


def test_objects_in_each_other_are_reported_of_both():
    made = world(
        ts.Object("a", "Cube", (0, 1, 0)), ts.Object("b", "Cube", (0.2, 1, 0)), ts.Object("c", "Cube", (0, 2, 0))
    )
    assert overlaps(made) == [Event("overlap", 4, 5), Event("overlap", 5, 4)]


def test_object_wholly_inside_of_another_is_reported():
    made = world(ts.Object("crate", "Crate", (0, 2, 0)))
    made.next_frame = 5
    inside = made.spawn("Cube", (0.1, 2.0, 0.0))
    assert overlaps(made, 5) == [Event("overlap", inside, 4)]
    made.next_frame = 9
    around = made.spawn("Crate", (3.0, 3.0, 3.0), scale=0.1)
    assert overlaps(made, 9) == []
    made.next_frame = 10
    outer = made.spawn("Crate", (3.0, 3.0, 3.0))
    assert overlaps(made, 10) == [Event("overlap", outer, around)]


def test_moved_object_is_reported_at_its_move_and_a_replay_agrees():
    made = world(ts.Object("a", "Cube", (0, 1, 0)))
    made.next_frame = 3
    made.move("a", (0.0, 0.0, 0.0))
    assert overlaps(made, 3) == [Event("overlap", 4, FLOOR)]
    made.next_frame = 4
    made.move("a", (0.0, 1.0, 0.0))
    assert overlaps(made, 4) == []
    replay = world(*made.scenario.objects, edits=made.scenario.edits)
    assert overlaps(replay, 3) == [Event("overlap", 4, FLOOR)]
    assert overlaps(replay, 4) == []


def test_edits_of_the_stage_count():
    made = world()
    made.next_frame = 2
    made.move("/Block", (-2.0, 0.5, 3.0))
    made.despawn("/Floor")
    gone = made.spawn("Cube", (2.0, 0.1, 0.0))
    met = made.spawn("Cube", (-2.0, 0.5, 3.0))
    assert overlaps(made, 2) == [Event("overlap", met, BLOCK)]
    assert gone < met


def test_scale_and_rotation_count():
    tall = ts.Object("a", "Cube", (1.2, 0.5, 0.0), (0, 0, 0), scale=(1.0, 1.0, 1.0))
    assert overlaps(world(tall)) == []
    assert overlaps(world(ts.Object("a", "Cube", (1.2, 0.5, 0.0), scale=(3.0, 1.0, 1.0)))) == [
        Event("overlap", 4, BLOCK)
    ]
    pin = {"position": (1.0, 0.5, 0.0), "template": "Pin"}
    assert overlaps(world(ts.Object("a", **pin, rotation=(0, 0, 90)))) == [Event("overlap", 4, BLOCK)]


def test_objects_that_do_not_collide_are_not_reported():
    through = ts.Object("a", "Cube", (0, 0, 0), collide=False)
    assert overlaps(world(through, ts.Object("b", "Cube", (0, 0.2, 0)))) == []


def test_room_that_holds_the_camera_is_no_solid():
    crate = ts.Object("a", "Cube", (2.0, 0.5, 0.0))
    inside = ts.Camera((2.0, 0.9, 0.3))
    assert overlaps(world(crate, camera=inside)) == []
    assert overlaps(world(crate, camera=ts.Camera((2.0, 0.9, 0.6)))) == [Event("overlap", 4, BLOCK)]
    path = ts.LinearWaypoints([ts.Waypoint(inside.position), ts.Waypoint((0.0, 5.0, 0.0))])
    assert overlaps(world(crate, camera=ts.Camera(dynamic=path))) == []


def test_overlap_follows_spawns_in_the_events_of_a_frame():
    made = world(ts.Object("a", "Cube"))
    assert made.state(0).events()[:2] == (Event("spawn", 4), Event("overlap", 4, FLOOR))
