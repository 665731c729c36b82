# SPDX-License-Identifier: Apache-2.0
"""Counter-based random numbers: a hash of (seed, object, bounce, draw). Nothing is remembered between draws.

So the numbers of one object depend on no other object, on no thread and on no earlier frame.
(This module holds device functions: no postponed annotations.)
"""

import math

import taichi as ti

# Literals of device functions are float32; these are passed through arrays or cast where more is needed.
TWO_PI = 2.0 * math.pi


@ti.func
def pcg4d(a: ti.u32, b: ti.u32, c: ti.u32, d: ti.u32):
    """Four words, each mixed from all four: pcg4d of Jarzynski and Olano, "Hash functions for GPU rendering" (2020)."""
    v = ti.Vector([a, b, c, d]) * ti.u32(1664525) + ti.u32(1013904223)
    for _ in ti.static(range(2)):
        v[0] += v[1] * v[3]
        v[1] += v[2] * v[0]
        v[2] += v[0] * v[1]
        v[3] += v[1] * v[2]
        for i in ti.static(range(4)):
            v[i] ^= v[i] >> 16
    return v


@ti.func
def uniform4(seed: ti.i32, number: ti.i32, bounce: ti.i32, draw: ti.i32):
    """Four float64 in (0, 1): the middles of 2^32 equal cells."""
    words = pcg4d(ti.cast(seed, ti.u32), ti.cast(number, ti.u32), ti.cast(bounce, ti.u32), ti.cast(draw, ti.u32))
    cell = 1.0 / ti.cast(4294967296.0, ti.f64)
    return (ti.cast(words, ti.f64) + 0.5) * cell


@ti.func
def hemisphere(normal, a, b):
    """A unit vector, uniform over the half sphere about a unit `normal`, from two uniform numbers."""
    # Any vector that is not parallel to the normal spans the tangent plane with it.
    zero = normal[0] * 0.0
    other = ti.Vector([zero + 1.0, zero, zero])
    if ti.abs(normal[0]) > 0.7:
        other = ti.Vector([zero, zero + 1.0, zero])
    tangent = other.cross(normal).normalized()
    bitangent = normal.cross(tangent)
    # By Archimedes, the height of a uniform point of a sphere is uniform.
    radius = ti.sqrt(ti.max(1.0 - a * a, 0.0))
    angle = TWO_PI * b
    return radius * ti.cos(angle) * tangent + radius * ti.sin(angle) * bitangent + a * normal


@ti.func
def ball(a, b, c):
    """A vector, uniform in the unit ball, from three uniform numbers."""
    height = 1.0 - 2.0 * a
    radius = ti.sqrt(ti.max(1.0 - height * height, 0.0))
    angle = TWO_PI * b
    length = ti.pow(c, 1.0 / ti.cast(3.0, ti.f64))
    return length * ti.Vector([radius * ti.cos(angle), radius * ti.sin(angle), height])
