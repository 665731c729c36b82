# SPDX-License-Identifier: Apache-2.0
"""Warps from the unit square to distributions, each followed by its density (pbrt: sampling routines).

Directions are in a local frame whose z axis is the normal; densities are per steradian, on the disk per unit area.
Sources: concentric disk, Shirley and Chiu 1997; spherical rectangle, Ureña, Fajardo and King 2013; visible normals,
Heitz 2018 in the spherical-cap form of Dupuy and Benyoub 2023; basis, Duff et al. 2017.
"""

import math
from collections.abc import Callable

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.kernel_types import Template, vec2, vec3

INV_PI = 1.0 / math.pi
INV_TWO_PI = 0.5 / math.pi
INV_FOUR_PI = 0.25 / math.pi


def _polynomial(function: Callable[[NDArray[np.float64]], NDArray[np.float64]], end: float, terms: int) -> list[float]:
    """Fit a polynomial in s to function(s) on 0..end at Chebyshev nodes; coefficients, lowest first."""
    nodes = 0.5 * end * (1.0 - np.cos(math.pi * (np.arange(4 * terms) + 0.5) / (4 * terms)))
    return [float(c) for c in np.polynomial.Polynomial.fit(nodes, function(nodes), terms - 1).convert().coef]


# Polynomials instead of the C library's functions: three times as fast, and the same bits on every machine.
SINE = _polynomial(lambda s: 2.0 * math.pi * np.sinc(2.0 * np.sqrt(s)), 1.0 / 64.0, 5)
COSINE = _polynomial(lambda s: np.cos(2.0 * math.pi * np.sqrt(s)), 1.0 / 64.0, 5)
ARCTANGENT = _polynomial(lambda s: np.arctan(np.sqrt(s)) / np.sqrt(s), 1.0, 9)
_TURNS = _polynomial(lambda s: np.arctan(np.sqrt(s)) / np.sqrt(s) * (0.5 / math.pi), 1.0, 7)
_ARCCOSINE = _polynomial(lambda s: np.arccos(s) / np.sqrt(1.0 - s) / math.pi, 1.0, 7)


@ti.func
def polynomial(coefficients: Template, s):
    """Evaluate a polynomial by Horner's rule; of a scalar or of lanes."""
    result = coefficients[-1] * s + coefficients[-2]
    for k in ti.static(range(len(coefficients) - 3, -1, -1)):
        result = result * s + coefficients[k]
    return result


@ti.func
def circle(turns: ti.f32) -> vec2:
    """Return (cosine, sine) of an angle in turns, of any size; most precise near 0."""
    quarter = ti.floor(4.0 * turns + 0.5)
    rest = turns - 0.25 * quarter
    squared = rest * rest
    cosine, sine = polynomial(COSINE, squared), rest * polynomial(SINE, squared)
    quadrant = ti.cast(quarter, ti.i32) & 3
    result = vec2(cosine, sine)
    if quadrant & 1:
        result = vec2(-sine, cosine)
    if quadrant & 2:
        result = -1.0 * result
    return result


@ti.func
def angle_of(direction: vec2) -> ti.f32:
    """Return the angle of a unit vector, -pi..pi."""
    # By the tangent of half the angle, which is continuous except at -pi and pi.
    half = direction.y / ti.max(1.0 + direction.x, 1e-30)
    steep = ti.abs(half) > 1.0
    t = 1.0 / half if steep else half
    angle = t * polynomial(ARCTANGENT, t * t)
    if steep:
        angle = (0.5 * math.pi if half > 0.0 else -0.5 * math.pi) - angle
    return 2.0 * angle


@ti.func
def azimuth(v: vec2) -> ti.f32:
    """Return the angle of a vector of any length in turns, -0.5..0.5, to 1e-6."""
    flat = ti.abs(v.x) > ti.abs(v.y)
    t = ti.select(flat, v.y, -v.x) / ti.select(flat, v.x, ti.select(v.y == 0.0, 1.0, v.y))
    turns = t * polynomial(_TURNS, t * t)
    behind = ti.select(v.y < 0.0, -0.5, 0.5)
    return turns + ti.select(flat, ti.select(v.x < 0.0, behind, 0.0), 0.5 * behind)


