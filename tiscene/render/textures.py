"""Bilinear lookups in the texture atlas."""

from typing import Any, NamedTuple

import taichi as ti

from tiscene.scene.texture_atlas import HEIGHT, IS_FLOAT, IS_SRGB, OFFSET, WIDTH, WRAP_S, WRAP_T, WRAPS

vec2 = ti.math.vec2
vec4 = ti.math.vec4

REPEAT, CLAMP, MIRROR, BLACK = range(len(WRAPS))
_DECODING_LENGTH = 256


class Textures(NamedTuple):
    """The arrays of a TextureAtlas, bundled inside a kernel."""

    info: Any
    words: Any
    floats: Any


@ti.func
def wrapped(index: ti.i32, size: ti.i32, wrap: ti.i32) -> ti.i32:
    """The pixel that an index outside 0..size-1 stands for; -1 for black."""
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
def texel(textures: ti.template(), row: ti.i32, x: ti.i32, y: ti.i32) -> vec4:
    """One pixel, decoded to linear."""
    result = vec4(0.0)
    if x >= 0 and y >= 0:
        at = textures.info[row, OFFSET] + y * textures.info[row, WIDTH] + x
        if textures.info[row, IS_FLOAT] != 0:
            for channel in ti.static(range(4)):
                result[channel] = textures.floats[_DECODING_LENGTH + 4 * at + channel]
        else:
            word = ti.cast(textures.words[at], ti.u32)
            for channel in ti.static(range(4)):
                code = ti.cast((word >> (8 * channel)) & ti.u32(255), ti.i32)
                value = code * (1.0 / 255.0)
                if ti.static(channel < 3):
                    if textures.info[row, IS_SRGB] != 0:
                        value = textures.floats[code]
                result[channel] = value
    return result


@ti.func
def lookup_wrapped(textures: ti.template(), row: ti.i32, uv: vec2, wrap_s: ti.i32, wrap_t: ti.i32) -> vec4:
    """`lookup` with other wraps than the image's own."""
    width, height = textures.info[row, WIDTH], textures.info[row, HEIGHT]
    # Far outside, whole periods are taken off first: two, for the mirror's sake.
    u = uv.x - 2.0 * ti.floor(0.5 * uv.x) if wrap_s == REPEAT or wrap_s == MIRROR else ti.math.clamp(uv.x, -2.0, 3.0)
    v = uv.y - 2.0 * ti.floor(0.5 * uv.y) if wrap_t == REPEAT or wrap_t == MIRROR else ti.math.clamp(uv.y, -2.0, 3.0)
    x = u * width - 0.5
    y = (1.0 - v) * height - 0.5
    left, top = ti.cast(ti.floor(x), ti.i32), ti.cast(ti.floor(y), ti.i32)
    fx, fy = x - left, y - top
    x0, x1 = wrapped(left, width, wrap_s), wrapped(left + 1, width, wrap_s)
    y0, y1 = wrapped(top, height, wrap_t), wrapped(top + 1, height, wrap_t)
    result = vec4(0.0)
    for corner in range(4):  # not unrolled: the texel's code is there once
        right, below = corner & 1, corner >> 1
        weight = (fx if right == 1 else 1.0 - fx) * (fy if below == 1 else 1.0 - fy)
        result += weight * texel(textures, row, x1 if right == 1 else x0, y1 if below == 1 else y0)
    return result


@ti.func
def lookup(textures: ti.template(), row: ti.i32, uv: vec2) -> vec4:
    """The image's linear RGBA at uv: v = 1 is the top row, pixel centres at half-integers."""
    return lookup_wrapped(textures, row, uv, textures.info[row, WRAP_S], textures.info[row, WRAP_T])
