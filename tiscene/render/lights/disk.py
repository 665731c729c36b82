# SPDX-License-Identifier: Apache-2.0
"""DiskLight: a disk that emits from one side, towards the light's -z. Sampled uniformly in area."""

import math

import taichi as ti

from tiscene.device.kernel_types import Template, vec2, vec3
from tiscene.render.lights.light_sample import axis, color, no_sample
from tiscene.render.sampling import warp
from tiscene.scene.lights.light_table import SIZE


@ti.func
def sample(lights: Template, textures: Template, row: ti.i32, origin: vec3, u: vec2):
    """Sample a direction from `origin` to the light; returns a LightSample."""
    values = ti.static(lights.values)
    result = no_sample()
    radius = values[row, SIZE]
    p = radius * warp.disk(u)
    offset = axis(values, row, 3) + axis(values, row, 0) * p.x + axis(values, row, 1) * p.y - origin
    distance = offset.norm()
    cosine = axis(values, row, 2).dot(offset) / distance
    if cosine > 0.0:
        result.direction = offset / distance
        result.distance = distance
        result.pdf = distance * distance / (cosine * math.pi * radius * radius)
        result.radiance = color(values, row)
    return result


@ti.func
def pdf(lights: Template, row: ti.i32, origin: vec3, direction: vec3, distance: ti.f32) -> ti.f32:
    """Return the density of `sample`, 1/sr, for a ray that hits the light at that distance."""
    values = ti.static(lights.values)
    cosine = axis(values, row, 2).dot(direction)
    radius = values[row, SIZE]
    return distance * distance / (ti.max(cosine, 1e-9) * math.pi * radius * radius)


@ti.func
def intersect(lights: Template, row: ti.i32, origin: vec3, direction: vec3) -> ti.f32:
    """Return the distance to the emitting side, +inf for a miss."""
    values = ti.static(lights.values)
    result = ti.math.inf
    normal = axis(values, row, 2)
    cosine = normal.dot(direction)
    offset = axis(values, row, 3) - origin
    distance = normal.dot(offset) / cosine
    if cosine > 0.0 and distance > 0.0:
        q = direction * distance - offset
        if q.dot(q) <= values[row, SIZE] * values[row, SIZE]:
            result = distance
    return result


@ti.func
def emitted(lights: Template, textures: Template, row: ti.i32, origin: vec3, direction: vec3, distance: ti.f32) -> vec3:
    """Return the radiance of the point that a ray hits."""
    return color(lights.values, row)
