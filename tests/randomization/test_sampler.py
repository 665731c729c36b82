# SPDX-License-Identifier: Apache-2.0
"""Sampled scenarios: repeatable, independent, within what was asked for, or refused."""

from __future__ import annotations

import inspect
import itertools
import math
from dataclasses import fields

import numpy as np
import pytest

import tiscene as ts
from dynamics import UniformMovementRandomBounce
from tests.usd.helpers import write
from tiscene.errors import ArgumentError, CameraNotFound, ScenarioError, SceneNotFound, TemplateNotFound
from tiscene.randomization.draws import Draws
from tiscene.randomization.ranges import ScenarioRanges
from tiscene.scenario.objects import Frustum, Object
from tiscene.scenario.scenario import Scenario

SMALL = ("Ball 01", "Cup 01", "Dish 01")
# A room of thin walls, 8 m wide and long, 4 m high, with a screen across the view at 4 m from the camera.
ROOM = """
def Xform "Room"
{
    def Camera "Eye"
    {
        float2 clippingRange = (0.1, 100)
        float focalLength = 0.2
        float verticalAperture = 0.24
        float horizontalAperture = 0.32
        double3 xformOp:translate = (0, 2, 3.5)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def Cube "Floor"
    {
        double3 xformOp:translate = (0, -0.05, 0)
        double3 xformOp:scale = (4, 0.05, 4)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
    }
    def Cube "Ceiling"
    {
        double3 xformOp:translate = (0, 4.05, 0)
        double3 xformOp:scale = (4, 0.05, 4)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
    }
    def Cube "Screen"
    {
        double3 xformOp:translate = (1.5, 1.5, -0.5)
        double3 xformOp:scale = (1.5, 1.5, 0.05)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
    }
}
"""


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(write(tmp_path_factory.mktemp("room"), ROOM, name="room.usda", more='defaultPrim = "Room"'))


def loop_of(each: Object) -> ts.CatmullWaypoints:
    return each.dynamic.parts[0] if isinstance(each.dynamic, ts.Composite) else each.dynamic


def centers(scenario: Scenario, frames: int = 60, fps: float = 5.0) -> dict[str, np.ndarray]:
    """Where every object is, without collisions."""
    objects = [ts.Object(each.id, each.template, each.position, each.rotation, each.dynamic, collide=False)
               for each in scenario.objects]  # fmt: skip
    free = Scenario(scenario.scene, objects, camera=scenario.camera)
    world = ts.Stream(free, fps=fps, width=8, height=6, buffers=("depth",)).world
    rows = [{row.name: row.position for row in world.state(frame).objects} for frame in range(frames)]
    return {each.id: np.array([row[each.id] for row in rows]) for each in objects}


def test_the_same_arguments_give_the_same_scenario(room):
    drawn = [Scenario.sample(room, seed=3, objects=3, templates=SMALL) for _ in range(2)]
    assert drawn[0] == drawn[1]
    assert Scenario.sample(room, seed=4, objects=3, templates=SMALL) != drawn[0]
    assert Scenario.from_json(drawn[0].to_json()) == drawn[0]


def test_one_more_object_changes_no_other(room):
    kinds = ("catmull", "linear", "bounce", "still")
    five, six = (Scenario.sample(room, seed=8, objects=n, templates=SMALL, dynamics=kinds) for n in (5, 6))
    assert six.objects[:5] == five.objects


def test_another_speed_changes_nothing_but_the_speed(room):
    slow, fast = (Scenario.sample(room, seed=2, objects=2, templates=SMALL, speed=v, angular_speed=0) for v in (0.5, 1))
    for a, b in zip(slow.objects, fast.objects, strict=True):
        assert a.template == b.template
        assert a.dynamic.waypoints == b.dynamic.waypoints
        assert a.dynamic.total_time == pytest.approx(2 * b.dynamic.total_time)


