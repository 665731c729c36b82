# SPDX-License-Identifier: Apache-2.0
"""TextureAtlas: all images of a scene in three flat arrays, from which kernels read any image by its row.

8-bit images stay 8-bit, one 32-bit word for each pixel; float images take four floats. Kernels read them by
`tiscene.render.texture_lookup`.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tiscene.device.memory import upload
from tiscene.device.part_arrays import ArrayPart, PartArray
from tiscene.scene.description import Texture
from tiscene.scene.textures.mipmaps import coarser_copies, srgb_decoding

INFO_COLUMNS = 9
OFFSET, WIDTH, HEIGHT, IS_FLOAT, IS_SRGB, WRAP_S, WRAP_T, COARSER, LEVELS = range(INFO_COLUMNS)
WRAPS = ("repeat", "clamp", "mirror", "black")


class TextureArrays(NamedTuple):
    """Device arrays of a texture atlas.

    Attributes:
        info: i32 [n + mipmap levels, 9]; columns are named by the constants of this module. OFFSET: the first pixel in
            the image's array. COARSER: the row of the first mipmap level, which has half the size. LEVELS: the number
            of levels, in consecutive rows.
        words: i32 [p], RGBA pixels of 8-bit images, red in the lowest byte.
        floats: f32 [256 + 4 q], the sRGB decoding table, then RGBA pixels of float images.
    """

    info: Any
    words: Any
    floats: Any


def linear_pixels(texture: Texture) -> NDArray[np.float32]:
    """Return an image as the renderer sees it: linear, float32 [height, width, 4]."""
    if texture.pixels.dtype != np.uint8:
        return np.asarray(texture.pixels, np.float32)
    pixels = texture.pixels.astype(np.float32) / np.float32(255.0)
    if texture.encoding == "srgb":
        pixels[..., :3] = srgb_decoding()[texture.pixels[..., :3]]
    return pixels


class TextureAtlas:
    """A growing table of images. After `append`, the next `arrays` uploads those that are not there.

    Args:
        words: For 8-bit images, see TextureArrays; it may hold some of the images. None: a new one.
        floats: For float images, likewise.
    """

    def __init__(self, words: PartArray | None = None, floats: PartArray | None = None) -> None:
        self._words, self._floats = words or PartArray(np.int32), floats or PartArray(np.float32)
        self.textures: list[Texture] = []
        self._arrays: TextureArrays | None = None

    def __len__(self) -> int:
        return len(self.textures)

    def append(self, textures: Iterable[Texture]) -> int:
        """Add images. Return the row of the first."""
        first = len(self.textures)
        self.textures.extend(textures)
        self._arrays = None
        return first

    def arrays(self) -> TextureArrays:
        """Return the device arrays."""
        if self._arrays is None:
            self._arrays = self._upload()
        return self._arrays

    def _upload(self) -> TextureArrays:
        copies = [coarser_copies(texture) if texture.copies is None else texture.copies for texture in self.textures]
        images = [*self.textures, *(image for chain in copies for image in chain)]
        info = np.zeros((len(images), INFO_COLUMNS), np.int32)
        levels = np.array([len(chain) for chain in copies], np.int32)
        info[: len(copies), LEVELS] = levels
        info[: len(copies), COARSER] = len(copies) + np.cumsum(levels) - levels
        # Levels follow their image, so that what scenes begin with is stored first.
        order: list[int] = []
        for row, chain in enumerate(copies):
            order += [row, *range(int(info[row, COARSER]), int(info[row, COARSER]) + len(chain))]
        words, words_used, floats_used = list[ArrayPart](), 0, 0
        floats = [ArrayPart(srgb_decoding(), 0, len(srgb_decoding()), srgb_decoding)]
        for row in order:
            texture = images[row]
            pixels = texture.pixels
            height, width, _ = pixels.shape
            is_float = pixels.dtype != np.uint8
            info[row, OFFSET] = floats_used if is_float else words_used
            info[row, WIDTH], info[row, HEIGHT] = width, height
            info[row, IS_FLOAT] = is_float
            info[row, IS_SRGB] = texture.encoding == "srgb" and not is_float
            info[row, WRAP_S] = WRAPS.index(texture.wrap_s)
            info[row, WRAP_T] = WRAPS.index(texture.wrap_t)
            if is_float:
                floats.append(ArrayPart(pixels, 0, 4 * width * height, partial(np.ravel, pixels)))
                floats_used += width * height
            else:
                words.append(ArrayPart(pixels, 0, width * height, partial(_words, pixels)))
                words_used += width * height
        return TextureArrays(upload(info), self._words.write(words), self._floats.write(floats))


def _words(pixels: NDArray[Any]) -> NDArray[np.int32]:
    """Return 8-bit pixels [h, w, 4] as one number each, [h * w]."""
    return np.ascontiguousarray(pixels).view("<i4").reshape(-1)
