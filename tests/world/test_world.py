# SPDX-License-Identifier: Apache-2.0
"""The world: placements, cameras and rows of objects, on a stage small enough to work them out by hand."""

import hashlib
import math
import os
import subprocess
import sys
from dataclasses import FrozenInstanceError
from fractions import Fraction

import numpy as np
import pytest

import tiscene as ts
from dynamics import Body, Dynamic, LookAt, Orbit, Simulation
from dynamics.rotation import matrix_from_quaternion, quaternion
from tests.world.small_stage import (
    BALL,
    CATALOG,
    CHAIR,
    FLOOR,
    GO,
    STAGE,
    STAGE_BALL,
    UNIT_CUBE,
    at,
    load,
    world,
)
from tiscene.errors import ArgumentError, ArgumentTypeError, CameraNotFound, ScenarioError, TemplateNotFound
from tiscene.scene.description import Instance, SceneDescription, SceneObject
from tiscene.world.category_ids import CategoryIds
from tiscene.world.world import World


def test_descriptions_are_the_stage_and_each_template_once_in_the_order_of_need():
    made = world(ts.Object("a", "Ball"), ts.Object("b", "Chair 01"), ts.Object("c", "Ball"))
    assert made.descriptions == [made.stage, BALL.description, CHAIR.description]
    assert made.templates == ["Ball", "Chair 01"]
    assert made.state(0).placement.mesh.tolist() == [0, 1, 1, 2, 3, 3, 4, 2]


def test_a_template_of_the_stage_wins_over_the_catalog():
    stage = SceneDescription("room", (FLOOR,), templates=(STAGE_BALL,))
    made = world(ts.Object("a", "Ball"), stage=stage)
    assert made.descriptions[1] is STAGE_BALL.description
    assert made.state(0).objects[0].category == "toy"
    assert made.templates == ["Ball"]


def test_rows_are_in_the_order_of_ids_and_parts_share_one():
    placement = world(ts.Object("a", "Chair 01"), ts.Object("b", "Ball")).state(0).placement
    assert placement.instance_id.tolist() == [1, 2, 2, 4, 4, 4, 5]
    assert placement.category_id.tolist() == [1, 2, 2, 3, 3, 3, 4]
    assert placement.instance_id.dtype == placement.category_id.dtype == placement.mesh.dtype == np.int32
    assert placement.world_from_object.shape == (3, 7, 3, 4)
    assert placement.present.all()


def test_categories_are_numbered_as_they_first_appear():
    assert world().categories == {0: "", 1: "floor", 2: "lamp"}
    assert world(ts.Object("a", "Ball"), ts.Object("b", "Chair 01")).categories == {
        **world().categories,
        3: "ball",
        4: "chair",
    }
    stage = SceneDescription("room", objects=(SceneObject("a", "/A", "ball"),), templates=(STAGE_BALL, CHAIR))
    assert world(stage=stage).categories == {0: "", 1: "ball", 2: "toy", 3: "chair"}


def test_things_of_the_stage_stand_where_the_stage_puts_them():
    placement = world(ts.Object("a", "Ball", dynamic=GO)).state(3).placement
    for time in range(3):
        for row, instance in enumerate((1, 0, 2)):
            assert (placement.world_from_object[time, row] == STAGE.instances[instance].world_from_object[:3]).all()


def test_an_object_is_placed_by_position_rotation_and_scale():
    made = world(ts.Object("a", "Chair 01", (1, 2, 3), (0, 90, 0), scale=(1, 2, 4)))
    expected = at(1, 2, 3, (0, 90, 0)) @ np.diag([1, 2, 4, 1.0]) @ at(0, 1, 0)
    matrices = made.state(5).placement.world_from_object
    np.testing.assert_allclose(matrices[:, 3], np.tile(expected[:3], (3, 1, 1)), atol=1e-15)
    # What stands still does not move by a single bit.
    assert matrices[0].tobytes() == matrices[1].tobytes() == matrices[2].tobytes()
    row = made.state(5).objects[-1]
    assert (row.position, row.velocity) == ((1.0, 2.0, 3.0), (0.0, 0.0, 0.0))
    np.testing.assert_allclose(row.rotation, quaternion((0, 90, 0)))


