# SPDX-License-Identifier: Apache-2.0
"""Anisotropic specular lobe: GGX with two alphas, along the x and y axes of the shading frame.

Heitz, "Understanding the Masking-Shadowing Function in Microfacet-Based BRDFs" (2014); visible normals as in `warp`.
"""

import taichi as ti

from tiscene.device.kernel_types import Template, vec2, vec3, vec4
from tiscene.render.bsdfs.closure import albedo_parts, schlick
from tiscene.render.bsdfs.energy_tables import SMALLEST_ALPHA
from tiscene.render.sampling.warp import INV_PI, circle


@ti.func
def alphas_of(roughness: ti.f32, anisotropy: ti.f32) -> vec2:
    """Return both alphas: their ratio is 1 - anisotropy, the mean of their squares roughness⁴ (OpenPBR)."""
    aspect = ti.math.clamp(1.0 - anisotropy, 0.01, 1.0)
    x = roughness * roughness * ti.sqrt(2.0 / (1.0 + aspect * aspect))
    return vec2(ti.math.clamp(x, SMALLEST_ALPHA, 1.0), ti.math.clamp(aspect * x, SMALLEST_ALPHA, 1.0))


@ti.func
def layer_parts(c: Template, energy: Template, w: vec3) -> vec2:
    """Return `albedo_parts` for a direction, by the alpha that its azimuth sees; exact for one alpha.

    For two, the part at grazing angles is within 0.02 of the integral, on which light below a dielectric depends.
    """
    x, y = c.alphas.x * w.x, c.alphas.y * w.y
    level = w.x * w.x + w.y * w.y
    roughness = c.roughness
    if c.alphas.x != c.alphas.y and level > 1e-9:
        roughness = ti.sqrt(ti.sqrt((x * x + y * y) / level))
    return albedo_parts(energy, ti.abs(w.z), roughness)


@ti.func
def lost_fraction(c: Template, energy: Template, w: vec3) -> ti.f32:
    """Return the fraction of light that microfacets of a white metal lose, at most: 1 - albedo for one alpha.

    For two it is an estimate from below, found by comparison with integrals, so that metals create no light.
    """
    plain = albedo_parts(energy, ti.abs(w.z), c.roughness)
    lost = 1.0 - plain.x - plain.y
    if c.alphas.x != c.alphas.y:
        seen = layer_parts(c, energy, w)
        lost = ti.max(ti.min(lost, 1.0 - seen.x - seen.y), 0.0) * _caution(c)
    return lost


@ti.func
def mean_lost_fraction(c: Template, mean: vec2) -> ti.f32:
    """Return `lost_fraction` averaged over a cosine-weighted hemisphere, at least. mean: `mean_albedo_parts`."""
    return (1.0 - mean.x - mean.y) * _caution(c)


@ti.func
def _caution(c: Template) -> ti.f32:
    aspect = 1.0 - c.alphas.y / c.alphas.x
    return 1.0 - 0.3 * aspect * aspect


@ti.func
def density_of(m: vec3, alpha: vec2) -> ti.f32:
    """Return GGX's D(m), microfacet area per solid angle."""
    z2 = ti.max(m.z * m.z, 1e-20)
    x, y = m.x / alpha.x, m.y / alpha.y
    denominator = z2 + x * x + y * y
    return INV_PI / ti.max(alpha.x * alpha.y * denominator * denominator, 1e-30)


@ti.func
def lambda_of(w: vec3, alpha: vec2) -> ti.f32:
    """Return Smith's Lambda."""
    x, y = alpha.x * w.x, alpha.y * w.y
    return 0.5 * (ti.sqrt(1.0 + (x * x + y * y) / ti.max(w.z * w.z, 1e-20)) - 1.0)


@ti.func
def sample(c: Template, u: vec3) -> vec3:
    """Sample a direction reflected by a visible microfacet."""
    stretched = vec3(c.alphas.x * c.wo.x, c.alphas.y * c.wo.y, c.wo.z).normalized()
    z = (1.0 - u.y) * (1.0 + stretched.z) - stretched.z
    half = vec3(ti.sqrt(ti.max(1.0 - z * z, 0.0)) * circle(u.x), z) + stretched
    m = vec3(c.alphas.x * half.x, c.alphas.y * half.y, ti.max(half.z, 1e-12)).normalized()
    return 2.0 * c.wo.dot(m) * m - c.wo


@ti.func
def evaluate(c: Template, energy: Template, wi: vec3) -> vec4:
    """Return (f |cos|, density of `sample`)."""
    result = vec4(0.0)
    if wi.z > 0.0:
        m = (c.wo + wi).normalized()
        density = density_of(m, c.alphas) / (4.0 * c.wo.z)
        masked = lambda_of(c.wo, c.alphas)
        visible = density / (1.0 + masked + lambda_of(wi, c.alphas))
        f = schlick(c.f0, c.f90, c.wo.dot(m)) * (c.specular * visible)
        result = vec4(f, density / (1.0 + masked))
    return result
