"""All images of a scene in three flat arrays, so that a kernel can read any of them by its row.

8-bit images stay 8-bit (one word a pixel); only float images take floats. Kernels read them through
`tiscene.render.textures`.

An image has a coarse copy, of means, for whoever could not tell single pixels apart: small enough to stay in a cache.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.description import Texture
from tiscene.scene.device_array import upload

INFO_COLUMNS = 8
OFFSET, WIDTH, HEIGHT, IS_FLOAT, IS_SRGB, WRAP_S, WRAP_T, COARSE = range(8)
WRAPS = ("repeat", "clamp", "mirror", "black")
COARSE_SIZE = 64


class TextureArrays(NamedTuple):
    """info: i32 [n + coarse copies, 8], columns as named above; OFFSET counts pixels within the image's own array,
    COARSE is the row of the coarse copy (its own where there is none).
    words: i32 [p], one RGBA pixel each, red in the lowest byte.
    floats: f32 [256 + 4 q]: first the sRGB decoding table, then RGBA pixels of the float images.
    """

    info: Any
    words: Any
    floats: Any


@cache
def srgb_decoding() -> NDArray[np.float32]:
    """float32 [256]: the linear value of every 8-bit sRGB code (IEC 61966-2-1)."""
    encoded = np.arange(256) / 255.0
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    return linear.astype(np.float32)


def linear_pixels(texture: Texture) -> NDArray[np.float32]:
    """float32 [h, w, 4]: the image as the renderer sees it, decoded."""
    if texture.pixels.dtype != np.uint8:
        return np.asarray(texture.pixels, np.float32)
    pixels = texture.pixels.astype(np.float32) / np.float32(255.0)
    if texture.encoding == "srgb":
        pixels[..., :3] = srgb_decoding()[texture.pixels[..., :3]]
    return pixels


def coarse_copy(texture: Texture) -> Texture:
    """An 8-bit image of at most COARSE_SIZE pixels each way, the means (of linear values) over equal parts of another.

    Small images and float images are their own.
    """
    height, width, _ = texture.pixels.shape
    if texture.pixels.dtype != np.uint8 or max(height, width) <= COARSE_SIZE:
        return texture
    levels = 65535.0 * (srgb_decoding() if texture.encoding == "srgb" else np.arange(256) / 255.0)
    sums = np.rint(levels).astype(np.uint16)[texture.pixels]
    sums[..., 3] = texture.pixels[..., 3] * np.uint16(257)
    area = np.ones((1, 1, 1))
    for axis, length in enumerate((height, width)):
        count = -(-length // -(-length // COARSE_SIZE))  # parts of as many pixels each, if that can be
        starts = np.arange(count) * length // count
        sums = np.add.reduceat(sums, starts, axis=axis, dtype=np.uint32)
        area = area * np.expand_dims(np.diff(starts, append=length), (1 - axis, 2))
    means = sums / area
    pixels = np.searchsorted(0.5 * (levels[1:] + levels[:-1]), means)
    pixels[..., 3] = np.rint(means[..., 3] / 257.0)
    return replace(texture, pixels=pixels.astype(np.uint8))


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
        coarse = [coarse_copy(texture) for texture in self.textures]
        copies = [copy for copy, texture in zip(coarse, self.textures, strict=True) if copy is not texture]
        info = np.zeros((len(self.textures) + len(copies), INFO_COLUMNS), np.int32)
        next_copy = len(self.textures)
        words: list[NDArray[np.int32]] = []
        floats: list[NDArray[np.float32]] = [srgb_decoding()]
        words_used = floats_used = 0
        for row, texture in enumerate([*self.textures, *copies]):
            height, width, _ = texture.pixels.shape
            is_float = texture.pixels.dtype != np.uint8
            info[row, OFFSET] = floats_used if is_float else words_used
            info[row, WIDTH], info[row, HEIGHT] = width, height
            info[row, IS_FLOAT] = is_float
            info[row, IS_SRGB] = texture.encoding == "srgb" and not is_float
            info[row, WRAP_S] = WRAPS.index(texture.wrap_s)
            info[row, WRAP_T] = WRAPS.index(texture.wrap_t)
            info[row, COARSE] = row
            if row < len(self.textures) and coarse[row] is not texture:
                info[row, COARSE] = next_copy
                next_copy += 1
            if is_float:
                floats.append(np.asarray(texture.pixels, np.float32).reshape(-1))
                floats_used += width * height
            else:
                words.append(np.ascontiguousarray(texture.pixels).view("<i4").reshape(-1))
                words_used += width * height
        return TextureArrays(
            upload(info), upload(np.concatenate([np.zeros(1, np.int32), *words])[1:]), upload(np.concatenate(floats))
        )
