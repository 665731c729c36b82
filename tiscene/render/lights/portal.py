# SPDX-License-Identifier: Apache-2.0
"""Portals: rectangles through which a dome's light enters along their -z, sampled like a RectLight.

The densities of all portals that a direction crosses add up (`dispatch.dome_densities`). A path may also leave by an
opening without a portal; then the density of light sampling is that of the dome's image alone.
"""

import taichi as ti

from tiscene.device.kernel_types import Template, vec2, vec3
from tiscene.render.lights import dome, rect
from tiscene.render.lights.light_sample import FAR, integer
from tiscene.scene.lights.light_table import DOME_ROW


@ti.func
def sample(lights: Template, textures: Template, row: ti.i32, origin: vec3, u: vec2):
    """Sample a direction through the portal; returns a LightSample of its dome."""
    result = rect.sample(lights, textures, row, origin, u)
    result.row = integer(lights.values, row, DOME_ROW)
    result.distance = FAR
    if result.pdf > 0.0:
        result.radiance = dome.radiance_from(lights, textures, result.row, result.direction, result.pdf)
    return result
