# SPDX-License-Identifier: Apache-2.0
"""Scenarios drawn within a band of difficulty."""

from __future__ import annotations

import numpy as np
import pytest

import tiscene as ts
from tiscene.errors import ArgumentError, ScenarioError
from tiscene.scenario.scenario import Scenario


def test_sample_reaches_a_band_of_difficulty_or_says_that_it_cannot(monkeypatch):
    ranges = {"seed": 1, "objects": 1, "templates": ("Ball 01",), "angular_speed": 0, "depth": (1, 2)}
    plain = Scenario.sample("object_view", **ranges)
    drawn = Scenario.sample("object_view", **ranges, difficulty={"motion": (3, 5), "size": (0, 1)})
    assert drawn == Scenario.sample("object_view", **ranges, difficulty={"motion": (3, 5), "size": (0, 1)})
    assert drawn.objects[0].dynamic.waypoints == plain.objects[0].dynamic.waypoints  # only its speed was changed
    with ts.Stream(drawn, width=128, height=96, buffers=("instance", "forward_flow")) as stream:
        motion = [stream[k * 250 // 8].difficulty.motion for k in range(8)]
    assert 3 <= np.mean(motion) <= 5
    monkeypatch.setattr("tiscene.randomization.difficulty_search.ATTEMPTS", 2)
    with pytest.raises(
        ScenarioError, match=r"none of 2 draws .*: instances was 1 to 1 in 2 of them, not within 5\.\.9"
    ):
        Scenario.sample("object_view", **ranges, difficulty={"instances": (5, 9)})
    for wrong, message in (
        ({"speed": 1}, "no measure 'speed'"),
        ({"size": (0, 2)}, r"within 0\.\.1"),
        ({}, "must map"),
    ):
        with pytest.raises(ArgumentError, match=message):
            Scenario.sample("object_view", **ranges, difficulty=wrong)
