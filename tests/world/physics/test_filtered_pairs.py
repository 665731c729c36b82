# SPDX-License-Identifier: Apache-2.0
"""Bodies that do not collide with each other, or with parts of the stage."""

from __future__ import annotations

import numpy as np
import pytest

import tiscene as ts
from dynamics import RigidBody
from tests.usd.helpers import write
from tests.world.physics.fake_physics_world import FakePhysicsWorld, ball, box, pose
from tiscene.errors import ScenarioError, StageWarning
from tiscene.scenario.edits import Spawn
from tiscene.usd.scenario.read import read_scenario

FLOOR = (pose(y=-0.5), box(5, 0.5, 5))
SHELF = (pose(y=0.8), box(1, 0.05, 1))


def heights(filtered, frame=40):
    """Drop two balls, one above the other, on a shelf above a floor."""
    bodies = [(ball(0.1), pose(y=1.2), RigidBody()), (ball(0.1), pose(y=1.6), RigidBody())]
    world = FakePhysicsWorld(bodies, [FLOOR, SHELF], filtered=filtered)
    found = world.simulation().frame(frame)
    return found.poses[:, 1], found.contacts


def test_filtered_bodies_pass_through_each_other():
    (low, high), _ = heights([])
    assert high - low > 0.15
    (low, high), contacts = heights([(0, "body", 1)])
    assert (low, high) == pytest.approx((0.95, 0.95), abs=0.005)  # both rest on the shelf, at one place
    assert {(0, "stage", 1), (1, "stage", 1)} == set(contacts)


def test_filtered_part_of_the_stage_is_passed_by_that_body_alone():
    (low, high), contacts = heights([(0, "stage", 1), (0, "body", 1)])
    assert (low, high) == pytest.approx((0.1, 0.95), abs=0.005)  # on the floor, on the shelf
    assert set(contacts) == {(0, "stage", 0), (1, "stage", 1)}


def test_pairs_that_are_not_there_are_no_error():
    assert heights([(0, "stage", 7), (0, "body", 9)])[0] == pytest.approx(heights([])[0])


def scenario(pairs=(), **named):
    objects = [
        ts.Object("floor", "Cube", (0, -1, -3), scale=(20, 5, 20), dynamic=ts.Still()),
        ts.Object("a", "Ball 01", (0, 0.2, -3)),
        ts.Object("b", "Ball 01", (0, 0.6, -3)),
    ]
    return ts.Scenario("object_view", objects, physics=True, filtered_pairs=pairs, **named)


def test_pairs_are_sorted_and_written_to_json():
    made = scenario([("b", "a"), ("a", "b"), ("a", "/Room")])
    assert made.filtered_pairs == (("/Room", "a"), ("a", "b"))
    assert ts.Scenario.from_json(made.to_json()) == made


@pytest.mark.parametrize(
    ("pairs", "text"),
    [
        ("ab", "must be a sequence of pairs"),
        (["ab"], "must be two ids"),
        ([("a", "b", "floor")], "must be two ids"),
        ([("a", "c")], "there is no object 'c'"),
        ([("floor", "/Room")], "neither is a rigid body"),
        ([("a", "a")], "does not collide with itself"),
    ],
)
def test_wrong_pairs_are_errors(pairs, text):
    with pytest.raises(ScenarioError, match=text):
        scenario(pairs)


def test_balls_of_a_stream_pass_through_each_other_and_through_an_object():
    def rows(pairs, frame=20):
        with ts.Stream(scenario(pairs), width=8, height=8, buffers=("instance",)) as stream:
            return {each.name: each.position[1] for each in stream[frame].objects}

    apart, together = rows(()), rows([("a", "b")])
    assert apart["b"] - apart["a"] > 0.1
    assert together["b"] == pytest.approx(together["a"], abs=0.005)
    assert rows([("a", "floor")])["a"] < -1.0


def test_spawned_object_passes_too_and_replay_is_the_same():
    spawn = Spawn(3, ts.Object("c", "Ball 01", (0, 0.9, -3), first_frame=3, dynamic=RigidBody()))
    later = scenario([("c", "a"), ("c", "b"), ("c", "floor")], edits=[spawn])
    with ts.Stream(later, width=8, height=8, buffers=("instance",)) as stream:
        end = {each.name: each.position for each in stream[25].objects}
        assert end["c"][1] < -1.0
        assert end["b"][1] > end["a"][1] > -0.5
        again = {each.name: each.position for each in (stream[10], stream[25])[1].objects}
    assert again == end


STAGE = """
def PhysicsScene "Scene" {}
def Xform "Room" {
    def Cube "Floor" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {
        double3 xformOp:translate = (0, -11, 0)
        double3 xformOp:scale = (10, 10, 10)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
    }
    def Cube "Shelf" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {
        double3 xformOp:scale = (2, 0.1, 2)
        uniform token[] xformOpOrder = ["xformOp:scale"]
    }
}
%s
%s
"""
BODY = """
def Sphere "%s" (prepend apiSchemas = ["TisceneObjectAPI", "PhysicsRigidBodyAPI", "PhysicsCollisionAPI"%s]) {
    double radius = 0.2
    double3 xformOp:translate = (%g, 0.5, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    %s
}"""
GROUP = """
def PhysicsCollisionGroup "%s" (prepend apiSchemas = ["CollectionAPI:colliders"]) {
    rel collection:colliders:includes = [%s]
    rel physics:filteredGroups = [%s]
    %s
}"""
A, B, C = (BODY % (name, "", x, "") for name, x in (("A", -1), ("B", 0), ("C", 1)))