def test_numbers_are_within_their_ranges(room):
    spins, speeds, counts = [], [], []
    for seed in range(12):
        scenario = Scenario.sample(
            room, seed=seed, objects=(1, 3), templates=SMALL, dynamics=("linear", "catmull"), speed=(0.3, 0.6),
            angular_speed=(0.1, 0.4), waypoints=(3, 4), scale=(0.5, 1.5), frames=100, life=(20, 50), wait_time=0.5,
        )  # fmt: skip
        counts.append(len(scenario.objects))
        assert scenario.timings == ts.AllTogether(0.5)
        for each in scenario.objects:
            loop = loop_of(each)
            assert len(loop.waypoints) in (3, 4)
            assert each.template in SMALL
            assert 0.5 <= each.scale[0] <= 1.5
            assert 20 <= each.last_frame - each.first_frame + 1 <= 50
            assert 0 <= each.first_frame <= each.last_frame < 100
            spins.append(2 * math.pi / each.dynamic.parts[1].period)
            way = centers(Scenario(room, [Object(each.id, each.template, dynamic=loop)]), 40, 10.0)[each.id]
            speeds += list(np.linalg.norm(np.diff(way, axis=0), axis=1) * 10)
    assert set(counts) == {1, 2, 3}
    assert 0.1 <= min(spins) < 0.2 < 0.3 < max(spins) <= 0.4
    assert max(speeds) <= 0.6 + 1e-6  # chords are a little shorter than the way
    assert min(speeds) > 0.2


def test_what_should_be_in_view_is_in_view(room):
    scenario = Scenario.sample(room, seed=1, objects=4, templates=SMALL, depth=(1, 3), region=(0.25, 0, 0.75, 1))
    height = 2 * 0.6  # of the view at 1 m
    for way in centers(scenario).values():
        depth = 3.5 - way[:, 2]
        assert np.all(depth > 0.9)
        assert np.all(np.abs(way[:, 1] - 2) < 0.5 * height * depth)
        assert np.all(np.abs(way[:, 0]) < 0.5 * height * 4 / 3 * depth)
    for each in scenario.objects:
        for waypoint in loop_of(each).waypoints:
            x, _, z = waypoint.position
            assert 1 <= 3.5 - z <= 3.0001
            assert abs(x) <= 0.25 * height * 4 / 3 * (3.5 - z) + 1e-3


def test_visibility_and_occlusion_are_what_was_asked_for(room):
    scenario = Scenario.sample(
        room,
        seed=5,
        objects=4,
        templates=SMALL,
        depth=(1, 7),
        in_view=(0.5, 0.9),
        occlusion=(0.1, 0.6),
        waypoints=(3, 8),
    )
    for each in scenario.objects:
        way = centers(Scenario(room, [each]), 400, 400 / loop_of(each).total_time)[each.id]
        depth = 3.5 - way[:, 2]
        seen = (np.abs(way[:, 1] - 2) < 0.6 * depth) & (np.abs(way[:, 0]) < 0.8 * depth) & (depth > 0.1)
        assert 0.5 - 0.03 <= seen.mean() <= 0.9 + 0.03
        # Where the line of sight crosses the screen's plane, at 4 m.
        crossing = np.array([0, 2]) + (way[:, :2] - (0, 2)) * (4 / depth)[:, None]
        behind = (depth > 4) & np.all((crossing > 0) & (crossing < 3), axis=1)
        assert 0.1 - 0.06 <= (behind & seen).sum() / seen.sum() <= 0.6 + 0.06


def test_nothing_starts_in_the_scene_or_in_another_object(room):
    scenario = Scenario.sample(room, seed=0, objects=8, templates=("Pillow 01",), dynamics=("still", "bounce"))
    starts = np.array([each.position for each in scenario.objects])
    assert min(np.linalg.norm(a - b) for a, b in itertools.combinations(starts, 2)) > 0.5
    assert np.all(starts[:, 1] > 0.2)
    assert np.all(starts[:, 1] < 3.8)
    bounces = [each.dynamic for each in scenario.objects if isinstance(each.dynamic, UniformMovementRandomBounce)]
    assert 0 < len(bounces) < 8
    assert len({each.seed for each in bounces}) == len(bounces)
    assert scenario.frustum == Frustum(5.0)


def test_what_is_not_in_the_way_of_anything_moves_freely(room):
    """Ways avoid the scene: a world with collisions has the same poses as one without."""
    scenario = Scenario.sample(room, seed=6, objects=1, templates=SMALL)
    world = ts.Stream(scenario, fps=5, width=8, height=6, buffers=("depth",)).world
    free = centers(scenario, 40)[scenario.objects[0].id]
    for frame in range(0, 40, 5):
        (row,) = (each for each in world.state(frame).objects if each.name == scenario.objects[0].id)
        np.testing.assert_allclose(row.position, free[frame], atol=1e-9)


def test_an_empty_scene_is_all_room():
    scenario = Scenario.sample("object_view", seed=1, objects=2, templates=SMALL, camera="Main")
    assert scenario.camera == "Main"
    assert scenario.scene == "object_view"


