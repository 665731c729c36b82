"""A rectangle that emits from one side, towards the light's -z. Sampled uniformly in the solid angle it subtends."""

import taichi as ti

from tiscene.render import warp
from tiscene.render.lights.light_sample import axis, color, no_sample
from tiscene.render.textures import CLAMP, lookup_wrapped
from tiscene.scene.light_table import SIZE, TEXTURE

vec2 = ti.math.vec2
vec3 = ti.math.vec3

# Below this solid angle (sr) a float cannot tell the rectangle's edges apart by angle, and area is as good a measure.
_SMALL = 2e-3


@ti.func
def view_from(values: ti.template(), row: ti.i32, origin: vec3):
    """The rectangle in light axes about `origin`: a RectangleView; z0 > 0 where the lit side is seen."""
    offset = axis(values, row, 3) - origin
    x = axis(values, row, 0).dot(offset)
    y = axis(values, row, 1).dot(offset)
    z = axis(values, row, 2).dot(offset)
    half_width, half_height = 0.5 * values[row, SIZE], 0.5 * values[row, SIZE + 1]
    return warp.rectangle_view(x - half_width, x + half_width, y - half_height, y + half_height, z)


@ti.func
def radiance_at(values: ti.template(), textures: ti.template(), row: ti.i32, x: ti.f32, y: ti.f32) -> vec3:
    """What the point (x, y) of the light emits. The image stands upright for who looks at the lit side."""
    result = color(values, row)
    image = ti.cast(values[row, TEXTURE], ti.i32)
    if image >= 0:
        uv = vec2(0.5 - x / values[row, SIZE], 0.5 + y / values[row, SIZE + 1])
        result *= lookup_wrapped(textures, image, uv, CLAMP, CLAMP).xyz
    return result


@ti.func
def sample(lights: ti.template(), textures: ti.template(), row: ti.i32, origin: vec3, u: vec2):
    """A direction from `origin` to the light: a LightSample."""
    values = ti.static(lights.values)
    result = no_sample()
    view = view_from(values, row, origin)
    if view.z0 > 0.0 and view.solid_angle > 0.0:
        width, height = values[row, SIZE], values[row, SIZE + 1]
        p = vec2(view.x0 + u.x * width, view.y0 + u.y * height)
        if view.solid_angle > _SMALL:
            p = warp.rectangle(view, u)
        offset = vec3(p.x, p.y, view.z0)
        distance = offset.norm()
        offset /= distance
        result.direction = (
            axis(values, row, 0) * offset.x + axis(values, row, 1) * offset.y + axis(values, row, 2) * offset.z
        )
        result.distance = distance
        result.pdf = warp.rectangle_pdf(view)
        if view.solid_angle <= _SMALL:
            result.pdf = distance * distance / (offset.z * width * height)
        result.radiance = radiance_at(values, textures, row, p.x - view.x0 - 0.5 * width, p.y - view.y0 - 0.5 * height)
    return result


@ti.func
def pdf_in(view: ti.template(), values: ti.template(), row: ti.i32, direction: vec3, distance: ti.f32) -> ti.f32:
    """`pdf`, by a view from the origin."""
    result = 0.0
    if view.z0 > 0.0:
        if view.solid_angle > _SMALL:
            result = warp.rectangle_pdf(view)
        else:
            cosine = axis(values, row, 2).dot(direction)
            result = distance * distance / (ti.max(cosine, 1e-9) * values[row, SIZE] * values[row, SIZE + 1])
    return result


@ti.func
def pdf(lights: ti.template(), row: ti.i32, origin: vec3, direction: vec3, distance: ti.f32) -> ti.f32:
    """Density of `sample` for a direction that meets the light at that distance."""
    return pdf_in(view_from(lights.values, row, origin), lights.values, row, direction, distance)


@ti.func
def intersect(lights: ti.template(), row: ti.i32, origin: vec3, direction: vec3) -> ti.f32:
    """Distance to the lit side, +inf for a miss."""
    values = ti.static(lights.values)
    result = ti.math.inf
    normal = axis(values, row, 2)
    cosine = normal.dot(direction)
    offset = axis(values, row, 3) - origin
    distance = normal.dot(offset) / cosine
    if cosine > 0.0 and distance > 0.0:
        q = direction * distance - offset
        if ti.abs(axis(values, row, 0).dot(q)) <= 0.5 * values[row, SIZE]:
            if ti.abs(axis(values, row, 1).dot(q)) <= 0.5 * values[row, SIZE + 1]:
                result = distance
    return result


@ti.func
def emitted(
    lights: ti.template(), textures: ti.template(), row: ti.i32, origin: vec3, direction: vec3, distance: ti.f32
) -> vec3:
    """Radiance from the light's point that a ray met."""
    values = ti.static(lights.values)
    q = origin + direction * distance - axis(values, row, 3)
    return radiance_at(values, textures, row, axis(values, row, 0).dot(q), axis(values, row, 1).dot(q))
