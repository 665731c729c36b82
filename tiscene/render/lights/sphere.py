# SPDX-License-Identifier: Apache-2.0
"""SphereLight: a sphere that emits outwards; dark from inside. Sampled uniformly in the cone that it subtends."""

import taichi as ti

from tiscene.device.kernel_types import Template, vec2, vec3
from tiscene.render.lights.light_sample import axis, color, no_sample
from tiscene.render.sampling import warp
from tiscene.scene.lights.light_table import SIZE


@ti.func
def one_minus_cosine(values: Template, row: ti.i32, offset: vec3) -> ti.f32:
    """Return 1 - cosine of half the angle that the sphere subtends; 0 from inside."""
    sine2 = values[row, SIZE] * values[row, SIZE] / offset.dot(offset)
    result = 0.0
    if sine2 < 1.0:
        result = sine2 / (1.0 + ti.sqrt(1.0 - sine2))
    return result


@ti.func
def sample(lights: Template, textures: Template, row: ti.i32, origin: vec3, u: vec2):
    """Sample a direction from `origin` to the light; returns a LightSample."""
    values = ti.static(lights.values)
    result = no_sample()
    offset = axis(values, row, 3) - origin
    height = one_minus_cosine(values, row, offset)
    if height > 0.0:
        center_distance = offset.norm()
        towards = offset / center_distance
        w = warp.cone(u, height)
        s, t = warp.tangents(towards)
        result.direction = s * w.x + t * w.y + towards * w.z
        # Back from the ray's point nearest to the center; at the rim, rounding must not make the square negative.
        radius = values[row, SIZE]
        sine2 = w.x * w.x + w.y * w.y
        back2 = radius * radius - center_distance * center_distance * sine2
        result.distance = center_distance * w.z - ti.sqrt(ti.max(back2, 0.0))
        result.pdf = warp.cone_pdf(w, height)
        result.radiance = color(values, row)
    return result


@ti.func
def pdf(lights: Template, row: ti.i32, origin: vec3, direction: vec3, distance: ti.f32) -> ti.f32:
    """Return the density of `sample`, 1/sr, for a ray that hits the light."""
    height = one_minus_cosine(lights.values, row, axis(lights.values, row, 3) - origin)
    result = 0.0
    if height > 0.0:
        result = warp.cone_pdf(direction, height)
    return result


@ti.func
def intersect(lights: Template, row: ti.i32, origin: vec3, direction: vec3) -> ti.f32:
    """Return the distance to the outer side, +inf for a miss or from inside."""
    values = ti.static(lights.values)
    result = ti.math.inf
    offset = axis(values, row, 3) - origin
    along = offset.dot(direction)
    across = offset - direction * along
    radius = values[row, SIZE]
    back2 = radius * radius - across.dot(across)
    if along > 0.0 and back2 >= 0.0:
        distance = along - ti.sqrt(back2)
        if distance > 0.0:
            result = distance
    return result


@ti.func
def emitted(lights: Template, textures: Template, row: ti.i32, origin: vec3, direction: vec3, distance: ti.f32) -> vec3:
    """Return the radiance of the point that a ray hits."""
    return color(lights.values, row)
