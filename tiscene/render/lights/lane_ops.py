# SPDX-License-Identifier: Apache-2.0
"""Reductions and selection over 8-wide vectors, with a fixed order of additions."""

import taichi as ti

from tiscene.device.kernel_types import Template, float8
from tiscene.scene.lights.light_tree import LANES


@ti.func
def prefix_sums(v: float8) -> float8:
    """Return the inclusive prefix sums of non-negative numbers. They never decrease, in spite of rounding."""
    second, fourth = v[0] + v[1], 0.0
    fourth = second + (v[2] + v[3])
    sixth = fourth + (v[4] + v[5])
    return float8(v[0], second, second + v[2], fourth, fourth + v[4], sixth, sixth + v[6], sixth + (v[6] + v[7]))


@ti.func
def sum_lanes(v: float8) -> ti.f32:
    """Return the sum, equal to the last of the prefix sums."""
    return ((v[0] + v[1]) + (v[2] + v[3]) + (v[4] + v[5])) + (v[6] + v[7])


@ti.func
def lowest_set_bit(bits: ti.i32) -> ti.i32:
    """Return the index of the lowest set bit."""
    return 31 - ti.math.clz(bits & -bits)


@ti.func
def lane_value(v: float8, lane: ti.i32) -> ti.f32:
    """Return the number in a lane that is not known at compile time."""
    result = 0.0
    for k in ti.static(range(LANES)):
        result = ti.select(lane == k, v[k], result)
    return result


@ti.func
def select_lane(v: float8, target: ti.f32):
    """Return (lane, its weight, sum of the weights before it) where the prefix sums of weights exceed `target`."""
    sums = prefix_sums(v)
    before, weights = ti.Vector.zero(ti.f32, LANES), ti.Vector.zero(ti.f32, LANES)
    lane = 0
    for k in ti.static(range(LANES)):
        weights[k] = v[k]
    for k in ti.static(range(LANES - 1)):
        before[k + 1] = sums[k]
        lane += ti.cast(sums[k] <= target, ti.i32)
    return lane, weights[lane], before[lane]


@ti.func
def load_lanes(values: Template, k: ti.i32) -> float8:
    """Return elements LANES * k ... LANES * k + LANES - 1 of a local vector."""
    result = float8(0.0)
    for lane in ti.static(range(LANES)):
        result[lane] = values[LANES * k + lane]
    return result
