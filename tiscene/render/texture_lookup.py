# SPDX-License-Identifier: Apache-2.0
"""Texture lookups in the atlas: bilinear, or stochastic with the same mean."""

from typing import NamedTuple

import taichi as ti

from tiscene.device.kernel_types import Floats1, Ints1, Ints2, Template, vec2, vec3, vec4
from tiscene.scene.textures.atlas import (
    COARSER,
    HEIGHT,
    IS_FLOAT,
    IS_SRGB,
    LEVELS,
    OFFSET,
    WIDTH,
    WRAP_S,
    WRAP_T,
    WRAPS,
)

REPEAT, CLAMP, MIRROR, BLACK = range(len(WRAPS))
_DECODING_LENGTH = 256


class Textures(NamedTuple):
    """The arrays of a TextureAtlas; a parameter of kernels, see `argument_bundles`."""

    info: Ints2
    words: Ints1
    floats: Floats1


@ti.func
def wrapped(index: ti.i32, size: ti.i32, wrap: ti.i32) -> ti.i32:
    """Map a pixel index outside 0..size-1 by a wrap mode; -1 for black."""
    result = index
    if index < 0 or index >= size:
        if wrap == REPEAT:
            result = index - size * ti.cast(ti.floor(index / size), ti.i32)
        elif wrap == CLAMP:
            result = ti.math.clamp(index, 0, size - 1)
        elif wrap == MIRROR:
            period = index - 2 * size * ti.cast(ti.floor(index / (2 * size)), ti.i32)
            result = period
            if period >= size:
                result = 2 * size - 1 - period
        else:
            result = -1
        result = ti.math.clamp(result, -1, size - 1)
    return result


@ti.func
def decoded(textures: Template, word: ti.u32, is_srgb: ti.i32) -> vec4:
    """Decode one 8-bit pixel to linear RGBA."""
    code = ti.Vector([ti.cast((word >> (8 * channel)) & ti.u32(255), ti.i32) for channel in range(4)])
    result = code * (1.0 / 255.0)
    if is_srgb != 0:
        for channel in ti.static(range(3)):
            result[channel] = textures.floats[code[channel]]
    return result


@ti.func
def pixel_coordinates(uv: vec2, width: ti.i32, height: ti.i32, wrap_s: ti.i32, wrap_t: ti.i32) -> vec2:
    """Return uv in pixels from the top left; pairs of periods (for MIRROR) are subtracted first, for precision."""
    u = uv.x - 2.0 * ti.floor(0.5 * uv.x) if wrap_s == REPEAT or wrap_s == MIRROR else ti.math.clamp(uv.x, -2.0, 3.0)
    v = uv.y - 2.0 * ti.floor(0.5 * uv.y) if wrap_t == REPEAT or wrap_t == MIRROR else ti.math.clamp(uv.y, -2.0, 3.0)
    return vec2(u * width, (1.0 - v) * height)


@ti.func
def lookup_wrapped(textures: Template, row: ti.i32, uv: vec2, wrap_s: ti.i32, wrap_t: ti.i32) -> vec4:
    """Return the image's linear RGBA at uv, bilinearly interpolated, with the given wrap modes."""
    info = ti.static(textures.info)
    width, height, offset = info[row, WIDTH], info[row, HEIGHT], info[row, OFFSET]
    is_float, is_srgb = info[row, IS_FLOAT], info[row, IS_SRGB]
    p = pixel_coordinates(uv, width, height, wrap_s, wrap_t) - 0.5
    left, top = ti.cast(ti.floor(p.x), ti.i32), ti.cast(ti.floor(p.y), ti.i32)
    fx, fy = p.x - left, p.y - top
    x0, x1 = wrapped(left, width, wrap_s), wrapped(left + 1, width, wrap_s)
    y0, y1 = wrapped(top, height, wrap_t), wrapped(top + 1, height, wrap_t)
    result = vec4(0.0)
    for corner in range(4):  # not unrolled, to compile the code of a texel once
        right, below = corner & 1, corner >> 1
        column, line = x1 if right == 1 else x0, y1 if below == 1 else y0
        if column >= 0 and line >= 0:
            at = offset + line * width + column
            weight = (fx if right == 1 else 1.0 - fx) * (fy if below == 1 else 1.0 - fy)
            if is_float != 0:
                for channel in ti.static(range(4)):
                    result[channel] += weight * textures.floats[_DECODING_LENGTH + 4 * at + channel]
            else:
                result += weight * decoded(textures, ti.cast(textures.words[at], ti.u32), is_srgb)
    return result


@ti.func
def lookup(textures: Template, row: ti.i32, uv: vec2) -> vec4:
    """Return the image's linear RGBA at uv, bilinearly interpolated; v = 1: top row; pixel centers at half-integers."""
    return lookup_wrapped(textures, row, uv, textures.info[row, WRAP_S], textures.info[row, WRAP_T])


@ti.func
def mip_level(area: ti.f32) -> ti.f32:
    """Return the mipmap level whose pixels have that area, in pixels of the image: 0.5 log2(area), to about 0.1."""
    # A float's bits as an integer are its logarithm, linear between powers of two.
    return ti.cast(ti.bit_cast(area, ti.i32) - 0x3F800000, ti.f32) * (0.5 / (1 << 23))


@ti.func
def mip_row(textures: Template, row: ti.i32, area: ti.f32, u: ti.f32) -> ti.i32:
    """Return the row of the mipmap level whose pixels have `area` pixels of the image; u rounds stochastically."""
    copy = row
    if area > 0.5:
        level = ti.min(ti.cast(ti.floor(mip_level(area) + u), ti.i32), textures.info[row, LEVELS])
        if level > 0:
            copy = textures.info[row, COARSER] + level - 1
    return copy


@ti.func
def lookup_stochastic(textures: Template, row: ti.i32, uv: vec2, area: ti.f32, u: vec3) -> vec4:
    """Return one pixel near uv, whose mean over u is trilinear interpolation.

    See Pharr et al., "Filtering After Shading with Stochastic Texture Filtering", 2024.

    Args:
        textures: Textures.
        row: Of the image.
        uv: Texture coordinates.
        area: Footprint, in pixels of the image.
        u: Uniform in [0, 1)³.
    """
    info = ti.static(textures.info)
    wrap_s, wrap_t = info[row, WRAP_S], info[row, WRAP_T]
    copy = mip_row(textures, row, area, u.z)
    width, height = info[copy, WIDTH], info[copy, HEIGHT]
    p = pixel_coordinates(uv, width, height, wrap_s, wrap_t) + u.xy - 0.5
    x = wrapped(ti.cast(ti.floor(p.x), ti.i32), width, wrap_s)
    y = wrapped(ti.cast(ti.floor(p.y), ti.i32), height, wrap_t)
    result = vec4(0.0)
    if x >= 0 and y >= 0:
        at = info[copy, OFFSET] + y * width + x
        if info[copy, IS_FLOAT] != 0:
            for channel in ti.static(range(4)):
                result[channel] = textures.floats[_DECODING_LENGTH + 4 * at + channel]
        else:
            result = decoded(textures, ti.cast(textures.words[at], ti.u32), info[copy, IS_SRGB])
    return result
