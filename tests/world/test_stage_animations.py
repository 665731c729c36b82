# SPDX-License-Identifier: Apache-2.0
"""The world: objects of the stage that move by an animation of the stage."""

from dataclasses import replace

import numpy as np

from tests.world.small_stage import FLOOR, UNIT_CUBE, at, world
from tiscene.scene.animation import InstanceTrack
from tiscene.scene.description import Instance, SceneDescription, SceneObject


def test_what_moves_by_itself_may_stand_beside_things_without_a_mesh():
    """The cup, which comes first, has none."""
    moved = np.tile(np.eye(4)[:3], (2, 1, 1, 1))
    moved[1, 0, :, 3] = (1, 2, 3)
    track = InstanceTrack(np.array([1], np.int32), np.array([0.0, 1.0]), moved, np.ones((2, 1), bool))
    stage = SceneDescription(
        "room",
        (FLOOR, UNIT_CUBE),
        instances=(Instance(0, 1, at(5, 5, 5)), Instance(1, 2, np.eye(4))),
        objects=(SceneObject("Cup", "/Cup"), SceneObject("Floor", "/Floor"), SceneObject("Lift", "/Lift")),
        tracks=(track,),
        object_tracks=(replace(track, instances=np.array([2], np.int32)),),
    )
    rows = {row.name: row.position for row in world(stage=stage).state(5).objects}
    assert rows == {"Cup": (0.0, 0.0, 0.0), "Floor": (5.0, 5.0, 5.0), "Lift": (0.5, 1.0, 1.5)}


def test_moved_thing_with_an_animation_goes_on_from_its_new_place():
    moved = np.tile(np.eye(4)[:3], (2, 1, 1, 1))
    moved[1, 0, :, 3] = (1, 2, 3)
    track = InstanceTrack(np.array([0], np.int32), np.array([0.0, 1.0]), moved, np.ones((2, 1), bool))
    instances, objects = (Instance(0, 0, np.eye(4)),), (SceneObject("Lift", "/Lift"),)
    tracks = {"tracks": (track,), "object_tracks": (track,)}
    stage = SceneDescription("room", (UNIT_CUBE,), instances=instances, objects=objects, **tracks)
    made = world(stage=stage)
    made.next_frame = 5
    made.move("/Lift", (0, 0, 0), (0, 90, 0))
    for frame, position in ((4, (0.4, 0.8, 1.2)), (5, (0, 0, 0)), (6, (0.3, 0.2, -0.1)), (10, (1.5, 1, -0.5))):
        state = made.state(frame)
        np.testing.assert_allclose(state.objects[0].position, position, atol=1e-12)
        np.testing.assert_allclose(state.placement.world_from_object[1, 0, :, 3], position, atol=1e-12)
    np.testing.assert_allclose(made.state(5).objects[0].velocity, (3, 2, -1), atol=1e-12)


def test_thing_that_its_animation_hides_may_be_moved():
    matrices = np.tile(np.eye(4)[:3], (3, 1, 1, 1))
    track = InstanceTrack(np.array([0], np.int32), np.arange(3) * 0.5, matrices, np.array([[True], [False], [True]]))
    instances, objects = (Instance(0, 0, np.eye(4)),), (SceneObject("Lift", "/Lift"),)
    stage = SceneDescription(
        "room", (UNIT_CUBE,), instances=instances, objects=objects, tracks=(track,), object_tracks=(track,)
    )
    made = world(stage=stage)
    made.next_frame = 6
    made.move("/Lift", (0, 1, 0))
    assert made.state(6).objects == ()
    made.next_frame = 7
    made.move("/Lift", (0, 2, 0), (0, 90, 0))
    made.next_frame = 8
    made.move("/Lift", (0, 3, 0))
    (shown,) = made.state(10).objects
    np.testing.assert_allclose((*shown.position, *shown.rotation), (0, 3, 0, np.sqrt(0.5), 0, np.sqrt(0.5), 0))
