# SPDX-License-Identifier: Apache-2.0
"""A rectangle that a dome's light comes in by, along its -z: sampled as a RectLight is, far away as the dome.

Where a direction crosses several portals, each of them could have led to it, and their densities add up: see
`all_lights`. A path may well leave by another way: then no density of light sampling counts against it.
"""

import taichi as ti

from tiscene.device.kernel_types import Template, vec2, vec3
from tiscene.render.lights import dome, rect
from tiscene.render.lights.light_sample import FAR, integer
from tiscene.scene.lights.light_table import DOME_ROW


@ti.func
def sample(lights: Template, textures: Template, row: ti.i32, origin: vec3, u: vec2):
    """A direction through the portal: a LightSample of its dome."""
    result = rect.sample(lights, textures, row, origin, u)
    result.row = integer(lights.values, row, DOME_ROW)
    result.distance = FAR
    if result.pdf > 0.0:
        result.radiance = dome.radiance_from(lights, textures, result.row, result.direction, result.pdf)
    return result


@ti.func
def pdf(lights: Template, row: ti.i32, origin: vec3, direction: vec3, distance: ti.f32) -> ti.f32:
    """Density of `sample` for a direction that crosses the portal at that distance."""
    return rect.pdf(lights, row, origin, direction, distance)


@ti.func
def intersect(lights: Template, row: ti.i32, origin: vec3, direction: vec3) -> ti.f32:
    """Distance to where a direction crosses the portal against its way in, +inf where it does not."""
    return rect.intersect(lights, row, origin, direction)


@ti.func
def emitted(lights: Template, textures: Template, row: ti.i32, origin: vec3, direction: vec3, distance: ti.f32) -> vec3:
    """Nothing: light comes from the dome."""
    return vec3(0.0)
