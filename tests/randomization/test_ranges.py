# SPDX-License-Identifier: Apache-2.0
"""Ranges of sampled scenarios: what they accept, and what contradicts itself."""

from __future__ import annotations

import inspect
import math
from dataclasses import fields

import numpy as np
import pytest

from tests.randomization.rooms import SMALL
from tiscene.errors import ArgumentError
from tiscene.randomization.ranges import ScenarioRanges
from tiscene.scenario.scenario import DRAWN_FACTORS, Scenario


@pytest.mark.parametrize(
    ("ranges", "message"),
    [
        ({"objects": (3, 1)}, "objects=.*low before high"),
        ({"objects": (1.5, 2)}, "whole numbers"),
        ({"objects": -1}, "objects=-1"),
        ({"waypoints": (1, 3)}, "waypoints=.*from 2 to 64"),
        ({"speed": 0}, "need a speed above 0"),
        ({"speed": (0.1, math.nan)}, "must be finite"),
        ({"speed": "fast"}, r"speed='fast': must be a number or a range \(low, high\)"),
        ({"dynamics": ("wobble",)}, "'wobble' is not one of 'still'"),
        ({"dynamics": "linear"}, "must be a sequence of names"),
        ({"templates": ()}, "name at least one"),
        ({"depth": (0, 1)}, "greater than 0"),
        ({"in_view": (0.5, 1.5)}, r"within 0\.\.1"),
        ({"depth": 1e300}, r"depth=1e\+300: must lie within 0\.\.1e\+09"),
        ({"region": (0.5, 0, 0.5, 1)}, "left < right"),
        ({"occlusion": (0.5, 1), "in_view": 0}, "in_view=0 leaves none"),
        ({"life": (5, 10)}, "give the length of the stream too, frames="),
        ({"life": (5, 11), "frames": 10}, "longer than the stream: frames=10"),
        ({"frames": 0}, "frames=0"),
        ({"frames": (5, 10)}, r"frames=\(5, 10\): must be a whole number"),
        ({"life": 2, "frames": "many"}, "frames='many': must be a whole number"),
        ({"difficulty": {"motion": 1}, "frames": "many"}, "frames='many': must be a whole number"),
        ({"min_size": 1.5}, r"min_size=1\.5: must be a fraction of the image's height"),
        ({"min_size": (0.1, 0.2)}, "min_size"),
        ({"aspect": 0.0}, "aspect"),
        ({"aspect": "wide"}, "aspect"),
        ({"wait_time": -1}, "wait_time=-1: must not be negative"),
        ({"wait_time": "soon"}, "wait_time"),
        ({"seed": -1}, "seed=-1"),
        ({"seed": 1.0}, "seed=1.0"),
    ],
)
def test_contradictory_ranges_raise(room, ranges, message):
    with pytest.raises(ArgumentError, match=message):
        Scenario.sample(room, **ranges)


def test_ranges_accept_numpy_numbers(room):
    plain = Scenario.sample(room, seed=3, objects=2, templates=SMALL, speed=0.5, aspect=1.5)
    numbers = {"seed": np.int64(3), "objects": np.int64(2), "speed": np.float32(0.5), "aspect": np.float32(1.5)}
    assert Scenario.sample(room, templates=SMALL, **numbers) == plain


def test_number_is_range_of_one_value():
    assert ScenarioRanges(objects=2, speed=0.5).objects == (2, 2)
    assert ScenarioRanges(speed=0.5).speed == (0.5, 0.5)


def test_keywords_of_sample_are_the_fields_of_the_ranges():
    parameters = inspect.signature(Scenario.sample).parameters
    defaults = {field.name: field.default for field in fields(ScenarioRanges)}
    assert {name: each.default for name, each in parameters.items() if name in defaults} == defaults
    assert set(parameters) == {"scene", "seed", "camera", "variants", "difficulty", *defaults, *DRAWN_FACTORS}
