# SPDX-License-Identifier: Apache-2.0
"""Albedo tables of GGX, for energy conservation.

A microfacet model without multiple scattering loses energy as roughness grows. From its albedo E(cos, roughness), the
loss of metals is compensated (Kulla and Conty, "Revisiting Physically Based Shading at Imageworks", 2017), the diffuse
base receives what the specular layer transmits, and rough glass is rescaled (Turquin, "Practical Multiple Scattering
Compensation", 2019). The integrals use the midpoint rule over samples of visible normals; they are computed once per
process, in a tenth of a second.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from tiscene.render.bsdfs.sheen_tables import sheen_table

# Alpha of perfect mirrors and panes: 0.06 degrees, below the resolution of a pixel.
SMALLEST_ALPHA = 1e-3
# Layout. Reflection: [roughness][cosine](A, B) with E = F0 A + F90 B for Schlick's Fresnel term; then [roughness](means
# of A, B). Glass: of each index of refraction [from outside, from inside][roughness][cosine].
ROUGHNESSES, COSINES = 32, 32
GLASS_ROUGHNESSES, GLASS_COSINES = 16, 32
AVERAGES_AT = ROUGHNESSES * COSINES * 2
GLASS_AT = AVERAGES_AT + ROUGHNESSES * 2
GLASS_SIZE = 2 * GLASS_ROUGHNESSES * GLASS_COSINES

Array = NDArray[np.float64]


def energy_tables(glass_iors: Sequence[float], *, extended: bool = False) -> NDArray[np.float32]:
    """Return the array that kernels read, float32: reflection, glass, and for extended lobes the sheen table."""
    tables = [reflection_tables(), *(glass_table(ior) for ior in glass_iors)]
    if extended:
        tables.append(sheen_table())
    return np.concatenate(tables).astype(np.float32)


@cache
def reflection_tables() -> Array:
    """Return the reflection tables, flat."""
    cosines = _cosines(COSINES)
    table = np.zeros((ROUGHNESSES, COSINES, 2))
    for row, alpha in enumerate(_alphas(ROUGHNESSES)):
        wo, m = _visible_normals(cosines, alpha, 24, 32)
        cos_om = np.sum(wo * m, axis=-1)
        wi = 2.0 * cos_om[..., None] * m - wo
        unshadowed = np.where(wi[..., 2] > 0.0, _shadowing(wo, wi, alpha), 0.0)
        schlick = (1.0 - np.clip(cos_om, 0.0, 1.0)) ** 5
        table[row, :, 0] = np.mean(unshadowed * (1.0 - schlick), axis=-1)
        table[row, :, 1] = np.mean(unshadowed * schlick, axis=-1)
    table = np.concatenate([table.ravel(), (2.0 * _mean_over_cosine(table, cosines)).ravel()])
    table.setflags(write=False)
    return table


@cache
def glass_table(ior: float) -> Array:
    """Return the single-scattering albedo of a rough dielectric boundary with that index of refraction, flat."""
    cosines = _cosines(GLASS_COSINES)
    table = np.zeros((2, GLASS_ROUGHNESSES, GLASS_COSINES))
    for side, eta in enumerate((ior, 1.0 / ior)):
        for row, alpha in enumerate(_alphas(GLASS_ROUGHNESSES)):
            wo, m = _visible_normals(cosines, alpha, 24, 64)
            cos_o = np.sum(wo * m, axis=-1)
            sine2 = np.clip(1.0 - cos_o**2, 0.0, 1.0) / eta**2
            cos_t = np.sqrt(np.clip(1.0 - sine2, 0.0, 1.0))
            parallel = (eta * cos_o - cos_t) / (eta * cos_o + cos_t)
            perpendicular = (cos_o - eta * cos_t) / (cos_o + eta * cos_t)
            reflectance = np.where(sine2 >= 1.0, 1.0, 0.5 * (parallel**2 + perpendicular**2))
            up = 2.0 * cos_o[..., None] * m - wo
            down = (cos_o / eta - cos_t)[..., None] * m - wo / eta
            unshadowed_up = np.where(up[..., 2] > 0.0, _shadowing(wo, up, alpha), 0.0)
            unshadowed_down = np.where(down[..., 2] < 0.0, _shadowing(wo, down, alpha), 0.0)
            table[side, row] = np.mean(reflectance * unshadowed_up + (1.0 - reflectance) * unshadowed_down, axis=-1)
    flat = table.ravel()
    flat.setflags(write=False)
    return flat


def _cosines(count: int) -> Array:
    """Return the table's cosines, 0..1, quadratically denser at grazing angles, where the tables are steep."""
    cosines = np.linspace(0.0, 1.0, count) ** 2
    cosines[0] = 1e-4
    return cosines


def _alphas(count: int) -> Array:
    """Return the table's alphas, of uniform roughness 0..1."""
    return np.maximum(np.linspace(0.0, 1.0, count) ** 2, SMALLEST_ALPHA)


def _visible_normals(cosines: Array, alpha: float, angles: int, heights: int) -> tuple[Array, Array]:
    """Return directions [n, 1, 3] with the cosines, and midpoint samples [n, k, 3] of their visible normals.

    The directions are in the xz plane, so that half of the azimuths suffices.
    """
    wo = np.stack([np.sqrt(1.0 - cosines**2), np.zeros_like(cosines), cosines], axis=-1)[:, None]
    stretched = wo * (alpha, alpha, 1.0)
    stretched /= np.linalg.norm(stretched, axis=-1, keepdims=True)
    angle, height = np.meshgrid((np.arange(angles) + 0.5) / angles * np.pi, (np.arange(heights) + 0.5) / heights)
    z = (1.0 - height.ravel()) * (1.0 + stretched[..., 2]) - stretched[..., 2]
    radius = np.sqrt(np.clip(1.0 - z * z, 0.0, 1.0))
    half = np.stack([radius * np.cos(angle.ravel()), radius * np.sin(angle.ravel()), z], axis=-1) + stretched
    m = half * (alpha, alpha, 1.0)
    m /= np.linalg.norm(m, axis=-1, keepdims=True)
    return wo, m


def _shadowing(wo: Array, wi: Array, alpha: float) -> Array:
    """Return G2 / G1(wo), the fraction of the light from a visible facet that is not shadowed."""

    def smith(w: Array) -> Array:
        tangent2 = (w[..., 0] ** 2 + w[..., 1] ** 2) / np.maximum(w[..., 2] ** 2, 1e-20)
        return np.asarray(0.5 * (np.sqrt(1.0 + alpha * alpha * tangent2) - 1.0))

    return np.asarray((1.0 + smith(wo)) / (1.0 + smith(wo) + smith(wi)))


def _mean_over_cosine(table: Array, cosines: Array) -> Array:
    """Return the integral of table(cos) cos dcos over axis 1, by the trapezoidal rule at the table's cosines."""
    weighted = table * cosines[None, :, None]
    return np.asarray(np.sum(0.5 * (weighted[:, 1:] + weighted[:, :-1]) * np.diff(cosines)[None, :, None], axis=1))
