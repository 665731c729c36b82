# SPDX-License-Identifier: Apache-2.0
"""Values in a MaterialX network: constants, texture coordinates, affine lookups of image files, and computed images.

An operation on constants gives a constant. Multiplying and adding constants keeps a lookup, so that the file itself is
the texture. Everything else is computed per texel, in the space of the texture coordinates (`Baker`).
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tiscene.scene.color import decode_srgb, encode_srgb
from tiscene.scene.description import VERTEX_COLORS, Texture, TextureLookup
from tiscene.usd.materials.texture import IDENTITY, Affine, Encoding, TextureTable, Wrap

Floats = NDArray[np.float64]
Image = NDArray[np.float32]

_MAX_SIZE = 2048  # px, of a side of a computed image
_DEFAULT_SIZE = 512  # px, of images computed from texture coordinates alone
_CHANNELS = ("r", "g", "b", "a")
_GRAY = 0.02  # largest difference between the components of what counts as gray


@dataclass(frozen=True)
class Coordinates:
    """Texture coordinates: an affine map of a primvar.

    Attributes:
        transform: 2x3, row-major.
        primvar: its name; "" for the mesh's default one.
    """

    transform: Affine = IDENTITY
    primvar: str = ""

    def matrix(self) -> Floats:
        """Return the map as a 3x3 matrix."""
        return np.array([*self.transform, 0.0, 0.0, 1.0]).reshape(3, 3)

    def mapped(self, matrix: Floats) -> Coordinates:
        """Return these coordinates multiplied from the left by a 3x3 matrix."""
        rows = (matrix @ self.matrix())[:2].reshape(-1).tolist()
        return Coordinates(cast(Affine, tuple(rows)), self.primvar)


@dataclass(frozen=True, eq=False)
class Signal:
    """One value of a network. Exactly one of `constant`, `uv`, `row` and `image` is set.

    Attributes:
        constant: float64 [c], the same everywhere.
        uv: texture coordinates as a value of two components, or as a point whose third is not used.
        row: row of the texture table that is looked up; VERTEX_COLORS: the vertices' colors.
        channels: channels of that texture, one per component.
        scale: float64 [c], factor of each component.
        bias: float64 [c], summand of each component.
        image: float32 [h, w, c], computed values, row 0 at the top.
        coordinates: where a texture or image is looked up.
        wraps: wrap modes of the texture or image.
    """

    constant: Floats | None = None
    uv: Coordinates | None = None
    row: int | None = None
    channels: tuple[int, ...] = ()
    scale: Floats | None = None
    bias: Floats | None = None
    image: Image | None = None
    coordinates: Coordinates = Coordinates()
    wraps: tuple[Wrap, Wrap] = ("repeat", "repeat")

    @property
    def width(self) -> int:
        """Number of components."""
        if self.constant is not None:
            return len(self.constant)
        if self.image is not None:
            return int(self.image.shape[2])
        return 2 if self.uv is not None else len(self.channels)

    def select(self, components: Sequence[int]) -> Signal:
        """Return a signal of some of the components, in any order and number.

        Missing ones are the last, or 0 of texture coordinates.
        """
        if self.uv is not None and list(components) != [0, 1]:
            point = np.pad(_grid(_DEFAULT_SIZE, self.uv), ((0, 0), (0, 0), (0, 1)))
            values = point[..., [min(each, 2) for each in components]]
            return Signal(image=values, coordinates=Coordinates(primvar=self.uv.primvar))
        rows = [min(each, self.width - 1) for each in components]
        if self.constant is not None:
            return replace(self, constant=self.constant[rows])
        if self.image is not None:
            return replace(self, image=self.image[..., rows])
        if self.row is not None and self.scale is not None and self.bias is not None:
            channels = tuple(self.channels[each] for each in rows)
            return replace(self, channels=channels, scale=self.scale[rows], bias=self.bias[rows])
        return self

    def of_width(self, width: int) -> Signal:
        """Return the signal with a number of components: one is repeated, further ones are dropped or repeated."""
        return self if self.width == width else self.select([0] * width if self.width == 1 else range(width))

    def affine(self, factor: Floats, summand: Floats) -> Signal | None:
        """Return `factor * signal + summand`; None if it must be computed per texel."""
        width = max(self.width, len(factor), len(summand))
        factor, summand = _wide(factor, width), _wide(summand, width)
        if self.constant is not None:
            return Signal(constant=_wide(self.constant, width) * factor + summand)
        if self.uv is not None and width <= 3:
            matrix = np.array([[factor[0], 0.0, summand[0]], [0.0, factor[1], summand[1]], [0.0, 0.0, 1.0]])
            return Signal(uv=self.uv.mapped(matrix))
        if self.row is None or self.uv is not None:
            return None
        wide = self.of_width(width)
        assert wide.scale is not None
        assert wide.bias is not None
        return replace(wide, scale=wide.scale * factor, bias=wide.bias * factor + summand)


def number(*values: float) -> Signal:
    """Return a constant."""
    return Signal(constant=np.array(values, np.float64))


def _wide(values: Floats, width: int) -> Floats:
    return np.resize(values, width) if len(values) == 1 else values[:width]


def _grid(size: int, coordinates: Coordinates | None) -> Image:
    """Return the coordinates of texels [size, size, 2], row 0 at the top (v = 1)."""
    at = (np.arange(size) + 0.5) / size
    u, v = np.meshgrid(at, at[::-1])
    matrix = (coordinates or Coordinates()).matrix()
    moved = np.stack([u, v], axis=-1) @ matrix[:2, :2].T + matrix[:2, 2]
    return moved.astype(np.float32)


class Baker:
    """Computes signals per texel and turns them into texture lookups.

    Args:
        textures: table of the image files; computed images are added to it.
    """

    def __init__(self, textures: TextureTable) -> None:
        self._textures = textures

    def apply(self, function: Callable[..., NDArray[Any]], *operands: Signal) -> Signal:
        """Return a function of signals: of constants at once, else per texel.

        Args:
            function: maps float arrays [..., c] to one.
            operands: its arguments.
        """
        if all(each.constant is not None for each in operands):
            with np.errstate(all="ignore"):
                return Signal(
                    constant=np.nan_to_num(function(*(each.constant for each in operands)).astype(np.float64))
                )
        varying = [each for each in operands if each.constant is None]
        space, size = self._common_space(varying)
        wraps = next((each.wraps for each in varying if each.row is not None), ("repeat", "repeat"))
        values = [each.constant if each.constant is not None else self._sampled(each, space, size) for each in operands]
        with np.errstate(all="ignore"):
            image = np.nan_to_num(function(*values)).astype(np.float32)
        return Signal(image=image, coordinates=space, wraps=cast(Any, wraps))

    def affine(self, signal: Signal, factor: ArrayLike, summand: ArrayLike = 0.0) -> Signal:
        """Return `factor * signal + summand`: a lookup if the signal is one, else computed per texel."""
        a, b = (np.atleast_1d(np.asarray(each, np.float64)) for each in (factor, summand))
        return signal.affine(a, b) or self.apply(lambda values: a * values + b, signal)

    def normals(self, height: Signal, scale: float) -> Signal:
        """Return the normal map, within 0..1, of heights: MaterialX's heighttonormal, by central differences.

        Its slopes are those per unit of the texture coordinates, times the scale over 16.
        """
        baked = self.apply(lambda values: values, height.of_width(1))
        if baked.image is None:
            return number(0.5, 0.5, 1.0)
        modes = ["wrap" if wrap == "repeat" else "edge" for wrap in baked.wraps]
        values = np.pad(baked.image[..., 0], ((0, 0), (1, 1)), cast(Any, modes[0]))
        values = np.pad(values, ((1, 1), (0, 0)), cast(Any, modes[1]))
        rows, columns = baked.image.shape[:2]
        along_u = (values[1:-1, 2:] - values[1:-1, :-2]) * (0.5 * columns)
        along_v = (values[:-2, 1:-1] - values[2:, 1:-1]) * (0.5 * rows)
        slopes = np.stack([along_u, along_v], axis=-1) @ baked.coordinates.matrix()[:2, :2] * (scale / 16.0)
        normal = np.concatenate([-slopes, np.ones((rows, columns, 1))], axis=-1)
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        return replace(baked, image=(0.5 + 0.5 * normal).astype(np.float32))

    def _common_space(self, signals: Sequence[Signal]) -> tuple[Coordinates, tuple[int, int]]:
        """Return the coordinates and the size [h, w] in which signals are computed together."""
        textured = [each for each in signals if each.uv is None]
        spaces = {each.coordinates for each in textured}
        if len(textured) == len(signals) and len(spaces) == 1:
            sizes = [self._pixels(each).shape[:2] for each in textured]
            return spaces.pop(), (min(max(h for h, _ in sizes), _MAX_SIZE), min(max(w for _, w in sizes), _MAX_SIZE))
        size = _DEFAULT_SIZE
        for each in textured:
            repeats = np.abs(each.coordinates.matrix()[:2, :2]).max()
            size = max(size, round(max(self._pixels(each).shape[:2]) * float(repeats)))
        primvar = next((each.coordinates.primvar if each.uv is None else each.uv.primvar for each in signals), "")
        size = min(size, _MAX_SIZE)
        return Coordinates(IDENTITY, primvar), (size, size)

    def _sampled(self, signal: Signal, space: Coordinates, size: tuple[int, int]) -> Image:
        """Return a signal's values [h, w, c] at the texels of an image in some space."""
        if signal.uv is not None:
            return _grid(size[0], signal.uv)
        pixels = self._pixels(signal)
        height, width = pixels.shape[:2]
        if signal.coordinates == space:
            lines, dots = np.arange(size[0]) * height // size[0], np.arange(size[1]) * width // size[1]
            return np.asarray(pixels[lines[:, None], dots])
        at = _grid(size[0], signal.coordinates).astype(np.float64)
        columns = _wrapped(np.floor(at[..., 0] * width).astype(np.int64), width, signal.wraps[0])
        rows = _wrapped(np.floor((1.0 - at[..., 1]) * height).astype(np.int64), height, signal.wraps[1])
        return np.asarray(pixels[rows, columns])

    def _pixels(self, signal: Signal) -> Image:
        """Return the values of a texture or image at its own texels, [h, w, c]."""
        if signal.image is not None:
            return signal.image
        if signal.row is None or signal.row == VERTEX_COLORS or signal.scale is None or signal.bias is None:
            return np.full((1, 1, signal.width), 0.5, np.float32)  # vertex colors vary over no texture
        values = _linear(self._textures.textures[signal.row])[..., list(signal.channels)]
        return np.asarray(values * signal.scale.astype(np.float32) + signal.bias.astype(np.float32))

    def is_gray(self, signal: Signal) -> bool:
        """Return whether the components of a signal are equal everywhere, but for the errors of compressed images."""
        values = signal.constant if signal.constant is not None else self._pixels(signal)
        return float(np.abs(values - values[..., :1]).max(initial=0.0)) <= _GRAY

    def mean(self, signal: Signal) -> Floats:
        """Return the mean of a signal over its texels, [c]."""
        if signal.constant is not None:
            return signal.constant
        values = _grid(_DEFAULT_SIZE, signal.uv) if signal.uv is not None else self._pixels(signal)
        return np.asarray(values.reshape(-1, values.shape[2]).mean(axis=0, dtype=np.float64))

    def lookup(self, signal: Signal, width: int, name: str, uv_set: Callable[[str], Any]) -> TextureLookup | Floats:
        """Return a signal as a material input: numbers, or a texture lookup.

        Args:
            signal: the signal.
            width: components of the input, 1 or 3.
            name: for messages of a computed image.
            uv_set: returns which uv set of the vertices holds a primvar.
        """
        signal = signal.of_width(width)
        if signal.constant is not None:
            return signal.constant
        if signal.row is not None and signal.scale is not None and signal.bias is not None:
            channels = set(signal.channels)
            same = len(set(signal.scale.tolist())) == len(set(signal.bias.tolist())) == 1
            if signal.channels == (0, 1, 2) or (len(channels) == 1 and same):
                channel = "rgb" if signal.channels == (0, 1, 2) else _CHANNELS[signal.channels[0]]
                scale, bias = np.ones(4), np.zeros(4)
                at = [0, 1, 2] if channel == "rgb" else [signal.channels[0]]
                scale[at], bias[at] = signal.scale[: len(at)], signal.bias[: len(at)]
                place = signal.coordinates
                chosen: Any = 0 if signal.row == VERTEX_COLORS else uv_set(place.primvar)
                scales, biases = cast(Any, tuple(scale.tolist())), cast(Any, tuple(bias.tolist()))
                return TextureLookup(signal.row, cast(Any, channel), scales, biases, place.transform, chosen)
        baked = self.apply(lambda values: values, signal)
        assert baked.image is not None
        pixels, encoding = _stored(baked.image)
        key = f"materialx {encoding} {hashlib.blake2b(pixels.tobytes(), digest_size=16).hexdigest()} {pixels.shape}"
        row = self._textures.add_image(key, name, pixels, encoding, baked.wraps)
        place, channel = baked.coordinates, "rgb" if width == 3 else "r"
        chosen = uv_set(place.primvar)
        return TextureLookup(row, cast(Any, channel), uv_transform=place.transform, uv_set=chosen)


