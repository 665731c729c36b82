# SPDX-License-Identifier: Apache-2.0
"""Clearcoat lobe: a colorless GGX layer above all others."""

import taichi as ti

from tiscene.device.kernel_types import Template, vec3, vec4
from tiscene.render.bsdfs.closure import schlick
from tiscene.render.sampling import warp


@ti.func
def sample(c: Template, u: vec3) -> vec3:
    """Sample a direction reflected by a visible microfacet of the coat."""
    m = warp.visible_normal(u.xy, c.wo, c.coat_alpha)
    return 2.0 * c.wo.dot(m) * m - c.wo


@ti.func
def evaluate(c: Template, energy: Template, wi: vec3) -> vec4:
    """Return (f |cos|, density of `sample`)."""
    result = vec4(0.0)
    if wi.z > 0.0:
        m = (c.wo + wi).normalized()
        density = warp.ggx_density(m, c.coat_alpha) / (4.0 * c.wo.z)
        visible = warp.ggx_masking_shadowing(c.wo, wi, c.coat_alpha)
        f = schlick(vec3(c.coat_f0), 1.0, c.wo.dot(m)) * (c.coat * density * visible)
        result = vec4(f, density * warp.ggx_masking(c.wo, c.coat_alpha))
    return result
