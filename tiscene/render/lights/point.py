# SPDX-License-Identifier: Apache-2.0
"""SphereLight of radius 0: a point whose `radiance` is an intensity, W/sr. No ray hits it."""

import taichi as ti

from tiscene.device.kernel_types import Template, vec2, vec3
from tiscene.render.lights.light_sample import axis, color, no_sample


@ti.func
def sample(lights: Template, textures: Template, row: ti.i32, origin: vec3, u: vec2):
    """Return the direction from `origin` to the light as a LightSample; u: unused."""
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