def _wrapped(index: NDArray[np.int64], size: int, wrap: str) -> NDArray[np.int64]:
    if wrap == "repeat":
        return index % size
    if wrap == "mirror":
        index = index % (2 * size)
        return np.minimum(index, 2 * size - 1 - index)
    return np.clip(index, 0, size - 1)


def _linear(texture: Texture) -> Image:
    """Return a texture's linear RGBA, float32 [h, w, 4]."""
    if texture.pixels.dtype != np.uint8:
        return np.asarray(texture.pixels, np.float32)
    values = texture.pixels.astype(np.float32) / np.float32(255.0)
    if texture.encoding == "srgb":
        values[..., :3] = decode_srgb(values[..., :3])
    return values


def _stored(image: Image) -> tuple[Any, Encoding]:
    """Return computed values [h, w, 1 or 3] as pixels to store, and their encoding.

    Colors within 0..1 become 8-bit sRGB, numbers within 0..1 raw 8 bits, everything else stays float.
    """
    low, high = float(image.min(initial=0.0)), float(image.max(initial=0.0))
    pixels = np.ones((*image.shape[:2], 4), np.float32)
    pixels[..., :3] = image
    if low < 0.0 or high > 1.0:
        return pixels, "raw"
    encoding: Encoding = "srgb" if image.shape[2] == 3 else "raw"
    if encoding == "srgb":
        pixels[..., :3] = encode_srgb(pixels[..., :3])
    return np.rint(pixels * 255.0).astype(np.uint8), encoding