@ti.func
def polar_angle(cosine: ti.f32) -> ti.f32:
    """Return the angle from the pole in half turns, 0..1, to 1e-6."""
    c = ti.abs(cosine)
    angle = ti.sqrt(ti.max(1.0 - c, 0.0)) * polynomial(_ARCCOSINE, c)
    return ti.select(cosine < 0.0, 1.0 - angle, angle)


@ti.func
def tangents(n: vec3):
    """Return two unit vectors that form a right-handed frame with the unit vector n."""
    sign = 1.0
    if n.z < 0.0:
        sign = -1.0
    a = -1.0 / (sign + n.z)
    b = n.x * n.y * a
    return vec3(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), vec3(b, sign + n.y * n.y * a, -n.y)


@ti.func
def on_arc(radius, part):
    """Return radius * (cosine, sine) of `part` turns, at most 1/8; of scalars or lanes."""
    squared = part * part
    return radius * polynomial(COSINE, squared), radius * part * polynomial(SINE, squared)


@ti.func
def disk(u: vec2) -> vec2:
    """Sample the unit disk uniformly, by the concentric map."""
    p = 2.0 * u - 1.0
    flat = ti.abs(p.x) > ti.abs(p.y)
    radius = p.x if flat else p.y
    other = p.y if flat else p.x
    # Up to 1/8 turn to either side; the cosine is that of the larger coordinate.
    part = 0.125 * other / (radius if radius != 0.0 else 1.0)
    cosine, sine = on_arc(radius, part)
    return vec2(cosine, sine) if flat else vec2(sine, cosine)


@ti.func
def cosine_hemisphere(u: vec2) -> vec3:
    """Sample a cosine-weighted hemisphere."""
    p = disk(u)
    return vec3(p.x, p.y, ti.sqrt(ti.max(1.0 - p.dot(p), 0.0)))


@ti.func
def cosine_hemisphere_pdf(w: vec3) -> ti.f32:
    """Return the density of `cosine_hemisphere`."""
    return ti.max(w.z, 0.0) * INV_PI


@ti.func
def sphere(u: vec2) -> vec3:
    """Sample all directions uniformly."""
    z = 1.0 - 2.0 * u.x
    return vec3(ti.sqrt(ti.max(1.0 - z * z, 0.0)) * circle(u.y), z)


@ti.func
def sphere_pdf(w: vec3) -> ti.f32:
    """Return the density of `sphere`."""
    return INV_FOUR_PI


@ti.func
def cone(u: vec2, one_minus_cosine: ti.f32) -> vec3:
    """Sample a cone about z uniformly. one_minus_cosine: of its half angle; the cosine of a small cone is imprecise."""
    height = u.x * one_minus_cosine
    return vec3(ti.sqrt(ti.max(height * (2.0 - height), 0.0)) * circle(u.y), 1.0 - height)


@ti.func
def cone_pdf(w: vec3, one_minus_cosine: ti.f32) -> ti.f32:
    """Return the density of `cone`, for a direction inside."""
    return INV_TWO_PI / one_minus_cosine


@ti.dataclass
class RectangleView:
    """A rectangle [x0, x1] x [y0, y1] in the plane z = z0 of its own frame, seen from the frame's origin."""

    x0: ti.f32
    x1: ti.f32
    y0: ti.f32
    y1: ti.f32
    z0: ti.f32
    sine_y0: ti.f32  # y0 / sqrt(y0^2 + z0^2), likewise for y1
    sine_y1: ti.f32
    first_angle: vec2  # cosine and sine
    solid_angle: ti.f32  # sr


@ti.func
def angle_from_sine(sine: ti.f32) -> vec2:
    """Return (cosine, sine) of an angle in -pi/2..pi/2 from its sine."""
    return vec2(ti.sqrt(ti.max(1.0 - sine * sine, 0.0)), sine)


@ti.func
def add_angles(a: vec2, b: vec2) -> vec2:
    """Return (cosine, sine) of the sum of two angles, from theirs."""
    return vec2(a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x)


@ti.func
def subtract_angles(a: vec2, b: vec2) -> vec2:
    """Return (cosine, sine) of the difference of two angles."""
    return vec2(a.x * b.x + a.y * b.y, a.y * b.x - a.x * b.y)


