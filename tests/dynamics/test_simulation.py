# SPDX-License-Identifier: Apache-2.0
"""Simulation: poses are a pure function of their own body, for any thread count and process, without tiscene."""

import hashlib
import math
import os
import subprocess
import sys

import numpy as np
import pytest

from dynamics import AllTogether, Body, CatmullWaypoints, LinearWaypoints, LookAt, Orbit, Simulation, Waypoint
from dynamics.trajectory_kernel import evaluate

TIMES = [0.04 * frame for frame in range(0, 400, 7)]


def bodies(count: int) -> list[Body]:
    random = np.random.default_rng(11)
    result = []
    for row in range(count):
        points = [
            Waypoint(tuple(p), tuple(a)) for p, a in random.uniform((-3, -200), (3, 200), (5, 3, 2)).swapaxes(1, 2)
        ]
        kind = (LinearWaypoints, CatmullWaypoints)[row % 2]
        pacing = ("equal_time", "arc_length")[row // 2 % 2]
        rotation = ("quaternion", "euler")[row // 4 % 2]
        path = kind(points, 1.7 + 0.31 * row, pacing, rotation)
        result.append(Body((path, LookAt((0, 0, 0), path), path, Orbit((1, 2, 3), 2.3))[row % 4], (row, 0, 1)))
    return result


def digest(count: int = 24) -> str:
    simulation = Simulation(bodies(count), AllTogether(0.3))
    return hashlib.sha256(b"".join(simulation.poses(time).tobytes() for time in TIMES)).hexdigest()


PROGRAM = """
import sys
import taichi as ti
ti.init(arch=ti.cpu, fast_math=False, cpu_max_num_threads=1, log_level=ti.ERROR, offline_cache=False)
sys.modules["pxr"] = None
from tests.dynamics.test_simulation import digest
print(digest())
assert not any(name.split(".")[0] == "tiscene" for name in sys.modules), "dynamics needs tiscene"
"""


def test_poses_are_identical_in_another_process_of_one_thread_that_compiles_anew():
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"ENABLE_TAICHI_HEADER_PRINT": "0", "TI_SKIP_VERSION_CHECK": "ON"},
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[-1] == digest()


def test_poses_do_not_depend_on_other_bodies():
    everyone = bodies(24)
    together = Simulation(everyone, AllTogether(0.3))
    few = Simulation(everyone[3:9:2], AllTogether(0.3))
    odd = Simulation([*everyone[::-1], Body(Orbit(period=0.123456789012345))], AllTogether(0.3))
    for time in TIMES:
        poses = together.poses(time)
        assert poses[3:9:2].tobytes() == few.poses(time).tobytes()
        assert poses.tobytes() == np.ascontiguousarray(odd.poses(time)[23::-1]).tobytes()


def test_poses_do_not_depend_on_order_of_calls():
    simulation = Simulation(bodies(8))
    forward = [simulation.poses(time) for time in TIMES]
    backward = [simulation.poses(time) for time in TIMES[::-1]][::-1]
    assert np.array(forward).tobytes() == np.array(backward).tobytes()
    forward[0][:] = 7.0
    assert simulation.poses(TIMES[0]).tobytes() == backward[0].tobytes()


def test_poses_are_finite_with_unit_quaternions():
    simulation = Simulation(bodies(24))
    poses = np.array([simulation.poses(time) for time in TIMES])
    assert np.isfinite(poses).all()
    np.testing.assert_allclose(np.linalg.norm(poses[..., 3:], axis=-1), 1.0, atol=1e-15)


def test_new_bodies_compile_no_kernel():
    Simulation(bodies(1)).poses(1.0)
    compiled = len(evaluate._primal.compiled_kernels)
    for count in (2, 5, 24):
        Simulation(bodies(count)).poses(1.0)
    assert len(evaluate._primal.compiled_kernels) == compiled == 1


def test_simulation_without_bodies_returns_empty_poses():
    assert Simulation([]).poses(1.0).shape == (0, 7)


@pytest.mark.parametrize(("error", "time"), [(ValueError, math.nan), (ValueError, math.inf), (TypeError, "1")])
def test_non_finite_time_raises(error, time):
    with pytest.raises(error, match="time="):
        Simulation([Body()]).poses(time)
