# SPDX-License-Identifier: Apache-2.0
"""Translucent lobe: Lambertian transmission through a thin sheet, below the specular layers of its two sides."""

import math

import taichi as ti

from tiscene.device.kernel_types import Template, vec3, vec4
from tiscene.render.bsdfs.anisotropic import layer_parts
from tiscene.render.bsdfs.closure import layer_reflectance
from tiscene.render.sampling import warp


@ti.func
def sample(c: Template, u: vec3) -> vec3:
    """Sample a cosine-distributed direction on the other side."""
    return -1.0 * warp.cosine_hemisphere(u.xy)


@ti.func
def evaluate(c: Template, energy: Template, wi: vec3) -> vec4:
    """Return (f |cos|, density of `sample`)."""
    result = vec4(0.0)
    if wi.z < 0.0:
        parts = layer_parts(c, energy, wi)
        f = c.translucent * (1.0 - layer_reflectance(c.layer_f0, c.layer_f90, c.layer_multiple, parts))
        pdf = -wi.z * (1.0 / math.pi)
        result = vec4(f * pdf, pdf)
    return result
