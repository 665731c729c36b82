# SPDX-License-Identifier: Apache-2.0
"""A point (a sphere of radius 0): its `radiance` is an intensity, W/sr. No ray meets it."""

import taichi as ti

from tiscene.device.kernel_types import Template, vec2, vec3
from tiscene.render.lights.light_sample import axis, color, no_sample


@ti.func
def sample(lights: Template, textures: Template, row: ti.i32, origin: vec3, u: vec2):
    """The direction from `origin` to the light: a LightSample."""
    result = no_sample()
    offset = axis(lights.values, row, 3) - origin
    squared = offset.dot(offset)
    if squared > 0.0:
        result.distance = ti.sqrt(squared)
        result.direction = offset / result.distance
        result.radiance = color(lights.values, row) / squared
        result.pdf = 1.0
        result.delta = 1
    return result


@ti.func
def pdf(lights: Template, row: ti.i32, origin: vec3, direction: vec3, distance: ti.f32) -> ti.f32:
    """0: no other way leads to it."""
    return 0.0


@ti.func
def intersect(lights: Template, row: ti.i32, origin: vec3, direction: vec3) -> ti.f32:
    """Never met: +inf."""
    return ti.math.inf


@ti.func
def emitted(lights: Template, textures: Template, row: ti.i32, origin: vec3, direction: vec3, distance: ti.f32) -> vec3:
    """Nothing that a ray could meet."""
    return vec3(0.0)