def pairs_of(folder, bodies, groups=""):
    path = write(folder, STAGE % (bodies, groups))
    return [tuple(each) for each in read_scenario(path).content.get("filtered_pairs", [])]


def test_filtered_pairs_of_a_stage(tmp_path):
    rel = "rel physics:filteredPairs = [</B>, </Room/Shelf>]"
    a = BODY % ("A", ', "PhysicsFilteredPairsAPI"', -1, rel)
    assert pairs_of(tmp_path, a + B + C) == [("/Room/Shelf", "A"), ("A", "B")]
    with ts.Stream(tmp_path / "stage.usda", width=8, height=8, buffers=("instance",), fps=25) as stream:
        height = {each.name: each.position[1] for each in stream[30].objects}
    assert height["A"] == pytest.approx(-0.8, abs=0.02)
    assert height["B"] == pytest.approx(0.3, abs=0.02)


def test_filtered_pairs_of_a_group_of_prims_and_of_what_is_not_there(tmp_path):
    a = BODY % ("A", ', "PhysicsFilteredPairsAPI"', -1, "rel physics:filteredPairs = [</Room>, </Nowhere>]")
    with pytest.warns(StageWarning, match="a filtered pair with a prim that does not exist .*: </A> to </Nowhere>"):
        assert pairs_of(tmp_path, a + B) == [("/Room", "A")]


def test_collision_groups(tmp_path):
    """Members of a group collide with each other, unless it filters itself."""
    ghosts = GROUP % ("Ghosts", "</A>, </B>", "</Ghosts>, </Walls>", "")
    walls = GROUP % ("Walls", "</Room/Shelf>", "", "")
    expected = [("/Room/Shelf", "A"), ("/Room/Shelf", "B"), ("A", "B")]
    assert pairs_of(tmp_path, A + B + C, ghosts + walls) == expected
    whole = GROUP % ("Walls", "</Room>", "</Ghosts>", "")
    ghosts = GROUP % ("Ghosts", "</A>, </B>", "", "")
    assert pairs_of(tmp_path, A + B + C, ghosts + whole) == [("/Room", "A"), ("/Room", "B")]


def test_inverted_group_collides_with_its_filtered_groups_alone(tmp_path):
    group = GROUP % ("Ghosts", "</A>", "</Walls>", "bool physics:invertFilteredGroups = 1")
    walls = GROUP % ("Walls", "</Room/Floor>", "", "")
    assert pairs_of(tmp_path, A + B + C, group + walls) == [("/Room/Shelf", "A"), ("A", "B"), ("A", "C")]


def test_groups_of_one_merge_group_count_as_one(tmp_path):
    merge = 'string physics:mergeGroup = "all"'
    groups = (
        GROUP % ("One", "</A>", "", merge)
        + GROUP % ("Two", "</B>", "</Three>", merge)
        + GROUP % ("Three", "</C>", "", "")
    )
    assert pairs_of(tmp_path, A + B + C, groups) == [("A", "C"), ("B", "C")]


def test_filter_of_a_part_of_a_body_counts_for_the_body_and_is_named(tmp_path):
    part = 'def Cube "Arm" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {}'
    body = BODY % ("A", "", -1, part)
    groups = GROUP % ("Arms", "</A/Arm>", "</Others>", "") + GROUP % ("Others", "</B>", "", "")
    with pytest.warns(StageWarning, match="a collision filter of a part of a rigid body counts .*: </A>"):
        assert pairs_of(tmp_path, body + B, groups) == [("A", "B")]


def test_pairs_survive_a_round_trip_and_are_found_by_other_programs(tmp_path):
    from pxr import Usd, UsdPhysics

    made = scenario(
        [("a", "b"), ("a", "later"), ("b", "/ObjectView")], edits=[Spawn(3, ts.Object("later", "Cube", first_frame=3))]
    )
    made.save(tmp_path / "run.usda")
    assert ts.Scenario.load(tmp_path / "run.usda") == made
    stage = Usd.Stage.Open(str(tmp_path / "run.usda"))
    prim = stage.GetPrimAtPath("/Scenario/Objects/a")
    assert [str(each) for each in UsdPhysics.FilteredPairsAPI(prim).GetFilteredPairsRel().GetTargets()] == [
        "/Scenario/Objects/b"
    ]


def test_path_without_anything_that_collides_is_named():
    stream = ts.Stream(scenario([("a", "/Nowhere")]), width=8, height=8, buffers=("instance",))
    with stream, pytest.warns(StageWarning, match="nothing of the stage that collides is at '/Nowhere'"):
        assert np.isfinite(stream[1].objects[1].position).all()


def test_pairs_of_bodies_without_a_shape_are_left_out(tmp_path):
    empty = BODY.replace("def Sphere", "def Xform").replace("double radius = 0.2", "") % ("Empty", "", 2, "")
    rel = "rel physics:filteredPairs = [</B>, </Empty>]"
    path = write(tmp_path, STAGE % (BODY % ("A", ', "PhysicsFilteredPairsAPI"', -1, rel) + B + empty, ""))
    with pytest.warns(StageWarning, match="no geometry"):
        stream = ts.Stream(path, width=8, height=8, buffers=("instance",))
    with stream:
        assert stream.scenario.filtered_pairs == (("A", "B"),)
