# SPDX-License-Identifier: Apache-2.0
"""Colored glass lobe: the boundary of a solid (`glass`), or a sheet without thickness; transmission has a color.

A sheet reflects and transmits without refraction. Light bounces between its two sides: with F of one side it reflects
2 F / (1 + F) (Physically Based Rendering, 4th edition, section 9.5). Transmission through a rough sheet is a mirrored
reflection that is less rough than reflection (Burley, "Extending the Disney BRDF to a BSDF", 2015, section 4.4).
"""

import taichi as ti

from tiscene.device.kernel_types import Template, vec3, vec4
from tiscene.render.bsdfs import glass
from tiscene.render.bsdfs.closure import dielectric
from tiscene.render.sampling import warp


@ti.func
def sheet_reflectance(cosine: ti.f32, ior: ti.f32) -> ti.f32:
    """Return the reflectance of a sheet, both sides together."""
    one = dielectric(cosine, ior)
    return 2.0 * one / (1.0 + one)


@ti.func
def sheet_roughness(roughness: ti.f32, ior: ti.f32) -> ti.f32:
    """Return the roughness of transmission through a sheet."""
    return ti.sqrt(ti.math.clamp(0.65 * ior - 0.35, 0.0, 1.0)) * roughness


@ti.func
def sample(c: Template, u: vec3) -> vec3:
    """Sample a direction reflected or transmitted; u.z chooses by the Fresnel term."""
    wi = vec3(0.0)
    if c.thin != 0:
        reflects = u.z < c.sheet
        alpha = c.alpha if reflects else c.sheet_alpha
        m = warp.visible_normal(u.xy, c.wo, alpha)
        wi = 2.0 * c.wo.dot(m) * m - c.wo
        if wi.z <= 0.0:
            wi = vec3(0.0)
        elif not reflects:
            wi.z = -wi.z
    else:
        wi = glass.sample(c, u)
    return wi


@ti.func
def evaluate(c: Template, energy: Template, wi: vec3) -> vec4:
    """Return (f |cos|, density of `sample`)."""
    result = vec4(0.0)
    if c.thin == 0:
        result = glass.evaluate(c, energy, wi)
    elif wi.z != 0.0:
        reflects = wi.z > 0.0
        mirrored = vec3(wi.x, wi.y, ti.abs(wi.z))
        m = (c.wo + mirrored).normalized()
        reflectance = sheet_reflectance(c.wo.dot(m), c.ior)
        alpha, scale, probability = c.sheet_alpha, (1.0 - reflectance) * c.sheet_through, 1.0 - c.sheet
        if reflects:
            alpha, scale, probability = c.alpha, reflectance * c.glass, c.sheet
        density = warp.ggx_density(m, alpha) / (4.0 * c.wo.z)
        value = scale * density * warp.ggx_masking_shadowing(c.wo, mirrored, alpha)
        result = vec4(vec3(value), probability * density * warp.ggx_masking(c.wo, alpha))
    color = c.reflected_color if wi.z > 0.0 else c.transmitted_color
    return vec4(result.xyz * color, result.w)
