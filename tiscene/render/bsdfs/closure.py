# SPDX-License-Identifier: Apache-2.0
"""Closure: the lobes of UsdPreviewSurface with their weights at one point for one outgoing direction; Fresnel terms.

Directions are in the frame of the shading normal; wo.z > 0.
"""

import taichi as ti

from tiscene.device.kernel_types import Template, vec2, vec3, vec4
from tiscene.render.bsdfs.energy_tables import (
    AVERAGES_AT,
    COSINES,
    GLASS_AT,
    GLASS_COSINES,
    GLASS_ROUGHNESSES,
    GLASS_SIZE,
    ROUGHNESSES,
)

COAT_F0 = 0.04


@ti.dataclass
class Closure:
    """Parameters of the lobes. Those of a lobe with probability 0 are undefined."""

    wo: vec3
    probabilities: vec4  # of sampling each lobe, in the order of LOBES; sum 1
    diffuse: vec3  # Lambertian reflectance, times what the specular layer transmits on the way in
    layered: ti.i32  # 1: a specular layer attenuates diffuse light on its way out as well
    layer_f0: vec3  # parameters of that layer, see `layer_reflectance`
    layer_f90: ti.f32
    layer_multiple: vec3
    f0: vec3  # of the specular lobe: reflectance at normal incidence, and at grazing angles
    f90: ti.f32
    multiple: vec3  # light reflected more than once between microfacets
    roughness: ti.f32
    alpha: ti.f32
    specular: ti.f32
    coat: ti.f32
    coat_f0: ti.f32
    coat_alpha: ti.f32
    glass: ti.f32
    eta: ti.f32  # index of refraction beyond the surface over that on wo's side


@ti.func
def schlick(f0: vec3, f90: ti.f32, cosine: ti.f32) -> vec3:
    """Return Schlick's Fresnel term."""
    m = ti.math.clamp(1.0 - cosine, 0.0, 1.0)
    m2 = m * m
    return f0 + (f90 - f0) * (m2 * m2 * m)


@ti.func
def normal_reflectance(ior: ti.f32) -> ti.f32:
    """Return F0: the reflectance at normal incidence of an index of refraction, which is that of the inside."""
    return ((ior - 1.0) / (ior + 1.0)) ** 2


@ti.func
def grazing_reflectance(f0: vec3) -> ti.f32:
    """Return F90: 1, fading to 0 for F0 below 2 %, which no real surface has, to switch specular reflection off."""
    return ti.min(50.0 * f0.max(), 1.0)


@ti.func
def dielectric(cosine: ti.f32, eta: ti.f32) -> ti.f32:
    """Return the Fresnel reflectance of a dielectric for unpolarized light; 1 for total internal reflection."""
    sine2 = ti.max(1.0 - cosine * cosine, 0.0) / (eta * eta)
    result = 1.0
    if sine2 < 1.0:
        cos_t = ti.sqrt(1.0 - sine2)
        parallel = (eta * cosine - cos_t) / (eta * cosine + cos_t)
        perpendicular = (cosine - eta * cos_t) / (cosine + eta * cos_t)
        result = 0.5 * (parallel * parallel + perpendicular * perpendicular)
    return result


@ti.func
def albedo_parts(energy: Template, cosine: ti.f32, roughness: ti.f32) -> vec2:
    """Return (A, B): the single-scattering albedo of GGX for that direction is F0 A + F90 B."""
    x = ti.sqrt(ti.math.clamp(cosine, 0.0, 1.0)) * (COSINES - 1)
    y = ti.math.clamp(roughness, 0.0, 1.0) * (ROUGHNESSES - 1)
    column, row = ti.min(ti.cast(x, ti.i32), COSINES - 2), ti.min(ti.cast(y, ti.i32), ROUGHNESSES - 2)
    fx, fy = x - column, y - row
    at = 2 * (row * COSINES + column)
    below = at + 2 * COSINES
    result = vec2(0.0)
    for part in ti.static(range(2)):
        low = energy[at + part] * (1.0 - fx) + energy[at + 2 + part] * fx
        high = energy[below + part] * (1.0 - fx) + energy[below + 2 + part] * fx
        result[part] = low * (1.0 - fy) + high * fy
    return result


@ti.func
def mean_albedo_parts(energy: Template, roughness: ti.f32) -> vec2:
    """Return `albedo_parts` averaged over a cosine-weighted hemisphere."""
    y = ti.math.clamp(roughness, 0.0, 1.0) * (ROUGHNESSES - 1)
    row = ti.min(ti.cast(y, ti.i32), ROUGHNESSES - 2)
    fy = y - row
    at = AVERAGES_AT + 2 * row
    return vec2(
        energy[at] * (1.0 - fy) + energy[at + 2] * fy,
        energy[at + 1] * (1.0 - fy) + energy[at + 3] * fy,
    )


@ti.func
def glass_transfer(energy: Template, glass: ti.i32, inside: ti.i32, cosine: ti.f32, roughness: ti.f32) -> ti.f32:
    """Return the single-scattering albedo of a rough glass boundary, reflection and transmission together."""
    x = ti.sqrt(ti.math.clamp(cosine, 0.0, 1.0)) * (GLASS_COSINES - 1)
    y = ti.math.clamp(roughness, 0.0, 1.0) * (GLASS_ROUGHNESSES - 1)
    column, row = ti.min(ti.cast(x, ti.i32), GLASS_COSINES - 2), ti.min(ti.cast(y, ti.i32), GLASS_ROUGHNESSES - 2)
    fx, fy = x - column, y - row
    at = GLASS_AT + glass * GLASS_SIZE + (inside * GLASS_ROUGHNESSES + row) * GLASS_COSINES + column
    below = at + GLASS_COSINES
    low = energy[at] * (1.0 - fx) + energy[at + 1] * fx
    high = energy[below] * (1.0 - fx) + energy[below + 1] * fx
    return low * (1.0 - fy) + high * fy


@ti.func
def multiple_reflectance(f0: vec3, f90: ti.f32, mean: vec2) -> vec3:
    """Return the color of multiple scattering between microfacets: Kulla and Conty's term with Hill's numerator."""
    mean_fresnel = f0 + (f90 - f0) * (1.0 / 21.0)
    mean_albedo = mean.x + mean.y
    return mean_fresnel * mean_fresnel * mean_albedo / (1.0 - mean_fresnel * (1.0 - mean_albedo))


@ti.func
def layer_reflectance(f0: vec3, f90: ti.f32, multiple: vec3, parts: vec2) -> vec3:
    """Return the albedo of a specular layer, multiple scattering included, from `albedo_parts` or their mean."""
    return f0 * parts.x + f90 * parts.y + multiple * (1.0 - parts.x - parts.y)
