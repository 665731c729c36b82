# SPDX-License-Identifier: Apache-2.0
"""DomeLight: an environment of constant radiance, or a latlong image sampled by luminance times solid angle.

Portals are sampled like lights of their own; a dome with portals samples its image for its sun alone.
Wide lobes read a small filtered copy of an image without a sun: the full image does not fit a cache.
"""

import math

import taichi as ti

from tiscene.device.kernel_types import Template, vec2, vec3
from tiscene.render.lights import image_sampling
from tiscene.render.lights.light_sample import FAR, color, from_light, integer, no_sample, to_light
from tiscene.render.sampling import warp
from tiscene.render.sampling.sobol import combine, mix
from tiscene.render.texture_lookup import CLAMP, REPEAT, lookup_wrapped
from tiscene.scene.lights.image_distribution import SMALL_HEIGHT, SMALL_WIDTH
from tiscene.scene.lights.light_table import GRID, SMALL_IMAGE, TEXTURE

# Directions of at least this density, 1/sr, read the full image.
_SHARP = 100.0


@ti.func
def uv_of(w: vec3) -> vec2:
    """Return the texture coordinates of a unit direction in light space (see DomeLight)."""
    return vec2(warp.azimuth(vec2(w.x, w.z)) + 0.25, 1.0 - warp.polar_angle(w.y))


@ti.func
def per_steradian(lights: Template, row: ti.i32, line: ti.i32) -> ti.f32:
    """Return the factor from a density over the unit square to one over directions, in a line of cells."""
    lines = integer(lights.values, row, GRID + 1)
    # Difference of the cosines at the line's edges, by the product formula.
    middle, half = math.pi * (line + 0.5) / lines, 0.5 * math.pi / lines
    return 1.0 / (2.0 * math.pi * lines * 2.0 * ti.sin(middle) * ti.sin(half))


@ti.func
def radiance_from(lights: Template, textures: Template, row: ti.i32, direction: vec3, density: ti.f32) -> vec3:
    """Return the radiance from a direction of that density, 1/sr; small ones read the filtered copy, 0 does not."""
    values = ti.static(lights.values)
    result = color(values, row)
    texture = integer(values, row, TEXTURE)
    if texture >= 0:
        uv = uv_of(to_light(values, row, direction))
        copy = integer(values, row, SMALL_IMAGE)
        if copy >= 0 and density > 0.0 and density < _SHARP:
            # One of the four nearest pixels at random, hashed from the direction: in the mean, bilinear interpolation.
            bits = mix(ti.bit_cast(direction.x, ti.u32) ^ combine(ti.bit_cast(direction.y, ti.u32), ti.u32(0)))
            x = uv.x * SMALL_WIDTH + ti.cast(bits & 0xFFFF, ti.f32) * (1.0 / 65536.0) - 0.5
            y = (1.0 - uv.y) * SMALL_HEIGHT + ti.cast(bits >> 16, ti.f32) * (1.0 / 65536.0) - 0.5
            column = ti.cast(ti.floor(x), ti.i32) & (SMALL_WIDTH - 1)
            line = ti.math.clamp(ti.cast(ti.floor(y), ti.i32), 0, SMALL_HEIGHT - 1)
            at = copy + 3 * (line * SMALL_WIDTH + column)
            result *= vec3(lights.distribution[at], lights.distribution[at + 1], lights.distribution[at + 2])
        else:
            result *= lookup_wrapped(textures, texture, uv, REPEAT, CLAMP).xyz
    return result


@ti.func
def sample(lights: Template, textures: Template, row: ti.i32, origin: vec3, u: vec2):
    """Sample a direction; returns a LightSample."""
    result = no_sample()
    result.distance = FAR
    w = warp.sphere(u)
    result.pdf = warp.sphere_pdf(w)
    if lights.values[row, TEXTURE] >= 0.0:
        columns, lines = lights.values[row, GRID], lights.values[row, GRID + 1]
        point = image_sampling.sample(lights, row, u)
        line = ti.min(ti.floor(point.y), lines - 1.0)
        # Uniform in solid angle inside the cell: in the cosine, not in the angle.
        low, high = ti.cos(math.pi * line / lines), ti.cos(math.pi * (line + 1.0) / lines)
        y = low + (point.y - line) * (high - low)
        angle = 2.0 * math.pi * point.x / columns - 0.5 * math.pi
        radius = ti.sqrt(ti.max(1.0 - y * y, 0.0))
        w = vec3(radius * ti.cos(angle), y, radius * ti.sin(angle))
        result.pdf = point.density * per_steradian(lights, row, ti.cast(line, ti.i32))
    result.direction = from_light(lights.values, row, w).normalized()
    result.radiance = radiance_from(lights, textures, row, result.direction, result.pdf)
    return result


@ti.func
def pdf(lights: Template, row: ti.i32, origin: vec3, direction: vec3, distance: ti.f32) -> ti.f32:
    """Return the density of `sample`, 1/sr."""
    result = warp.sphere_pdf(direction)
    if lights.values[row, TEXTURE] >= 0.0:
        uv = uv_of(to_light(lights.values, row, direction))
        column = ti.cast(ti.floor((uv.x - ti.floor(uv.x)) * lights.values[row, GRID]), ti.i32)
        line = ti.cast((1.0 - uv.y) * lights.values[row, GRID + 1], ti.i32)
        line = ti.math.clamp(line, 0, integer(lights.values, row, GRID + 1) - 1)
        result = image_sampling.density(lights, row, column, line) * per_steradian(lights, row, line)
    return result
