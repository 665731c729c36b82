# SPDX-License-Identifier: Apache-2.0
"""Eight numbers at once: their sums, and which of them."""

import taichi as ti

from tiscene.device.kernel_types import Template, float8
from tiscene.scene.lights.light_tree import LANES


@ti.func
def running_sums(v: float8) -> float8:
    """Of the first member, of two ..., of all. They never decrease: rounding keeps order."""
    second, fourth = v[0] + v[1], 0.0
    fourth = second + (v[2] + v[3])
    sixth = fourth + (v[4] + v[5])
    return float8(v[0], second, second + v[2], fourth, fourth + v[4], sixth, sixth + v[6], sixth + (v[6] + v[7]))


@ti.func
def total_of(v: float8) -> ti.f32:
    """The last of the running sums."""
    return ((v[0] + v[1]) + (v[2] + v[3]) + (v[4] + v[5])) + (v[6] + v[7])


@ti.func
def lowest(bits: ti.i32) -> ti.i32:
    """Which is the lowest that is set."""
    return 31 - ti.math.clz(bits & -bits)


@ti.func
def lane_of(v: float8, lane: ti.i32) -> ti.f32:
    """One number of eight."""
    result = 0.0
    for k in ti.static(range(LANES)):
        result = ti.select(lane == k, v[k], result)
    return result


@ti.func
def picked(v: float8, aim: ti.f32):
    """(member, its weight, the sum of those before it) where the running sum of weights passes `aim`."""
    sums = running_sums(v)
    before, weights = ti.Vector.zero(ti.f32, LANES), ti.Vector.zero(ti.f32, LANES)
    lane = 0
    for k in ti.static(range(LANES)):
        weights[k] = v[k]
    for k in ti.static(range(LANES - 1)):
        before[k + 1] = sums[k]
        lane += ti.cast(sums[k] <= aim, ti.i32)
    return lane, weights[lane], before[lane]


@ti.func
def eight(weights: Template, k: ti.i32) -> float8:
    """The weights of the entries of the k-th node."""
    result = float8(0.0)
    for lane in ti.static(range(LANES)):
        result[lane] = weights[LANES * k + lane]
    return result
