# SPDX-License-Identifier: Apache-2.0
"""A rectangle that emits from one side, towards the light's -z. Near by it is sampled uniformly in the solid angle it
subtends, from afar in its area; where it has an image with bright spots, so many of the samples by that's luminance."""

import taichi as ti

from tiscene.device.kernel_types import Template, vec2, vec3
from tiscene.render.lights import image_sampling
from tiscene.render.lights.light_sample import axis, color, from_light, integer, no_sample, to_light
from tiscene.render.sampling import warp
from tiscene.render.texture_lookup import CLAMP, lookup_wrapped
from tiscene.scene.lights.light_table import GRID, IMAGE_FRACTION, SIZE, TEXTURE

# Below this solid angle (sr) a float cannot tell the rectangle's edges apart by angle, and area is as good a measure.
SMALL = 2e-3
# And where its diagonal is below this part, squared, of its distance, the solid angle costs more than it gains.
FAR = 0.2


@ti.func
def extent_from(values: Template, row: ti.i32, origin: vec3):
    """(x0, x1, y0, y1, z) of the rectangle in light axes about `origin`; z > 0 where the lit side is seen."""
    offset = axis(values, row, 3) - origin
    x = axis(values, row, 0).dot(offset)
    y = axis(values, row, 1).dot(offset)
    z = axis(values, row, 2).dot(offset)
    half_width, half_height = 0.5 * values[row, SIZE], 0.5 * values[row, SIZE + 1]
    return x - half_width, x + half_width, y - half_height, y + half_height, z


@ti.func
def radiance_at(values: Template, textures: Template, row: ti.i32, x: ti.f32, y: ti.f32) -> vec3:
    """What the point (x, y) of the light emits. The image stands upright for who looks at the lit side."""
    result = color(values, row)
    picture = integer(values, row, TEXTURE)
    if picture >= 0:
        uv = vec2(0.5 - x / values[row, SIZE], 0.5 + y / values[row, SIZE + 1])
        result *= lookup_wrapped(textures, picture, uv, CLAMP, CLAMP).xyz
    return result


@ti.func
def image_density(lights: Template, row: ti.i32, x: ti.f32, y: ti.f32) -> ti.f32:
    """Of a point (x, y) that is drawn from the image, over that of one that is uniform in area."""
    values = ti.static(lights.values)
    column = ti.cast((0.5 - x / values[row, SIZE]) * values[row, GRID], ti.i32)
    line = ti.cast((0.5 - y / values[row, SIZE + 1]) * values[row, GRID + 1], ti.i32)
    return image_sampling.density(lights, row, column, line)


@ti.func
def is_far(x0: ti.f32, x1: ti.f32, y0: ti.f32, y1: ti.f32, z0: ti.f32):
    """Whether the rectangle is so far away for its size that sampling its area is as good, and cheaper: 1 or 0."""
    width, height, x, y = x1 - x0, y1 - y0, x0 + x1, y0 + y1
    return ti.cast(width * width + height * height < FAR * (x * x + y * y + 4.0 * z0 * z0), ti.i32)


@ti.func
def area_pdf(values: Template, row: ti.i32, cosine, distance):
    """Density per steradian of a point that is uniform in area; of numbers or of lanes of them."""
    return distance * distance / (ti.max(cosine, 1e-9) * values[row, SIZE] * values[row, SIZE + 1])


@ti.func
def sample(lights: Template, textures: Template, row: ti.i32, origin: vec3, u: vec2):
    """A direction from `origin` to the light: a LightSample."""
    values = ti.static(lights.values)
    result = no_sample()
    x0, x1, y0, y1, z0 = extent_from(values, row, origin)
    if z0 > 0.0:
        part, v = values[row, IMAGE_FRACTION], u
        from_image = u.x < part
        if part > 0.0:
            v.x = ti.min(u.x / part if from_image else (u.x - part) / (1.0 - part), 0.99999994)
        p = vec2(x0 + v.x * (x1 - x0), y0 + v.y * (y1 - y0))
        density = 0.0
        if is_far(x0, x1, y0, y1, z0) == 0:
            view = warp.rectangle_view(x0, x1, y0, y1, z0)
            if view.solid_angle > SMALL:
                density = warp.rectangle_pdf(view)
                if not from_image:
                    p = warp.rectangle(view, v)
        if from_image:
            point = image_sampling.sample(lights, row, v)
            p = vec2(x1 - (x1 - x0) * point.x / values[row, GRID], y1 - (y1 - y0) * point.y / values[row, GRID + 1])
        distance = ti.sqrt(p.x * p.x + p.y * p.y + z0 * z0)
        offset = vec3(p.x, p.y, z0) * (1.0 / distance)
        by_area = area_pdf(values, row, offset.z, distance)
        x, y = p.x - 0.5 * (x0 + x1), p.y - 0.5 * (y0 + y1)
        result.pdf = by_area if density == 0.0 else density
        if part > 0.0:
            result.pdf += part * (by_area * image_density(lights, row, x, y) - result.pdf)
        result.direction = from_light(values, row, offset)
        result.distance = distance
        result.radiance = radiance_at(values, textures, row, x, y)
    return result


@ti.func
def pdf(lights: Template, row: ti.i32, origin: vec3, direction: vec3, distance: ti.f32) -> ti.f32:
    """Density of `sample` for a direction that meets the light at that distance."""
    values = ti.static(lights.values)
    result = 0.0
    x0, x1, y0, y1, z0 = extent_from(values, row, origin)
    if z0 > 0.0:
        w = to_light(values, row, direction)
        by_area = area_pdf(values, row, w.z, distance)
        result = by_area
        if is_far(x0, x1, y0, y1, z0) == 0:
            view = warp.rectangle_view(x0, x1, y0, y1, z0)
            if view.solid_angle > SMALL:
                result = warp.rectangle_pdf(view)
        part = values[row, IMAGE_FRACTION]
        if part > 0.0:
            x, y = w.x * distance - 0.5 * (x0 + x1), w.y * distance - 0.5 * (y0 + y1)
            result += part * (by_area * image_density(lights, row, x, y) - result)
    return result


@ti.func
def intersect(lights: Template, row: ti.i32, origin: vec3, direction: vec3) -> ti.f32:
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
def emitted(lights: Template, textures: Template, row: ti.i32, origin: vec3, direction: vec3, distance: ti.f32) -> vec3:
    """Radiance from the light's point that a ray met."""
    values = ti.static(lights.values)
    q = origin + direction * distance - axis(values, row, 3)
    return radiance_at(values, textures, row, axis(values, row, 0).dot(q), axis(values, row, 1).dot(q))
