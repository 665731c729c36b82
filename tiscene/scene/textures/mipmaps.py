# SPDX-License-Identifier: Apache-2.0
"""Mipmaps (Williams, "Pyramidal Parametrics", 1983): images at a half, a quarter, ... of their resolution.

Levels are box-filtered in linear color, and end at images that fit into a processor's cache.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from dynamics.weak_cache import weakly_cached
from tiscene.scene.color import decode_srgb
from tiscene.scene.description import Texture

SMALLEST_SIZE = 64  # px, of the longer side; smaller images stay in the processor's cache


@cache
def srgb_decoding() -> NDArray[np.float32]:
    """Return the linear value of each 8-bit sRGB code, float32 [256]."""
    return decode_srgb(np.arange(256) / 255.0).astype(np.float32)


@weakly_cached
def coarser_copies(texture: Texture) -> tuple[Texture, ...]:
    """Return the mipmap levels of an 8-bit image, from half its size down to at most SMALLEST_SIZE pixels a side.

    Each pixel is the mean of four pixels of the level above, in linear values. Float images have no levels. They are
    computed once for each texture, and kept as long as it exists.
    """
    pixels = texture.pixels
    if pixels.dtype != np.uint8 or max(pixels.shape[:2]) <= SMALLEST_SIZE:
        return ()
    linear, code = _wide_codes(texture.encoding == "srgb")
    wide = linear[pixels]
    wide[..., 3] = pixels[..., 3] * np.uint16(257)
    copies = []
    while max(wide.shape[:2]) > SMALLEST_SIZE:
        wide = np.pad(wide, ((0, wide.shape[0] % 2), (0, wide.shape[1] % 2), (0, 0)), mode="edge")
        rows = wide[0::2].astype(np.uint32) + wide[1::2]
        wide = ((rows[:, 0::2] + rows[:, 1::2] + 2) >> 2).astype(np.uint16)
        copy = code[wide]
        copy[..., 3] = (wide[..., 3] + np.uint32(128)) // 257
        copies.append(replace(texture, pixels=copy, copies=None))
    return tuple(copies)


@cache
def _wide_codes(is_srgb: bool) -> tuple[NDArray[np.uint16], NDArray[np.uint8]]:
    """Return the linear value, 0..65535, of each 8-bit code, and the nearest code of each such value."""
    levels = 65535.0 * (srgb_decoding().astype(np.float64) if is_srgb else np.arange(256) / 255.0)
    codes = np.searchsorted(0.5 * (levels[1:] + levels[:-1]), np.arange(65536))
    return np.rint(levels).astype(np.uint16), codes.astype(np.uint8)
