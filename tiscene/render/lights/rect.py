# SPDX-License-Identifier: Apache-2.0
"""RectLight: a rectangle that emits from one side, towards the light's -z.

Nearby it is sampled uniformly in solid angle (Ureña et al. 2013), at a distance in area. With a texture, a fraction of
the samples (IMAGE_FRACTION) follows its luminance.
"""

import taichi as ti

from tiscene.device.kernel_types import Template, vec2, vec3
from tiscene.render.lights import image_sampling
from tiscene.render.lights.light_sample import axis, color, from_light, integer, no_sample, to_light
from tiscene.render.sampling import warp
from tiscene.render.texture_lookup import CLAMP, lookup_wrapped
from tiscene.scene.lights.light_table import GRID, IMAGE_FRACTION, SIZE, TEXTURE

# Solid angle, sr, below which float32 angles are too imprecise and uniform sampling in area is as good.
SMALL = 2e-3
# Ratio, see `is_far`, below which sampling in solid angle costs more than it gains.
FAR = 0.2


@ti.func
def extent_from(values: Template, row: ti.i32, origin: vec3):
    """Return (x0, x1, y0, y1, z) of the rectangle in light axes about `origin`; z > 0: its emitting side is visible."""
    offset = axis(values, row, 3) - origin
    x = axis(values, row, 0).dot(offset)
    y = axis(values, row, 1).dot(offset)
    z = axis(values, row, 2).dot(offset)
    half_width, half_height = 0.5 * values[row, SIZE], 0.5 * values[row, SIZE + 1]
    return x - half_width, x + half_width, y - half_height, y + half_height, z


@ti.func
def radiance_at(values: Template, textures: Template, row: ti.i32, x: ti.f32, y: ti.f32) -> vec3:
    """Return the radiance of the point (x, y). The texture is upright seen from the emitting side."""
    result = color(values, row)
    texture = integer(values, row, TEXTURE)
    if texture >= 0:
        uv = vec2(0.5 - x / values[row, SIZE], 0.5 + y / values[row, SIZE + 1])
        result *= lookup_wrapped(textures, texture, uv, CLAMP, CLAMP).xyz
    return result


@ti.func
def image_density(lights: Template, row: ti.i32, x: ti.f32, y: ti.f32) -> ti.f32:
    """Return the density of texture sampling at (x, y) over that of uniform sampling in area."""
    values = ti.static(lights.values)
    column = ti.cast((0.5 - x / values[row, SIZE]) * values[row, GRID], ti.i32)
    line = ti.cast((0.5 - y / values[row, SIZE + 1]) * values[row, GRID + 1], ti.i32)
    return image_sampling.density(lights, row, column, line)


@ti.func
def is_far(x0: ti.f32, x1: ti.f32, y0: ti.f32, y1: ti.f32, z0: ti.f32, ratio: ti.f32):
    """Return 1 if half the diagonal of the rectangle over its distance has a square below `ratio`, else 0."""
    width, height, x, y = x1 - x0, y1 - y0, x0 + x1, y0 + y1
    return ti.cast(width * width + height * height < ratio * (x * x + y * y + 4.0 * z0 * z0), ti.i32)


@ti.func
def area_pdf(values: Template, row: ti.i32, cosine, distance):
    """Return the density, 1/sr, of uniform sampling in area; scalars or lanes."""
    return distance * distance / (ti.max(cosine, 1e-9) * values[row, SIZE] * values[row, SIZE + 1])


@ti.func
def sample(lights: Template, textures: Template, row: ti.i32, origin: vec3, u: vec2):
    """Sample a direction from `origin` to the light; returns a LightSample."""
    values = ti.static(lights.values)
    result = no_sample()
    x0, x1, y0, y1, z0 = extent_from(values, row, origin)
    if z0 > 0.0:
        fraction, v = values[row, IMAGE_FRACTION], u
        from_image = u.x < fraction
        if fraction > 0.0:
            v.x = ti.min(u.x / fraction if from_image else (u.x - fraction) / (1.0 - fraction), 0.99999994)
        p = vec2(x0 + v.x * (x1 - x0), y0 + v.y * (y1 - y0))
        density = 0.0
        if is_far(x0, x1, y0, y1, z0, FAR) == 0:
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
        if fraction > 0.0:
            result.pdf += fraction * (by_area * image_density(lights, row, x, y) - result.pdf)
        result.direction = from_light(values, row, offset)
        result.distance = distance
        result.radiance = radiance_at(values, textures, row, x, y)
    return result


@ti.func
def pdf(lights: Template, row: ti.i32, origin: vec3, direction: vec3, distance: ti.f32) -> ti.f32:
    """Return the density of `sample`, 1/sr, for a ray that hits the light at that distance."""
    values = ti.static(lights.values)
    result = 0.0
    x0, x1, y0, y1, z0 = extent_from(values, row, origin)
    if z0 > 0.0:
        w = to_light(values, row, direction)
        by_area = area_pdf(values, row, w.z, distance)
        result = by_area
        if is_far(x0, x1, y0, y1, z0, FAR) == 0:
            view = warp.rectangle_view(x0, x1, y0, y1, z0)
            if view.solid_angle > SMALL:
                result = warp.rectangle_pdf(view)
        fraction = values[row, IMAGE_FRACTION]
        if fraction > 0.0:
            x, y = w.x * distance - 0.5 * (x0 + x1), w.y * distance - 0.5 * (y0 + y1)
            result += fraction * (by_area * image_density(lights, row, x, y) - result)
    return result


@ti.func
def intersect(lights: Template, row: ti.i32, origin: vec3, direction: vec3) -> ti.f32:
    """Return the distance to the emitting side, +inf for a miss."""
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
    """Return the radiance of the point that a ray hits."""
    values = ti.static(lights.values)
    q = origin + direction * distance - axis(values, row, 3)
    return radiance_at(values, textures, row, axis(values, row, 0).dot(q), axis(values, row, 1).dot(q))
