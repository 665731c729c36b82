# SPDX-License-Identifier: Apache-2.0
"""Glass lobe: a rough dielectric boundary, GGX reflection and refraction (Walter et al. 2007), exact Fresnel term.

It transports radiance: refraction scales it by the squared ratio of the indices. `c.glass` includes the energy
compensation.
"""

import taichi as ti

from tiscene.device.kernel_types import Template, vec3, vec4
from tiscene.render.bsdfs.closure import dielectric
from tiscene.render.sampling import warp


@ti.func
def sample(c: Template, u: vec3) -> vec3:
    """Sample a direction reflected or refracted by a visible microfacet; u.z chooses by the Fresnel term.

    Returns zero where the light would hit a second microfacet.
    """
    m = warp.visible_normal(u.xy, c.wo, c.alpha)
    cosine = c.wo.dot(m)
    wi = 2.0 * cosine * m - c.wo
    side = 1.0
    if u.z >= dielectric(cosine, c.eta):
        cos_t = ti.sqrt(ti.max(1.0 - (1.0 - cosine * cosine) / (c.eta * c.eta), 0.0))
        wi = (cosine / c.eta - cos_t) * m - c.wo / c.eta
        side = -1.0
    return wi.normalized() if wi.z * side > 0.0 else vec3(0.0)


@ti.func
def evaluate(c: Template, energy: Template, wi: vec3) -> vec4:
    """Return (f |cos|, density of `sample`)."""
    result = vec4(0.0)
    reflects = wi.z > 0.0
    m = c.wo + wi
    if not reflects:
        m = c.wo + c.eta * wi
    m = m.normalized()
    if m.z < 0.0:
        m = -1.0 * m
    cos_o, cos_i = c.wo.dot(m), wi.dot(m)
    if wi.z != 0.0 and cos_o > 0.0 and cos_i * wi.z > 0.0:
        fresnel = dielectric(cos_o, c.eta)
        visible = warp.ggx_masking_shadowing(c.wo, wi, c.alpha)
        density = warp.ggx_density(m, c.alpha) / c.wo.z
        if reflects:
            density *= 0.25 * fresnel
            visible *= c.glass
        else:
            denominator = cos_i + cos_o / c.eta
            density *= (1.0 - fresnel) * cos_o * ti.abs(cos_i) / (denominator * denominator)
            visible *= c.glass / (c.eta * c.eta)
        result = vec4(vec3(visible * density), density * warp.ggx_masking(c.wo, c.alpha))
    return result
