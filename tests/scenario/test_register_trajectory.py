# SPDX-License-Identifier: Apache-2.0
"""A trajectory added from outside the package, in one file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

import tiscene as ts
from dynamics.dynamic import ROTATION, SEGMENT_COLUMNS, ClosedForm, Curve, Pose, Track

BUFFERS = ("instance", "forward_flow")


@dataclass(frozen=True)
class Shuttle(ClosedForm):
    """There and back along x: x0 + distance at half of the period."""

    distance: float
    period: float = 2.0

    @property
    def loop_time(self) -> float:
        return self.period

    def tracks(self, start: Pose) -> tuple[Track, ...]:
        segments = np.zeros((2, SEGMENT_COLUMNS))
        segments[:, ROTATION:] = np.tile(start.rotation, 4)
        segments[:, :3] = start.position
        segments[1, 0] += self.distance
        segments[:, 3] = self.distance, -self.distance
        return (Curve(self.period, 2.0, True, segments=segments),)


@pytest.fixture
def scenario() -> ts.Scenario:
    shuttle = ts.Object("ball", "Ball 01", (-0.3, 0.2, 0.0), dynamic=Shuttle(0.6), collide=False)
    return ts.Scenario("object_view", [shuttle])


def test_registered_trajectory_moves_an_object(scenario):
    stream = ts.Stream(scenario, width=32, height=24, fps=10.0, buffers=BUFFERS)
    x = [stream[k].objects.by_name("ball").position[0] for k in (0, 5, 10, 15, 20)]
    np.testing.assert_allclose(x, (-0.3, 0.0, 0.3, 0.0, -0.3), atol=1e-12)


@pytest.mark.parametrize("suffix", [".json", ".usda"])
def test_registered_trajectory_is_saved_and_loaded(scenario, suffix, tmp_path):
    scenario.save(tmp_path / f"run{suffix}")
    loaded = ts.Scenario.load(tmp_path / f"run{suffix}")
    assert loaded.objects[0].dynamic == Shuttle(0.6)
    here, there = (ts.Stream(each, width=32, height=24, buffers=BUFFERS)[7] for each in (scenario, loaded))
    assert all(here[name].tobytes() == there[name].tobytes() for name in BUFFERS)