def test_a_mover_is_where_its_path_is_before_at_and_after_the_frame():
    made = world(ts.Object("a", "Ball", (9, 9, 9), dynamic=GO, scale=2.0))
    poses = Simulation([Body(GO)]).poses
    for frame in (1, 7, 55, 12345):
        placement = made.state(frame).placement
        for time, step in enumerate((-1, 0, 1)):
            pose = poses(Fraction(frame + step, 10))[0]
            assert placement.world_from_object[time, -1, :, 3].tolist() == pose[:3].tolist()
            axes = matrix_from_quaternion(pose[3:]) * 2.0
            np.testing.assert_allclose(placement.world_from_object[time, -1, :, :3], axes, atol=1e-15)


def test_before_frame_0_the_world_stands_as_at_frame_0():
    late = ts.Object("b", "Ball", dynamic=GO, first_frame=1)
    placement = world(ts.Object("a", "Ball", dynamic=GO), late).state(0).placement
    previous, current, following = placement.world_from_object
    assert previous.tobytes() == current.tobytes()
    assert following[-2, 0, 3] > 0.0
    assert placement.present[:, -2:].tolist() == [[True, False], [True, False], [True, True]]


def test_life_spans_are_inclusive_and_absent_objects_have_their_planned_pose():
    made = world(ts.Object("a", "Ball", dynamic=GO, first_frame=10, last_frame=12))
    present = {frame: made.state(frame).placement.present[:, -1].tolist() for frame in range(8, 15)}
    assert present == {
        8: [False, False, False],
        9: [False, False, True],
        10: [False, True, True],
        11: [True, True, True],
        12: [True, True, False],
        13: [True, False, False],
        14: [False, False, False],
    }
    # Born at waypoint 0, where it is already before; a tenth of a second is 0.1 m; it goes on after its end.
    x = {frame: made.state(frame).placement.world_from_object[1, -1, 0, 3] for frame in (0, 9, 10, 11, 12, 13, 30)}
    np.testing.assert_allclose(list(x.values()), [0, 0, 0, 0.1, 0.2, 0.3, 2.0], atol=1e-15)
    assert [row.name for row in made.state(9).objects] == ["Floor", "Lamp", "Cup"]
    assert (
        [row.name for row in made.state(10).objects]
        == [row.name for row in made.state(12).objects]
        == ["Floor", "Lamp", "Cup", "a"]
    )
    assert made.state(12).objects[-1].first_frame == 10
    assert made.state(12).objects[-1].last_frame == 12
    np.testing.assert_allclose(made.state(12).objects[-1].velocity, (1, 0, 0), atol=1e-12)


def test_timings_hold_objects_but_not_the_camera():
    camera = ts.Camera(dynamic=GO)
    made = world(ts.Object("a", "Ball", dynamic=GO), timings=ts.AllTogether(1.0), camera=camera)
    assert made.state(15).placement.world_from_object[1, -1, 0, 3] == 0.5
    assert made.state(15).cameras[0].current.position == (1.5, 0.0, 0.0)


def test_boxes_are_around_all_parts_in_the_objects_own_axes():
    made = world(ts.Object("a", "Chair 01", (5, 5, 5), (10, 20, 30), scale=2.0), ts.Object("b", "Ball"))
    rows = made.state(0).objects
    assert rows[0].box == ((-2, 0, -2), (2, 0, 2))
    # The lamp's axes are its first part's, turned by 90 degrees: scaled by a half, and 1 m above the other part.
    np.testing.assert_allclose(rows[1].box, ((-0.5, -0.25, -0.5), (0.5, 1.5, 0.5)), atol=1e-12)
    np.testing.assert_allclose(rows[1].rotation, quaternion((0, 90, 0)), atol=1e-15)
    assert rows[1].position == (1, 2, 3)
    assert rows[2].box == ((0, 0, 0), (0, 0, 0))
    assert rows[3].box == ((-4, -1, -4), (4, 3, 4))
    assert rows[4].box == ((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5))


@pytest.mark.parametrize("row", range(6))
def test_box_coordinates_lead_back_to_the_objects_own_box(row):
    """Corner 0..1 of the box -> object axes -> world, and mesh -> world, must meet."""
    made = world(ts.Object("a", "Chair 01", (5, 5, 5), (10, 20, 30), scale=(2, 1, 1)))
    placement = made.state(0).placement
    owner = made.state(0).objects[int(placement.instance_id[row]) - 1]
    points = np.array([(-0.5, 0.2, 0.1), (0.3, -0.4, 0.5)])
    world_points = points @ placement.world_from_object[1, row, :, :3].T + placement.world_from_object[1, row, :, 3]
    own = (world_points - owner.position) @ matrix_from_quaternion(owner.rotation)
    low, high = np.array(owner.box)
    found = points @ placement.box_from_object[row, :, :3].T + placement.box_from_object[row, :, 3]
    solid = high - low > 1e-3
    np.testing.assert_allclose(found[:, solid], ((own - low) / np.where(solid, high - low, 1))[:, solid], atol=1e-12)
    assert np.linalg.matrix_rank(placement.box_from_object[row, :, :3]) == 3


