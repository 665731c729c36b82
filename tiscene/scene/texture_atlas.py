"""All images of a scene in three flat arrays, so that a kernel can read any of them by its row.

8-bit images stay 8-bit (one word a pixel); only float images take floats. Kernels read them through
`tiscene.render.textures`.

An 8-bit image has copies of half, a quarter, ... of its size, of means, for whoever could not tell its single pixels
apart (Williams, "Pyramidal Parametrics", 1983). Float images, which are skies, have none.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tiscene import srgb
from tiscene.scene.description import Texture
from tiscene.scene.device_array import upload

INFO_COLUMNS = 9
OFFSET, WIDTH, HEIGHT, IS_FLOAT, IS_SRGB, WRAP_S, WRAP_T, COARSER, LEVELS = range(INFO_COLUMNS)
WRAPS = ("repeat", "clamp", "mirror", "black")
SMALLEST_SIZE = 64  # what is smaller stays in a cache as it is


class TextureArrays(NamedTuple):
    """info: i32 [n + copies, 9], columns as named above; OFFSET counts pixels within the image's own array, COARSER is
    the row of the copy of half the size, LEVELS says how many copies follow each other there.
    words: i32 [p], one RGBA pixel each, red in the lowest byte.
    floats: f32 [256 + 4 q]: first the sRGB decoding table, then RGBA pixels of the float images.
    """

    info: Any
    words: Any
    floats: Any


@cache
def srgb_decoding() -> NDArray[np.float32]:
    """float32 [256]: the linear value of every 8-bit sRGB code."""
    return srgb.decoded(np.arange(256) / 255.0).astype(np.float32)


def linear_pixels(texture: Texture) -> NDArray[np.float32]:
    """float32 [h, w, 4]: the image as the renderer sees it, decoded."""
    if texture.pixels.dtype != np.uint8:
        return np.asarray(texture.pixels, np.float32)
    pixels = texture.pixels.astype(np.float32) / np.float32(255.0)
    if texture.encoding == "srgb":
        pixels[..., :3] = srgb_decoding()[texture.pixels[..., :3]]
    return pixels


def coarser_copies(texture: Texture) -> list[Texture]:
    """An 8-bit image at half its size each way, at a quarter and so on, until it is at most SMALLEST_SIZE pixels long:
    the means of linear values over four pixels of the copy before."""
    pixels = texture.pixels
    if pixels.dtype != np.uint8 or max(pixels.shape[:2]) <= SMALLEST_SIZE:
        return []
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
        copies.append(replace(texture, pixels=copy))
    return copies


@cache
def _wide_codes(is_srgb: bool) -> tuple[NDArray[np.uint16], NDArray[np.uint8]]:
    """The linear value, 0..65535, of every 8-bit code, and the nearest code of every such value."""
    levels = 65535.0 * (srgb_decoding().astype(np.float64) if is_srgb else np.arange(256) / 255.0)
    codes = np.searchsorted(0.5 * (levels[1:] + levels[:-1]), np.arange(65536))
    return np.rint(levels).astype(np.uint16), codes.astype(np.uint8)


class TextureAtlas:
    """Grows by `append`; the device arrays are made anew at the next `arrays` after that."""

    def __init__(self) -> None:
        self.textures: list[Texture] = []
        self._arrays: TextureArrays | None = None

    def __len__(self) -> int:
        return len(self.textures)

    def append(self, textures: Iterable[Texture]) -> int:
        """Add images; returns the row of the first."""
        first = len(self.textures)
        self.textures.extend(textures)
        self._arrays = None
        return first

    def arrays(self) -> TextureArrays:
        """What kernels read."""
        if self._arrays is None:
            self._arrays = self._upload()
        return self._arrays

    def _upload(self) -> TextureArrays:
        copies = [coarser_copies(texture) for texture in self.textures]
        images = [*self.textures, *(image for chain in copies for image in chain)]
        info = np.zeros((len(images), INFO_COLUMNS), np.int32)
        levels = np.array([len(chain) for chain in copies], np.int32)
        info[: len(copies), LEVELS] = levels
        info[: len(copies), COARSER] = len(copies) + np.cumsum(levels) - levels
        words: list[NDArray[np.int32]] = []
        floats: list[NDArray[np.float32]] = [srgb_decoding()]
        words_used = floats_used = 0
        for row, texture in enumerate(images):
            height, width, _ = texture.pixels.shape
            is_float = texture.pixels.dtype != np.uint8
            info[row, OFFSET] = floats_used if is_float else words_used
            info[row, WIDTH], info[row, HEIGHT] = width, height
            info[row, IS_FLOAT] = is_float
            info[row, IS_SRGB] = texture.encoding == "srgb" and not is_float
            info[row, WRAP_S] = WRAPS.index(texture.wrap_s)
            info[row, WRAP_T] = WRAPS.index(texture.wrap_t)
            if is_float:
                floats.append(np.asarray(texture.pixels, np.float32).reshape(-1))
                floats_used += width * height
            else:
                words.append(np.ascontiguousarray(texture.pixels).view("<i4").reshape(-1))
                words_used += width * height
        return TextureArrays(
            upload(info), upload(np.concatenate([np.zeros(1, np.int32), *words])[1:]), upload(np.concatenate(floats))
        )
