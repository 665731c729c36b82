"""The surroundings: one radiance from everywhere, or a latlong image sampled by luminance times solid angle.

Where the light comes in by portals, those are sampled instead, but for the part of the samples that looks for the sun
of the image. A path may well leave by another way: then no density of light sampling counts against it.
"""

import math

import taichi as ti

from tiscene.render import warp
from tiscene.render.lights import portals, rect
from tiscene.render.lights.light_sample import FAR, axis, color, no_sample, to_light
from tiscene.render.textures import CLAMP, REPEAT, lookup_wrapped
from tiscene.scene.light_table import DISTRIBUTION, GRID, SUN_PART, TEXTURE

vec2 = ti.math.vec2
vec3 = ti.math.vec3


@ti.func
def uv_of(w: vec3) -> vec2:
    """Where a unit direction in light axes reads the image (see DomeLight)."""
    level = ti.sqrt(w.x * w.x + w.z * w.z)
    azimuth = warp.angle_of(vec2(w.x, w.z) / ti.max(level, 1e-20))
    return vec2((azimuth + 0.5 * math.pi) * (0.5 / math.pi), 1.0 - warp.angle_of(vec2(w.y, level)) / math.pi)


@ti.func
def interval(distribution: ti.template(), start: ti.i32, count: ti.i32, u: ti.f32) -> ti.i32:
    """The i with cumulative[i] <= u < cumulative[i + 1], of `count` intervals whose cumulative begins at `start`."""
    low, high = 0, count
    while high - low > 1:
        middle = (low + high) // 2
        if distribution[start + middle] <= u:
            low = middle
        else:
            high = middle
    return low


@ti.func
def cell_pdf(values: ti.template(), distribution: ti.template(), light: ti.i32, row: ti.i32, column: ti.i32) -> ti.f32:
    """Density per steradian in a cell of the dome's grid: its chance over its solid angle."""
    start = ti.cast(values[light, DISTRIBUTION], ti.i32)
    columns, rows = ti.cast(values[light, GRID], ti.i32), ti.cast(values[light, GRID + 1], ti.i32)
    at = start + rows + 1 + row * (columns + 1) + column
    chance = (distribution[start + row + 1] - distribution[start + row]) * (distribution[at + 1] - distribution[at])
    # The difference of the edges' cosines, by the product formula.
    middle, half = math.pi * (row + 0.5) / rows, 0.5 * math.pi / rows
    return chance * columns / (2.0 * math.pi * 2.0 * ti.sin(middle) * ti.sin(half))


@ti.func
def sample_image(values: ti.template(), distribution: ti.template(), row: ti.i32, u: vec2):
    """A direction in light axes by the brightness of the image, and its density."""
    start = ti.cast(values[row, DISTRIBUTION], ti.i32)
    columns, rows = ti.cast(values[row, GRID], ti.i32), ti.cast(values[row, GRID + 1], ti.i32)
    j = interval(distribution, start, rows, u.y)
    at = start + rows + 1 + j * (columns + 1)
    i = interval(distribution, at, columns, u.x)
    v = (u.y - distribution[start + j]) / ti.max(distribution[start + j + 1] - distribution[start + j], 1e-30)
    s = (u.x - distribution[at + i]) / ti.max(distribution[at + i + 1] - distribution[at + i], 1e-30)
    # Uniform in solid angle within the cell: in the cosine, not in the angle.
    low, high = ti.cos(math.pi * j / rows), ti.cos(math.pi * (j + 1) / rows)
    y = low + ti.math.clamp(v, 0.0, 1.0) * (high - low)
    angle = 2.0 * math.pi * (i + ti.math.clamp(s, 0.0, 1.0)) / columns - 0.5 * math.pi
    radius = ti.sqrt(ti.max(1.0 - y * y, 0.0))
    return vec3(radius * ti.cos(angle), y, radius * ti.sin(angle)), cell_pdf(values, distribution, row, j, i)


@ti.func
def image_pdf(lights: ti.template(), row: ti.i32, direction: vec3) -> ti.f32:
    """Density of `sample_image`, or of the whole sphere where there is no image."""
    values, distribution = ti.static(lights.values, lights.distribution)
    result = warp.sphere_pdf(direction)
    if values[row, TEXTURE] >= 0.0:
        uv = uv_of(to_light(values, row, direction))
        columns, rows = ti.cast(values[row, GRID], ti.i32), ti.cast(values[row, GRID + 1], ti.i32)
        i = ti.cast(ti.floor((uv.x - ti.floor(uv.x)) * columns), ti.i32)
        j = ti.cast((1.0 - uv.y) * rows, ti.i32)
        result = cell_pdf(values, distribution, row, ti.math.clamp(j, 0, rows - 1), ti.math.clamp(i, 0, columns - 1))
    return result


@ti.func
def sample(lights: ti.template(), textures: ti.template(), row: ti.i32, origin: vec3, u: vec2):
    """A direction of the surroundings: a LightSample."""
    values = ti.static(lights.values)
    result = no_sample()
    result.distance = FAR
    part = values[row, SUN_PART]
    portal, own, total, rest = portals.choose(values, row, origin, (u.x - part) / (1.0 - part))
    if portal < 0:
        part = 1.0
    if u.x < part:
        v = vec2(ti.min(u.x / part, 0.99999994), u.y)
        w = warp.sphere(v)
        result.pdf = warp.sphere_pdf(w)
        if values[row, TEXTURE] >= 0.0:
            w, result.pdf = sample_image(values, lights.distribution, row, v)
        result.direction = (
            axis(values, row, 0) * w.x + axis(values, row, 1) * w.y + axis(values, row, 2) * w.z
        ).normalized()
        result.pdf *= part
    else:
        through = rect.sample(lights, textures, portal, origin, vec2(rest, u.y))
        result.direction = through.direction
        result.pdf = (1.0 - part) * own * through.pdf / total
        if part > 0.0:
            result.pdf += part * image_pdf(lights, row, through.direction)
    if part < 1.0:
        others = portal if u.x >= part else -1
        result.pdf += (1.0 - part) * portals.density(lights, row, origin, result.direction, others) / total
    result.radiance = emitted(lights, textures, row, origin, result.direction, ti.math.inf)
    return result


@ti.func
def pdf(lights: ti.template(), row: ti.i32, origin: vec3, direction: vec3, distance: ti.f32) -> ti.f32:
    """Density of `sample`."""
    portal, _, total, _ = portals.choose(lights.values, row, origin, 0.0)
    part, result = 1.0, 0.0
    if portal >= 0:
        part = lights.values[row, SUN_PART]
        result = (1.0 - part) * portals.density(lights, row, origin, direction, -1) / total
    if part > 0.0:
        result += part * image_pdf(lights, row, direction)
    return result


@ti.func
def intersect(lights: ti.template(), row: ti.i32, origin: vec3, direction: vec3) -> ti.f32:
    """Behind everything: +inf."""
    return ti.math.inf


@ti.func
def emitted(
    lights: ti.template(), textures: ti.template(), row: ti.i32, origin: vec3, direction: vec3, distance: ti.f32
) -> vec3:
    """Radiance from a direction that nothing blocks."""
    values = ti.static(lights.values)
    result = color(values, row)
    image = ti.cast(values[row, TEXTURE], ti.i32)
    if image >= 0:
        result *= lookup_wrapped(textures, image, uv_of(to_light(values, row, direction)), REPEAT, CLAMP).xyz
    return result