def test_draws_are_uniform_and_independent():
    values = np.concatenate([Draws(seed, 2**64 - 1).uniform("speed", 0, 50) for seed in range(200)])
    assert np.all((values >= 0) & (values < 1))
    counts, _ = np.histogram(values, bins=20, range=(0, 1))
    assert ((counts - 500) ** 2 / 500).sum() < 43.8  # chi-square, 19 degrees of freedom, 0.1 %
    streams = [Draws(7, n).uniform(what, a, 4).tolist() for n in range(3) for what in ("a", "b") for a in range(3)]
    assert len({tuple(stream) for stream in streams}) == len(streams)
    assert np.array_equal(Draws(1, 2).uniform("x", 3, 9)[:4], Draws(1, 2).uniform("x", 3, 4))
    # Kept for ever: a scenario's seed is all that a paper may state.
    np.testing.assert_allclose(Draws(42, 1).uniform("speed", 0, 2), PINNED, rtol=0, atol=0)


PINNED = (0.026698027485287157, 0.08494093512643908)


@pytest.mark.parametrize(
    ("ranges", "message"),
    [
        ({"objects": (3, 1)}, "objects=.*low before high"),
        ({"objects": (1.5, 2)}, "whole numbers"),
        ({"objects": -1}, "objects=-1"),
        ({"waypoints": (1, 3)}, "waypoints=.*from 2 to 64"),
        ({"speed": 0}, "need a speed above 0"),
        ({"speed": (0.1, math.nan)}, "must be finite"),
        ({"speed": "fast"}, "speed='fast'"),
        ({"dynamics": ("wobble",)}, "'wobble' is not one of 'still'"),
        ({"dynamics": "linear"}, "must be a sequence of names"),
        ({"templates": ()}, "name at least one"),
        ({"depth": (0, 1)}, "greater than 0"),
        ({"in_view": (0.5, 1.5)}, r"within 0\.\.1"),
        ({"region": (0.5, 0, 0.5, 1)}, "left < right"),
        ({"occlusion": (0.5, 1), "in_view": 0}, "in_view=0 leaves none"),
        ({"life": (5, 10)}, "longer than the stream: frames=None"),
        ({"life": (5, 11), "frames": 10}, "longer than the stream: frames=10"),
        ({"frames": 0}, "frames=0"),
        ({"aspect": 0.0}, "aspect"),
        ({"aspect": "wide"}, "aspect"),
        ({"wait_time": -1}, "wait_time=-1: must be 0 or more"),
        ({"wait_time": "soon"}, "wait_time"),
        ({"seed": -1}, "seed=-1"),
        ({"seed": 1.0}, "seed=1.0"),
    ],
)
def test_ranges_that_contradict_themselves_are_refused(room, ranges, message):
    with pytest.raises(ArgumentError, match=message):
        Scenario.sample(room, **ranges)


def test_ranges_may_be_numbers_of_numpy(room):
    plain = Scenario.sample(room, seed=3, objects=2, templates=SMALL, speed=0.5, aspect=1.5)
    numbers = {"seed": np.int64(3), "objects": np.int64(2), "speed": np.float32(0.5), "aspect": np.float32(1.5)}
    assert Scenario.sample(room, templates=SMALL, **numbers) == plain


def test_ranges_that_nothing_fits_are_refused_with_their_reasons(room):
    with pytest.raises(
        ScenarioError, match=r"'pillow_01_0' \(catmull, 0\.\d\d m .* fits nowhere .*no free point visible"
    ):
        Scenario.sample(room, templates=("Pillow 01",), depth=(0.05, 0.2))
    with pytest.raises(ScenarioError, match="no free point hidden"):
        Scenario.sample(room, templates=SMALL, occlusion=(0.9, 1), depth=(1, 3))
    with pytest.raises(TemplateNotFound):
        Scenario.sample(room, templates=("Char 01",))
    with pytest.raises(CameraNotFound, match="'Ey'"):
        Scenario.sample(room, camera="Ey")
    with pytest.raises(SceneNotFound):
        Scenario.sample("nowhere")


def test_one_number_stands_for_a_range():
    assert ScenarioRanges(objects=2, speed=0.5).objects == (2, 2)
    assert ScenarioRanges(speed=0.5).speed == (0.5, 0.5)


def test_keywords_of_sample_are_the_fields_of_the_ranges():
    parameters = inspect.signature(Scenario.sample).parameters
    defaults = {field.name: field.default for field in fields(ScenarioRanges)}
    assert {name: each.default for name, each in parameters.items() if name in defaults} == defaults
    assert set(parameters) == {"scene", "seed", "camera", *defaults}
