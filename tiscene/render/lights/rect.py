"""A rectangle that emits from one side, towards the light's -z. Near by it is sampled uniformly in the solid angle it
subtends, from afar in its area."""

import taichi as ti

from tiscene.render import warp
from tiscene.render.lights.light_sample import axis, color, no_sample
from tiscene.render.textures import CLAMP, lookup_wrapped
from tiscene.scene.light_table import SIZE, TEXTURE

vec2 = ti.math.vec2
vec3 = ti.math.vec3

# Below this solid angle (sr) a float cannot tell the rectangle's edges apart by angle, and area is as good a measure.
_SMALL = 2e-3
# And where its diagonal is below this part, squared, of its distance, the solid angle costs more than it gains.
_FAR = 0.2


@ti.func
def extent_from(values: ti.template(), row: ti.i32, origin: vec3):
    """(x0, x1, y0, y1, z) of the rectangle in light axes about `origin`; z > 0 where the lit side is seen."""
    offset = axis(values, row, 3) - origin
    x = axis(values, row, 0).dot(offset)
    y = axis(values, row, 1).dot(offset)
    z = axis(values, row, 2).dot(offset)
    half_width, half_height = 0.5 * values[row, SIZE], 0.5 * values[row, SIZE + 1]
    return x - half_width, x + half_width, y - half_height, y + half_height, z


@ti.func
def view_from(values: ti.template(), row: ti.i32, origin: vec3):
    """The same as a RectangleView."""
    x0, x1, y0, y1, z = extent_from(values, row, origin)
    return warp.rectangle_view(x0, x1, y0, y1, z)


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
def is_far(x0: ti.f32, x1: ti.f32, y0: ti.f32, y1: ti.f32, z0: ti.f32):
    """Whether the rectangle is so far away for its size that sampling its area is as good, and cheaper: 1 or 0."""
    width, height, x, y = x1 - x0, y1 - y0, x0 + x1, y0 + y1
    return ti.cast(width * width + height * height < _FAR * (x * x + y * y + 4.0 * z0 * z0), ti.i32)


@ti.func
def area_pdf(values: ti.template(), row: ti.i32, cosine: ti.f32, distance: ti.f32) -> ti.f32:
    """Density per steradian of a point that is uniform in area."""
    return distance * distance / (ti.max(cosine, 1e-9) * values[row, SIZE] * values[row, SIZE + 1])


@ti.func
def sample(lights: ti.template(), textures: ti.template(), row: ti.i32, origin: vec3, u: vec2):
    """A direction from `origin` to the light: a LightSample."""
    values = ti.static(lights.values)
    result = no_sample()
    x0, x1, y0, y1, z0 = extent_from(values, row, origin)
    if z0 > 0.0:
        p = vec2(x0 + u.x * (x1 - x0), y0 + u.y * (y1 - y0))
        by_area = True
        if is_far(x0, x1, y0, y1, z0) == 0:
            view = warp.rectangle_view(x0, x1, y0, y1, z0)
            if view.solid_angle > _SMALL:
                by_area = False
                p = warp.rectangle(view, u)
                result.pdf = warp.rectangle_pdf(view)
        distance = ti.sqrt(p.x * p.x + p.y * p.y + z0 * z0)
        offset = vec3(p.x, p.y, z0) * (1.0 / distance)
        if by_area:
            result.pdf = area_pdf(values, row, offset.z, distance)
        result.direction = (
            axis(values, row, 0) * offset.x + axis(values, row, 1) * offset.y + axis(values, row, 2) * offset.z
        )
        result.distance = distance
        result.radiance = radiance_at(values, textures, row, p.x - 0.5 * (x0 + x1), p.y - 0.5 * (y0 + y1))
    return result


@ti.func
def pdf_in(view: ti.template(), values: ti.template(), row: ti.i32, direction: vec3, distance: ti.f32) -> ti.f32:
    """`pdf`, by a view from the origin."""
    result = 0.0
    if view.z0 > 0.0:
        if view.solid_angle > _SMALL and is_far(view.x0, view.x1, view.y0, view.y1, view.z0) == 0:
            result = warp.rectangle_pdf(view)
        else:
            result = area_pdf(values, row, axis(values, row, 2).dot(direction), distance)
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
    height = normal.dot(offset)
    if cosine > 0.0 and height > 0.0:
        distance = height / cosine
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
