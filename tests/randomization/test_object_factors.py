# SPDX-License-Identifier: Apache-2.0
"""The factors speed, instances, categories, rooms and occlusion: objects keep what is not varied."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

import tiscene as ts
from dynamics import Body, Simulation, UniformMovementRandomBounce
from tiscene import catalog
from tiscene.errors import ScenarioError, SceneNotFound
from tiscene.randomization.object_factors import faster
from tiscene.scenario.edits import Despawn


def faster_of(each: ts.Object) -> float:
    return getattr(each.dynamic, "parts", (each.dynamic,))[0].total_time


@dataclass(frozen=True)
class Wobble(ts.Stepped):
    """A trajectory of a user without a speed."""

    def begin(self, start):
        return start.position

    def advance(self, state, number):
        return state

    def pose(self, state):
        return ts.Waypoint(state)


def test_speed_keeps_paths(drawn):
    fast = drawn.with_factor("speed", 2.0)
    for a, b in zip(drawn.objects, fast.objects, strict=True):
        slow, quick = (Simulation([Body(each.dynamic, each.position, each.rotation)]) for each in (a, b))
        for time in (0.3, 1.7, 4.0):
            np.testing.assert_allclose(slow.poses(time), quick.poses(time / 2), atol=1e-9)
    spread = drawn.with_factor("speed", (0.5, 0.9), seed=1)
    ratios = [faster_of(b) / faster_of(a) for a, b in zip(drawn.objects, spread.objects, strict=True)]
    assert all(0.5 <= 1 / ratio <= 0.9 for ratio in ratios)
    assert ratios[0] != ratios[1]


def test_speed_of_each_kind_of_trajectory():
    keys = ts.Keyframes((0, 1), (ts.Waypoint((0, 0, 0)), ts.Waypoint((1, 0, 0))))
    assert faster(keys, 2.0, "a").times == (0, 0.5)
    assert faster(ts.LookAt((0, 0, 0), keys), 2.0, "a").motion.times == (0, 0.5)
    assert faster(ts.Orbit(period=3.0), 1.5, "a").period == 2.0
    bounce = faster(UniformMovementRandomBounce(1.0, 2.0), 3.0, "a")
    assert (bounce.speed, bounce.angular_speed) == (3.0, 6.0)
    with pytest.raises(ScenarioError, match="'a' moves by Wobble, whose speed is unknown"):
        faster(Wobble(), 2.0, "a")


def test_instances_stay_in_their_category_and_categories_do_not(drawn):
    def categories(scenario):
        return [catalog.templates()[catalog.template_variants(each.template)[0]].category for each in scenario.objects]

    other = drawn.with_factor("instances", seed=2)
    assert categories(other) == categories(drawn)
    assert all(a.template != b.template for a, b in zip(drawn.objects, other.objects, strict=True))
    assert {each.template for each in drawn.with_factor("instances", "Ball 01").objects} == {"Ball 01"}
    assert all(a != b for a, b in zip(categories(drawn), categories(drawn.with_factor("categories")), strict=True))
    others = categories(drawn.with_factor("categories", ("ball", "cup"), seed=2))
    assert all(b == "ball" or (b == "cup" and a != "cup") for a, b in zip(categories(drawn), others, strict=True))


def test_distractors_keep_their_sizes_in_another_room(room_of_boxes):
    clutter = {"count": 3, "templates": ("Cup 01", "Ball 01"), "scale": (0.4, 0.6)}
    cluttered = ts.Scenario(room_of_boxes).with_factor("clutter", clutter, seed=2)
    scales = [max(each.scale) for each in cluttered.objects]
    moved = cluttered.with_factor("rooms", "object_view", seed=2)
    assert len(moved.objects) == 3
    assert all(min(scales) <= max(each.scale) <= max(scales) for each in moved.objects)


def test_rooms_and_occlusion_keep_templates_and_speeds(drawn):
    def speeds(scenario):
        result = []
        for each in scenario.objects:
            simulation, total = Simulation([Body(each.dynamic)]), faster_of(each)
            way = np.array([simulation.poses(total * k / 500)[0, :3] for k in range(501)])
            result.append(np.linalg.norm(np.diff(way, axis=0), axis=1).sum() / total)
        return result

    for other in (drawn.with_factor("rooms", "object_view", seed=1), drawn.with_factor("occlusion", 0.0, seed=1)):
        assert [each.template for each in other.objects] == [each.template for each in drawn.objects]
        np.testing.assert_allclose(speeds(other), speeds(drawn), rtol=2e-3)
        assert [each.position for each in other.objects] != [each.position for each in drawn.objects]
    with pytest.raises(SceneNotFound):
        drawn.with_factor("rooms", "nowhere")
    with pytest.raises(ScenarioError, match="rooms: the scenario has edits"):
        replace(drawn, edits=[Despawn(3, drawn.objects[0].id)]).with_factor("rooms", "object_view")
