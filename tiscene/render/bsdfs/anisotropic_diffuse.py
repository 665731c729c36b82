# SPDX-License-Identifier: Apache-2.0
"""Diffuse lobe below an anisotropic specular layer, and multiple scattering between its microfacets; see `diffuse`."""

import math

import taichi as ti

from tiscene.device.kernel_types import Template, vec3, vec4
from tiscene.render.bsdfs.anisotropic import layer_parts, lost_fraction
from tiscene.render.bsdfs.closure import layer_reflectance
from tiscene.render.sampling import warp


@ti.func
def sample(c: Template, u: vec3) -> vec3:
    """Sample a cosine-distributed direction."""
    return warp.cosine_hemisphere(u.xy)


@ti.func
def evaluate(c: Template, energy: Template, wi: vec3) -> vec4:
    """Return (f |cos|, density of `sample`)."""
    result = vec4(0.0)
    if wi.z > 0.0:
        parts = layer_parts(c, energy, wi)
        f = c.diffuse * (1.0 - layer_reflectance(c.layer_f0, c.layer_f90, c.layer_multiple, parts))
        f += c.multiple * lost_fraction(c, energy, wi)
        pdf = wi.z * (1.0 / math.pi)
        result = vec4(f * pdf, pdf)
    return result
