# SPDX-License-Identifier: Apache-2.0
"""Copies of images of half, a quarter, ... of their size.

They are means, for whoever could not tell an image's single pixels apart (Williams, "Pyramidal Parametrics", 1983).
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.color import decode_srgb
from tiscene.scene.description import Texture

SMALLEST_SIZE = 64  # what is smaller stays in a cache as it is


@cache
def srgb_decoding() -> NDArray[np.float32]:
    """float32 [256]: the linear value of every 8-bit sRGB code."""
    return decode_srgb(np.arange(256) / 255.0).astype(np.float32)


def coarser_copies(texture: Texture) -> tuple[Texture, ...]:
    """An 8-bit image at half its size each way, at a quarter and so on, until it is at most SMALLEST_SIZE pixels long:
    the means of linear values over four pixels of the copy before."""
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
    """The linear value, 0..65535, of every 8-bit code, and the nearest code of every such value."""
    levels = 65535.0 * (srgb_decoding().astype(np.float64) if is_srgb else np.arange(256) / 255.0)
    codes = np.searchsorted(0.5 * (levels[1:] + levels[:-1]), np.arange(65536))
    return np.rint(levels).astype(np.uint16), codes.astype(np.uint8)
