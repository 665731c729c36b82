# SPDX-License-Identifier: Apache-2.0
"""CylinderLight: the side of a cylinder about the light's x axis, without caps, which emits outwards.

Sampled uniformly in the angle about an axis through the shading point that is parallel to the light's, then in the
angle along it, so that the density is bounded at any distance (cf. Kulla and Fajardo, equiangular sampling, 2012).
"""

import taichi as ti

from tiscene.device.kernel_types import Template, vec2, vec3
from tiscene.render.lights.light_sample import axis, color, from_light, no_sample, to_light
from tiscene.render.sampling import warp
from tiscene.scene.lights.light_table import SIZE


@ti.func
def half_angle(radius: ti.f32, distance: ti.f32) -> ti.f32:
    """Return half the angle, rad, that the side subtends across its axis from that distance; 0 from inside."""
    result = 0.0
    sine = radius / distance
    if sine < 1.0:
        result = warp.angle_of(vec2(ti.sqrt(1.0 - sine * sine), sine))
    return result


@ti.func
def angle_along(low: ti.f32, high: ti.f32, away: ti.f32) -> ti.f32:
    """Return the angle between two points of a line at distance `away`; low, high: offsets from its nearest point."""
    return warp.angle_of(vec2(away * away + low * high, away * (high - low)).normalized())


@ti.func
def sample(lights: Template, textures: Template, row: ti.i32, origin: vec3, u: vec2):
    """Sample a direction from `origin` to the light; returns a LightSample."""
    values = ti.static(lights.values)
    result = no_sample()
    radius, length = values[row, SIZE], values[row, SIZE + 1]
    o = to_light(values, row, origin - axis(values, row, 3))
    axis_distance = ti.sqrt(o.y * o.y + o.z * o.z)
    half = half_angle(radius, axis_distance)
    if half > 0.0:
        turn = warp.circle((2.0 * u.y - 1.0) * half * warp.INV_TWO_PI)
        inwards = vec2(o.y, o.z) / -axis_distance
        across = vec2(inwards.x * turn.x - inwards.y * turn.y, inwards.x * turn.y + inwards.y * turn.x)
        miss = axis_distance * turn.y
        away = axis_distance * turn.x - ti.sqrt(ti.max(radius * radius - miss * miss, 0.0))
        low = -0.5 * length - o.x
        angle = angle_along(low, low + length, away)
        climb = warp.circle(u.x * angle * warp.INV_TWO_PI)
        first = vec2(away, low).normalized()
        w = vec2(first.x * climb.x - first.y * climb.y, first.x * climb.y + first.y * climb.x)
        result.direction = from_light(values, row, vec3(w.y, w.x * across)).normalized()
        result.distance = away / w.x
        result.pdf = 1.0 / (2.0 * half * angle * w.x)
        result.radiance = color(values, row)
    return result


@ti.func
def pdf(lights: Template, row: ti.i32, origin: vec3, direction: vec3, distance: ti.f32) -> ti.f32:
    """Return the density of `sample`, 1/sr, for a ray that hits the light at that distance."""
    values = ti.static(lights.values)
    radius, length = values[row, SIZE], values[row, SIZE + 1]
    o = to_light(values, row, origin - axis(values, row, 3))
    w = to_light(values, row, direction)
    half = half_angle(radius, ti.sqrt(o.y * o.y + o.z * o.z))
    result = 0.0
    if half > 0.0:
        level = ti.max(ti.sqrt(w.y * w.y + w.z * w.z), 1e-9)
        low = -0.5 * length - o.x
        result = 1.0 / (2.0 * half * angle_along(low, low + length, level * distance) * level)
    return result


@ti.func
def normal_at(values: Template, row: ti.i32, point: vec3) -> vec3:
    """Return the outward normal at a point of the side."""
    offset = point - axis(values, row, 3)
    along = axis(values, row, 0)
    return (offset - along * along.dot(offset)).normalized()


@ti.func
def intersect(lights: Template, row: ti.i32, origin: vec3, direction: vec3) -> ti.f32:
    """Return the distance to the outer side, +inf for a miss or from inside."""
    values = ti.static(lights.values)
    result = ti.math.inf
    radius, length = values[row, SIZE], values[row, SIZE + 1]
    o = to_light(values, row, origin - axis(values, row, 3))
    d = to_light(values, row, direction)
    across = d.y * d.y + d.z * d.z
    if across > 1e-12:
        nearest = -(o.y * d.y + o.z * d.z) / across
        miss = vec2(o.y + d.y * nearest, o.z + d.z * nearest)
        back2 = radius * radius - miss.dot(miss)
        if back2 >= 0.0:
            distance = nearest - ti.sqrt(back2 / across)
            if distance > 0.0 and ti.abs(o.x + d.x * distance) <= 0.5 * length:
                result = distance
    return result


@ti.func
def emitted(lights: Template, textures: Template, row: ti.i32, origin: vec3, direction: vec3, distance: ti.f32) -> vec3:
    """Return the radiance of the point that a ray hits."""
    return color(lights.values, row)