@ti.func
def rectangle_view(x0: ti.f32, x1: ti.f32, y0: ti.f32, y1: ti.f32, z0: ti.f32):
    """Return the constants of Ureña's method.

    Sums of arccosines are products of rotations here, which is precise for small solid angles and needs one arctangent.
    """
    zz = z0 * z0
    a0 = x0 / ti.sqrt(x0 * x0 + zz)
    a1 = x1 / ti.sqrt(x1 * x1 + zz)
    b0 = y0 / ti.sqrt(y0 * y0 + zz)
    b1 = y1 / ti.sqrt(y1 * y1 + zz)
    first = subtract_angles(angle_from_sine(a0 * b1), angle_from_sine(a0 * b0))
    whole = subtract_angles(subtract_angles(angle_from_sine(a1 * b1), angle_from_sine(a1 * b0)), first)
    solid_angle = angle_of(whole)
    if solid_angle < 0.0:
        # Above half the sphere; a sliver made negative by rounding counts as 0.
        solid_angle = solid_angle + 2.0 * math.pi if whole.x < 0.0 or solid_angle < -1e-3 else 0.0
    return RectangleView(x0, x1, y0, y1, z0, b0, b1, first, solid_angle)


@ti.func
def rectangle(view: RectangleView, u: vec2) -> vec2:
    """Sample a point (x, y) of the rectangle uniformly in solid angle."""
    angle = add_angles(circle(u.x * view.solid_angle * INV_TWO_PI), view.first_angle)
    sine = angle.y
    if ti.abs(sine) < 1e-12:
        sine = 1e-12
    f = (view.sine_y1 - view.sine_y0 * angle.x) / sine
    # x / |z0| is the cotangent of an angle whose cosine is the sign of f over sqrt(f^2 + sine_y0^2).
    tangent2 = ti.max(f * f + view.sine_y0 * view.sine_y0 - 1.0, 1e-14)
    x = ti.abs(view.z0) / ti.sqrt(tangent2)
    x = ti.math.clamp(x if f > 0.0 else -x, view.x0, view.x1)
    dd = x * x + view.z0 * view.z0
    h0 = view.y0 / ti.sqrt(dd + view.y0 * view.y0)
    h1 = view.y1 / ti.sqrt(dd + view.y1 * view.y1)
    h = h0 + u.y * (h1 - h0)
    y = h * ti.sqrt(dd / ti.max(1.0 - h * h, 1e-14))
    return vec2(x, ti.math.clamp(y, view.y0, view.y1))


@ti.func
def rectangle_pdf(view: RectangleView) -> ti.f32:
    """Return the density of the direction to the point of `rectangle`."""
    return 1.0 / view.solid_angle


@ti.func
def visible_normal(u: vec2, wo: vec3, alpha: ti.f32) -> vec3:
    """Sample a visible microfacet normal of GGX for wo, wo.z > 0."""
    stretched = vec3(alpha * wo.x, alpha * wo.y, wo.z).normalized()
    z = (1.0 - u.y) * (1.0 + stretched.z) - stretched.z
    half = vec3(ti.sqrt(ti.max(1.0 - z * z, 0.0)) * circle(u.x), z) + stretched
    return vec3(alpha * half.x, alpha * half.y, ti.max(half.z, 1e-12)).normalized()


@ti.func
def ggx_density(m: vec3, alpha: ti.f32) -> ti.f32:
    """Return GGX's D(m), microfacet area per solid angle, in a form that is precise for m near z."""
    tangent2 = (m.x * m.x + m.y * m.y) / ti.max(m.z * m.z, 1e-20)
    a2 = alpha * alpha
    denominator = m.z * m.z * (a2 + tangent2)
    return a2 * INV_PI / ti.max(denominator * denominator, 1e-30)


@ti.func
def ggx_lambda(w: vec3, alpha: ti.f32) -> ti.f32:
    """Return Smith's Lambda."""
    tangent2 = (w.x * w.x + w.y * w.y) / ti.max(w.z * w.z, 1e-20)
    return 0.5 * (ti.sqrt(1.0 + alpha * alpha * tangent2) - 1.0)


@ti.func
def ggx_masking(w: vec3, alpha: ti.f32) -> ti.f32:
    """Return Smith's G1, the fraction of microfacets visible from w."""
    return 1.0 / (1.0 + ggx_lambda(w, alpha))


@ti.func
def ggx_masking_shadowing(wo: vec3, wi: vec3, alpha: ti.f32) -> ti.f32:
    """Return Smith's height-correlated G2, the fraction visible from both."""
    return 1.0 / (1.0 + ggx_lambda(wo, alpha) + ggx_lambda(wi, alpha))
