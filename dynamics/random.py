# SPDX-License-Identifier: Apache-2.0
"""Counter-based random numbers: hashes of (seed, body, bounce, draw), without any state.

The numbers of one body depend on no other body, on no thread and on no earlier frame. Taichi functions.
"""

import math

import taichi as ti

TWO_PI = 2.0 * math.pi


@ti.func
def pcg4d(a: ti.u32, b: ti.u32, c: ti.u32, d: ti.u32):
    """Return four 32-bit words, each mixed from all four arguments.

    pcg4d of Jarzynski and Olano, "Hash Functions for GPU Rendering", JCGT 2020.
    """
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
    """Return four uniform float64 in (0, 1): the centers of 2^32 equal cells.

    Args:
        seed: Seed of the dynamic.
        number: Hash of the body's name.
        bounce: Index of the bounce.
        draw: Index of the draw at this bounce.
    """
    words = pcg4d(ti.cast(seed, ti.u32), ti.cast(number, ti.u32), ti.cast(bounce, ti.u32), ti.cast(draw, ti.u32))
    cell = 1.0 / ti.cast(4294967296.0, ti.f64)
    return (ti.cast(words, ti.f64) + 0.5) * cell


@ti.func
def hemisphere(normal, a, b):
    """Return a unit vector, uniform over the hemisphere about the unit vector `normal`, from two uniform numbers."""
    # Any vector that is not parallel to the normal gives a tangent.
    zero = normal[0] * 0.0
    other = ti.Vector([zero + 1.0, zero, zero])
    if ti.abs(normal[0]) > 0.7:
        other = ti.Vector([zero, zero + 1.0, zero])
    tangent = other.cross(normal).normalized()
    bitangent = normal.cross(tangent)
    # Archimedes' hat-box theorem: the height of a uniform point on a sphere is uniform.
    radius = ti.sqrt(ti.max(1.0 - a * a, 0.0))
    angle = TWO_PI * b
    return radius * ti.cos(angle) * tangent + radius * ti.sin(angle) * bitangent + a * normal


@ti.func
def ball(a, b, c):
    """Return a vector, uniform in the unit ball, from three uniform numbers."""
    height = 1.0 - 2.0 * a
    radius = ti.sqrt(ti.max(1.0 - height * height, 0.0))
    angle = TWO_PI * b
    length = ti.pow(c, 1.0 / ti.cast(3.0, ti.f64))
    return length * ti.Vector([radius * ti.cos(angle), radius * ti.sin(angle), height])
