# SPDX-License-Identifier: Apache-2.0
"""DistantLight: light from infinity along the light's -z, parallel or uniform over a cone of directions (a sun)."""

import taichi as ti

from tiscene.device.kernel_types import Template, vec2, vec3
from tiscene.render.lights.light_sample import FAR, axis, color, no_sample
from tiscene.render.sampling import warp
from tiscene.scene.lights.light_table import SIZE


@ti.func
def sample(lights: Template, textures: Template, row: ti.i32, origin: vec3, u: vec2):
    """Sample a direction to the light; returns a LightSample. u: unused for parallel light."""
    values = ti.static(lights.values)
    result = no_sample()
    towards = axis(values, row, 2)
    height = values[row, SIZE + 1]
    result.direction = towards
    result.distance = FAR
    result.radiance = color(values, row)
    result.pdf = 1.0
    result.delta = 1
    if height > 0.0:
        w = warp.cone(u, height)
        s, t = warp.tangents(towards)
        result.direction = s * w.x + t * w.y + towards * w.z
        result.pdf = warp.cone_pdf(w, height)
        result.delta = 0
    return result


@ti.func
def is_inside_cone(values: Template, row: ti.i32, direction: vec3):
    """Return 1 if a direction is in the light's cone, else 0. Compares distances: precise for small cones."""
    across = direction - axis(values, row, 2)
    return ti.cast(0.5 * across.dot(across) <= values[row, SIZE + 1] and values[row, SIZE + 1] > 0.0, ti.i32)


@ti.func
def pdf(lights: Template, row: ti.i32, origin: vec3, direction: vec3, distance: ti.f32) -> ti.f32:
    """Return the density of `sample`, 1/sr; 0 for parallel light."""
    result = 0.0
    if is_inside_cone(lights.values, row, direction):
        result = warp.cone_pdf(direction, lights.values[row, SIZE + 1])
    return result


@ti.func
def emitted(lights: Template, textures: Template, row: ti.i32, origin: vec3, direction: vec3, distance: ti.f32) -> vec3:
    """Return the radiance along an unoccluded ray."""
    result = vec3(0.0)
    if is_inside_cone(lights.values, row, direction):
        result = color(lights.values, row)
    return result
