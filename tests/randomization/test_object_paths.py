# SPDX-License-Identifier: Apache-2.0
"""Paths of objects are followed to their ends, whatever their dynamics are made of."""

import numpy as np
import pytest

import tiscene as ts
from tiscene.device import runtime
from tiscene.randomization.object_paths import path_of

LOOP = ts.LinearWaypoints([ts.Waypoint((0, 0, 0)), ts.Waypoint((4, 0, 0))], total_time=200.0)


@pytest.fixture(autouse=True)
def started():
    runtime.start()


@pytest.mark.parametrize(
    "dynamic",
    [
        LOOP,
        ts.LookAt((0, 9, 0), LOOP),
        ts.LookAt((0, 9, 0), ts.Composite((LOOP, ts.Orbit(period=1.0)))),
        ts.Composite((ts.Composite((LOOP,)), ts.Orbit(period=1.0))),
        ts.Keyframes((0.0, 200.0), LOOP.waypoints),
    ],
)
def test_path_reaches_its_farthest_point(dynamic):
    points = path_of(ts.Object("a", "Cube", dynamic=dynamic))
    assert np.ptp(points[:, 0]) == pytest.approx(4.0, rel=0.01)


def test_path_of_an_object_without_one_is_its_start():
    bounce = ts.UniformMovementRandomBounce()
    for dynamic in (None, ts.Still(), ts.LookAt((0, 9, 0)), bounce, ts.RigidBody()):
        np.testing.assert_array_equal(path_of(ts.Object("a", "Cube", (1, 2, 3), dynamic=dynamic)), [[1, 2, 3]])