def test_a_flat_object_lies_at_half_of_its_box():
    matrix = world().state(0).placement.box_from_object[0]
    np.testing.assert_allclose(matrix @ (0.0, 0.0, 0.0, 1.0), (0.5, 0.5, 0.5))


def test_rows_say_who_is_who():
    rows = world(ts.Object("a", "Chair 01")).state(0).objects
    assert [(row.id, row.name, row.template, row.category, row.category_id, row.prim_path) for row in rows] == [
        (1, "Floor", "", "floor", 1, "/Floor"),
        (2, "Lamp", "", "lamp", 2, "/Lamp"),
        (3, "Cup", "", "", 0, "/Cup"),
        (4, "a", "Chair 01", "chair", 3, ""),
    ]


def test_mirrored_things_of_the_stage_have_a_proper_rotation():
    mirror = at(0, 0, 0, (20, 30, 40)) @ np.diag([1, 1, -2, 1.0])
    stage = SceneDescription(
        "room", (UNIT_CUBE,), instances=(Instance(0, 0, mirror),), objects=(SceneObject("a", "/A"),)
    )
    row = world(stage=stage).state(0).objects[0]
    np.testing.assert_allclose(np.linalg.norm(row.rotation), 1.0)
    assert math.prod(np.subtract(row.box[1], row.box[0])) == pytest.approx(2.0)


def test_the_camera_moves_by_its_dynamic():
    still = world().state(7).cameras[0]
    assert still[0] is still[1] is still[2]
    assert still[1].name == "Door"
    moving = ts.Camera((3, 1, 0), vertical_fov=0.5, dynamic=LookAt((0, 1, 0), Orbit((0, 0, 0), period=4.0)))
    before, now, after = world(fps=1.0, camera=moving).state(1).cameras[0]
    np.testing.assert_allclose(
        [before.position, now.position, after.position], [(3, 1, 0), (0, 1, -3), (-3, 1, 0)], atol=1e-14
    )
    np.testing.assert_allclose(-now.axes()[:, 2], (0, 0, 1), atol=1e-14)
    assert now.vertical_fov == 0.5
    start = world(fps=1.0, camera=moving).state(0).cameras[0]
    assert start[0] == start[1]


def test_lens_of_a_camera_plays_whatever_places_it_and_the_walls_follow():
    lens = ts.LensKeyframes((0.0, 2.0), vertical_fov=(1.0, 0.2), focus_distance=(1.0, 3.0))
    zooming = ts.Camera((3, 1, 0), lens=lens)
    made = world(fps=2.0, camera=zooming, frustum=ts.Frustum())
    made.next_frame = 2
    made.move_camera((0, 0, 1))
    before, now, after = made.state(2).cameras[0]
    assert [each.focus_distance for each in (before, now, after)] == [1.5, 2.0, 2.5]
    assert [each.position for each in (before, now, after)] == [(3, 1, 0), (0, 0, 1), (0, 0, 1)]
    assert made.state(0).cameras[0].previous == made.state(0).cameras[0].current
    (middle,) = made.between(3, Fraction(-1, 2))[1]
    assert (middle.focus_distance, middle.position) == (2.25, (0, 0, 1))
    np.testing.assert_array_equal(made.trajectories.walls(Fraction(2)), zooming.at(2.0).frustum_planes(4 / 3))
    made.set_frustum_walls(ts.Frustum())
    np.testing.assert_array_equal(made.trajectories.walls(Fraction(9)), now.frustum_planes(4 / 3))


def test_which_camera():
    assert world(camera="Window").camera is STAGE.cameras[1]
    blind = SceneDescription("room", (UNIT_CUBE,), instances=(Instance(0, 0, np.eye(4)),), objects=STAGE.objects[:1])
    assert world(stage=blind).camera == ts.Camera.framing((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5))
    own = ts.Camera(name="own")
    assert world(camera=own).camera is own
    with pytest.raises(CameraNotFound, match=r"no camera 'Windw' in scene 'room'\. Did you mean 'Window'"):
        world(camera="Windw")


