# SPDX-License-Identifier: Apache-2.0
"""Sheen lobe: cloth by microfacets of a sinusoidal distribution.

Estevez and Kulla, "Production Friendly Microfacet Sheen BRDF" (2017), with the masking function of the paper.
"""

import math

import taichi as ti

from tiscene.device.kernel_types import Template, vec3, vec4
from tiscene.render.bsdfs.sheen_tables import (
    HARD,
    SHEEN_COSINES,
    SHEEN_ROUGHNESSES,
    SHEEN_SIZE,
    SMALLEST_ROUGHNESS,
    SOFT,
)
from tiscene.render.sampling.warp import INV_TWO_PI, circle


@ti.func
def sheen_albedo(energy: Template, cosine: ti.f32, r: ti.f32) -> ti.f32:
    """Return the albedo of white sheen from its table, which is the last of the energy tables."""
    first = energy.shape[0] - SHEEN_SIZE
    x = ti.sqrt(ti.math.clamp(cosine, 0.0, 1.0)) * (SHEEN_COSINES - 1)
    y = (ti.math.clamp(r, SMALLEST_ROUGHNESS, 1.0) - SMALLEST_ROUGHNESS) * (
        (SHEEN_ROUGHNESSES - 1) / (1.0 - SMALLEST_ROUGHNESS)
    )
    column, row = ti.min(ti.cast(x, ti.i32), SHEEN_COSINES - 2), ti.min(ti.cast(y, ti.i32), SHEEN_ROUGHNESSES - 2)
    fx, fy = x - column, y - row
    at = first + row * SHEEN_COSINES + column
    low = energy[at] * (1.0 - fx) + energy[at + 1] * fx
    high = energy[at + SHEEN_COSINES] * (1.0 - fx) + energy[at + SHEEN_COSINES + 1] * fx
    return low * (1.0 - fy) + high * fy


@ti.func
def masking(cosine: ti.f32, r: ti.f32) -> ti.f32:
    """Return Estevez and Kulla's Lambda."""
    weight = (1.0 - r) * (1.0 - r)
    fit = ti.Vector([0.0, 0.0, 0.0, 0.0, 0.0])
    for k in ti.static(range(5)):
        fit[k] = weight * SOFT[k] + (1.0 - weight) * HARD[k]
    is_steep = cosine < 0.5
    x = cosine if is_steep else ti.max(1.0 - cosine, 1e-6)
    exponent = fit[0] / (1.0 + fit[1] * ti.pow(x, fit[2])) + fit[3] * x + fit[4]
    if not is_steep:
        exponent = 2.0 * (fit[0] / (1.0 + fit[1] * ti.pow(0.5, fit[2])) + fit[3] * 0.5 + fit[4]) - exponent
    return ti.exp(exponent)


@ti.func
def sample(c: Template, u: vec3) -> vec3:
    """Sample the hemisphere uniformly, which the paper found to be more effective than microfacet normals."""
    z = 1.0 - u.x
    return vec3(ti.sqrt(ti.max(1.0 - z * z, 0.0)) * circle(u.y), z)


@ti.func
def evaluate(c: Template, energy: Template, wi: vec3) -> vec4:
    """Return (f |cos|, density of `sample`)."""
    result = vec4(0.0)
    if wi.z > 0.0:
        r = c.sheen_roughness
        m = (c.wo + wi).normalized()
        sine2 = ti.max(1.0 - m.z * m.z, 1e-12)
        density = (2.0 + 1.0 / r) * ti.pow(sine2, 0.5 / r) * (0.5 / math.pi)
        visible = 1.0 / (1.0 + masking(c.wo.z, r) + masking(wi.z, r))
        result = vec4(c.sheen * (density * visible / (4.0 * c.wo.z)), INV_TWO_PI)
    return result