def test_a_state_cannot_be_changed():
    made = world(ts.Object("a", "Ball", dynamic=GO))
    state = made.state(3)
    for array in vars(state.placement).values():
        if isinstance(array, np.ndarray):
            with pytest.raises(ValueError, match="read-only"):
                array[...] = 0
    with pytest.raises(FrozenInstanceError):
        state.frame = 4
    assert made.state(3) is state
    assert isinstance(state.objects, tuple)


def test_an_empty_world():
    made = world(stage=SceneDescription("empty"))
    placement = made.state(0).placement
    assert placement.world_from_object.shape == (3, 0, 3, 4)
    assert made.state(0).objects == ()


def test_adding_an_object_changes_no_bit_of_the_others():
    one, other = (
        ts.Object("a", "Ball", dynamic=GO),
        ts.Object("b", "Chair 01", dynamic=ts.CatmullWaypoints(GO.waypoints, 3.3)),
    )
    alone, together = world(one), world(one, other)
    for frame in (0, 3, 77, 10**6):
        matrices = together.state(frame).placement.world_from_object[:, :4]
        assert np.ascontiguousarray(matrices).tobytes() == alone.state(frame).placement.world_from_object.tobytes()


def digest() -> str:
    paths = [ts.CatmullWaypoints(GO.waypoints, 1.0 + 0.1 * row, pacing="arc_length") for row in range(6)]
    made = world(
        *(ts.Object(f"o{row}", "Chair 01", dynamic=path, first_frame=row) for row, path in enumerate(paths)),
        camera=ts.Camera(dynamic=LookAt((0, 0, 0), GO)),
        fps=29.97,
    )
    result = hashlib.sha256()
    for frame in (0, 1, 2, 17, 5, 99999):
        for array in vars(made.state(frame).placement).values():
            result.update(b"" if array is None else array.tobytes())
        result.update(repr((made.state(frame).cameras[0], made.state(frame).objects)).encode())
    return result.hexdigest()


@pytest.mark.parametrize("threads", [1, 2])
def test_another_process_and_any_number_of_threads_give_the_same_bits(threads):
    code = (
        f"from tiscene.device import runtime; runtime.start(threads={threads})\n"
        "from tests.world.test_world import digest\nprint(digest())"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, env=dict(os.environ)
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == digest()


class OwnDynamic(Dynamic):
    loop_time = 0.0


def test_impossible_worlds_are_refused():
    with pytest.raises(TemplateNotFound, match="Did you mean 'Chair 01'"):
        world(ts.Object("a", "Chair 1"))
    with pytest.raises(ScenarioError, match="object 'a': the template 'Empty' has no mesh"):
        world(ts.Object("a", "Empty"))
    with pytest.raises(ScenarioError, match=r"\('a'\): dynamic=.* must be a dynamic in closed form"):
        world(ts.Object("a", "Ball", dynamic=OwnDynamic()))
    with pytest.raises(ScenarioError, match=r"\('Camera'\): dynamic=.* must be a dynamic in closed form"):
        world(camera=ts.Camera(dynamic=OwnDynamic()))
    for fps in (0, -1, math.inf, math.nan, True):
        with pytest.raises(ArgumentError, match="fps="):
            world(fps=fps)
    with pytest.raises(ArgumentError, match="frame=-1: must be at least 0"):
        world().state(-1)
    with pytest.raises(ArgumentTypeError, match=r"frame=1\.5: must be a whole number"):
        world().state(1.5)


def test_there_may_be_more_categories_than_16_bits_hold():
    objects = tuple(SceneObject(f"t{i}", f"/t{i}", f"label {i}") for i in range(65537))
    made = World(ts.Scenario("many"), SceneDescription("many", objects=objects), CATALOG.__getitem__, 25.0)
    assert made.categories[65537] == "label 65536"


def test_category_ids_of_a_world_can_be_chosen():
    ids = CategoryIds({"lamp": 7, "ball": 3}, 100)
    scenario = ts.Scenario("room", [ts.Object("a", "Ball", collide=False), ts.Object("b", "Chair 01", collide=False)])
    made = World(scenario, STAGE, load, 10.0, category_ids=ids)
    assert made.categories == {0: "", 100: "floor", 7: "lamp", 3: "ball", 101: "chair"}
    assert {row.category: row.category_id for row in made.state(0).objects} == {
        "floor": 100,
        "lamp": 7,
        "": 0,
        "ball": 3,
        "chair": 101,
    }
