# SPDX-License-Identifier: Apache-2.0
"""Baker: signals of a MaterialX network per texel, as texture lookups."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tiscene.scene.color import decode_srgb, encode_srgb
from tiscene.scene.description import VERTEX_COLORS, Texture, TextureLookup
from tiscene.usd.materials.materialx_signal import DEFAULT_SIZE, Coordinates, Floats, Image, Signal, grid, number
from tiscene.usd.materials.texture import IDENTITY, Affine, Encoding, TextureTable

_MAX_SIZE = 2048  # px, of a side of a computed image
_CHANNELS = ("r", "g", "b", "a")
_FACTORS = {(): "", (0, 1, 2): "rgb", (3,): "a", (3, 3, 3): "a"}  # `TextureLookup.vertex_factor` of tints
_AFFINE = 1e-5  # largest relative error of coordinates that count as an affine map
_STRIP = 16384  # texels of a strip
_GRAY = 0.02  # largest difference between the components of what counts as gray


class Baker:
    """Computes signals per texel and turns them into texture lookups.

    Args:
        textures: table of the image files; computed images are added to it.
        whitened: is called where the vertices' colors, which vary over no texture, count as white.
    """

    def __init__(self, textures: TextureTable, whitened: Callable[[], None]) -> None:
        self._textures = textures
        self._whitened = whitened

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
        if any(each.reads_vertices for each in varying):
            self._whitened()
        space, size = self._common_space(varying)
        placed = sorted((each for each in varying if each.coordinates == space), key=lambda each: each.row is None)
        wraps = next((each.wraps for each in placed if each.uv is None), ("repeat", "repeat"))
        readers = [self._reader(each, space, size) for each in operands]
        image: Image | None = None
        border: Floats | None = None
        with np.errstate(all="ignore"):
            if "black" in wraps:
                border = np.nan_to_num(function(*(self._border(each) for each in operands)).astype(np.float64))
            for rows in _strips(size):
                values = function(*(read(rows) for read in readers))
                if not np.isfinite(values).all():
                    values = np.nan_to_num(values)
                if image is None:
                    image = np.empty((*size, values.shape[-1]), np.float32)
                image[rows] = values
        return Signal(image=image, coordinates=space, wraps=cast(Any, wraps), border=border)

    def affine(self, signal: Signal, factor: ArrayLike, summand: ArrayLike = 0.0) -> Signal:
        """Return `factor * signal + summand`: a lookup if the signal is one, else computed per texel."""
        a, b = (np.atleast_1d(np.asarray(each, np.float64)) for each in (factor, summand))
        return signal.affine(a, b) or self.apply(lambda values: a * values + b, signal)

    def product(self, first: Signal, second: Signal) -> Signal:
        """Return the product of two signals of any widths: a lookup if one is, and the other is constant."""
        for factor, signal in ((first, second), (second, first)):
            if factor.constant is not None:
                if (factor.constant == 1.0).all() and factor.width <= signal.width:
                    return signal
                return self.affine(signal, factor.constant)
        if tinted := first.tinted(second) or second.tinted(first):
            return tinted
        width = max(first.width, second.width)
        return self.apply(lambda a, b: a * b, first.of_width(width), second.of_width(width))

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
        return replace(baked, image=(0.5 + 0.5 * normal).astype(np.float32), border=np.array([0.5, 0.5, 1.0]))

    def mapped(self, signal: Signal, matrix: Floats) -> Signal:
        """Return coordinates multiplied from the left by a 3x3 matrix."""
        if signal.uv is not None:
            return Signal(uv=signal.uv.mapped(matrix))
        return self.apply(lambda values: values @ matrix[:2, :2].T + matrix[:2, 2], signal.of_width(2))

    def coordinates(self, signal: Signal) -> Coordinates | None:
        """Return a signal as coordinates; None if it is not an affine map of texture coordinates."""
        if signal.uv is not None or signal.row is not None:
            return signal.uv
        if signal.constant is not None:
            u, v = np.resize(signal.constant, 2).tolist()
            return Coordinates((0.0, 0.0, u, 0.0, 0.0, v))
        values = self._pixels(signal.of_width(2)).astype(np.float64)
        at = grid(len(values), signal.coordinates)
        if at.shape != values.shape:
            return None
        at = np.concatenate([at, np.ones((*at.shape[:2], 1))], axis=-1).astype(np.float64)
        corners = (0, 0, -1), (0, -1, 0)
        rows = np.linalg.lstsq(at[corners], values[corners], rcond=None)[0].T
        if np.abs(at @ rows.T - values).max() > _AFFINE * (1.0 + np.abs(values).max()):
            return None
        return Coordinates(cast(Affine, tuple(rows.reshape(-1).tolist())), signal.coordinates.primvar)

    def _common_space(self, signals: Sequence[Signal]) -> tuple[Coordinates, tuple[int, int]]:
        """Return the coordinates and the size [h, w] in which signals are computed together."""
        textured = [each for each in signals if each.uv is None]
        spaces = {each.coordinates for each in textured}
        if len(textured) == len(signals) and len(spaces) == 1:
            sizes = [self._size(each) for each in textured]
            return spaces.pop(), (min(max(h for h, _ in sizes), _MAX_SIZE), min(max(w for _, w in sizes), _MAX_SIZE))
        size = DEFAULT_SIZE
        for each in textured:
            repeats = np.abs(each.coordinates.matrix()[:2, :2]).max()
            size = max(size, round(max(self._size(each)) * float(repeats)))
        primvar = next((each.coordinates.primvar if each.uv is None else each.uv.primvar for each in signals), "")
        size = min(size, _MAX_SIZE)
        return Coordinates(IDENTITY, primvar), (size, size)

    def _reader(self, signal: Signal, space: Coordinates, size: tuple[int, int]) -> Callable[[slice], Any]:
        """Return a function of rows that returns a signal's values there, as `_sampled`; a constant has no rows."""
        if signal.constant is not None:
            return lambda rows: signal.constant
        if signal.row is not None and signal.coordinates == space and self._size(signal) == size:
            return lambda rows: self._pixels(signal, rows)
        values = self._sampled(signal, space, size)
        return lambda rows: values[rows]

    def _sampled(self, signal: Signal, space: Coordinates, size: tuple[int, int]) -> Image:
        """Return a signal's values [h, w, c] at the texels of an image in some space."""
        if signal.uv is not None:
            return grid(size[0], signal.uv)
        pixels = self._pixels(signal)
        height, width = pixels.shape[:2]
        if signal.coordinates == space and (height, width) == size:
            return pixels
        if signal.coordinates == space:
            lines, dots = np.arange(size[0]) * height // size[0], np.arange(size[1]) * width // size[1]
            return np.asarray(pixels[lines[:, None], dots])
        at = grid(size[0], signal.coordinates).astype(np.float64)
        columns = _wrapped(np.floor(at[..., 0] * width).astype(np.int64), width, signal.wraps[0])
        rows = _wrapped(np.floor((1.0 - at[..., 1]) * height).astype(np.int64), height, signal.wraps[1])
        found = np.asarray(pixels[rows, columns])
        for axis, wrap in enumerate(signal.wraps):
            if wrap == "black":
                found[(at[..., axis] < 0.0) | (at[..., axis] > 1.0)] = self._border(signal)
        return found

    def _border(self, signal: Signal) -> Floats:
        """Return the value of a signal outside of its image, whose wrap mode is "black"; its mean for another one."""
        if signal.constant is not None or "black" not in signal.wraps:
            return self.mean(signal)
        border = signal.bias if signal.row is not None else signal.border
        return np.zeros(signal.width) if border is None else border

    def _size(self, signal: Signal) -> tuple[int, int]:
        """Return the size [h, w] of a texture or image."""
        if signal.image is not None:
            rows, columns = signal.image.shape[:2]
        elif signal.row is None or signal.row == VERTEX_COLORS:
            return 1, 1
        else:
            rows, columns = self._textures.textures[signal.row].pixels.shape[:2]
        return rows, columns

    def _pixels(self, signal: Signal, rows: slice = slice(None)) -> Image:
        """Return the values of a texture or image at its own texels, or some rows of them, [h, w, c]."""
        if signal.image is not None:
            return signal.image[rows]
        if signal.row is None:
            return np.full((1, 1, signal.width), 0.5, np.float32)
        values = np.ones((1, 1, len(signal.channels)), np.float32)
        if signal.row != VERTEX_COLORS:
            values = _linear(self._textures.textures[signal.row], rows)[..., list(signal.channels)]
        return np.asarray(values * signal.scale.astype(np.float32) + signal.bias.astype(np.float32))

    def is_gray(self, signal: Signal) -> bool:
        """Return whether the components of a signal are equal everywhere, but for the errors of compressed images."""
        values = signal.constant if signal.constant is not None else self._pixels(signal)
        return float(np.abs(values - values[..., :1]).max(initial=0.0)) <= _GRAY

    def mean(self, signal: Signal) -> Floats:
        """Return the mean of a signal over its texels, [c]."""
        if signal.constant is not None:
            return signal.constant
        values = grid(DEFAULT_SIZE, signal.uv) if signal.uv is not None else self._pixels(signal)
        return np.asarray(values.reshape(-1, values.shape[2]).mean(axis=0, dtype=np.float64))

    def largest(self, signal: Signal) -> float:
        """Return the largest value of a signal."""
        baked = self.apply(lambda values: values, signal)
        values = baked.constant if baked.constant is not None else baked.image
        return float(np.max(values)) if values is not None else 1.0

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
        factor: Any = _FACTORS.get(signal.tint)
        if factor is None:
            self._whitened()
        signal, factor = replace(signal, tint=()), factor or ""
        if signal.row is not None:
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
                return TextureLookup(signal.row, cast(Any, channel), scales, biases, place.transform, chosen, factor)
        baked = self.apply(lambda values: values, signal)
        assert baked.image is not None
        border = np.zeros(1) if baked.border is None else baked.border
        pixels, encoding = _stored(baked.image - border.astype(np.float32) if border.any() else baked.image)
        key = f"materialx {encoding} {hashlib.blake2b(pixels.tobytes(), digest_size=16).hexdigest()} {pixels.shape}"
        row = self._textures.add_image(key, name, pixels, encoding, baked.wraps)
        place, channel = baked.coordinates, "rgb" if width == 3 else "r"
        chosen, summands = uv_set(place.primvar), np.zeros(4)
        summands[:width] = border
        bias = cast(Any, tuple(summands.tolist()))
        return TextureLookup(
            row, cast(Any, channel), bias=bias, uv_transform=place.transform, uv_set=chosen, vertex_factor=factor
        )


def _wrapped(index: NDArray[np.int64], size: int, wrap: str) -> NDArray[np.int64]:
    if wrap == "repeat":
        return index % size
    if wrap == "mirror":
        index = index % (2 * size)
        return np.minimum(index, 2 * size - 1 - index)
    return np.clip(index, 0, size - 1)


def _strips(size: tuple[int, int]) -> Iterator[slice]:
    """Yield the rows of an image in strips, whose intermediate values stay in the processor's cache."""
    count = max(_STRIP // max(size[1], 1), 1)
    return (slice(start, min(start + count, size[0])) for start in range(0, size[0], count))


def _linear(texture: Texture, rows: slice) -> Image:
    """Return rows of a texture's linear RGBA, float32 [h, w, 4]."""
    pixels = texture.pixels[rows]
    if pixels.dtype != np.uint8:
        return np.asarray(pixels, np.float32)
    numbers = np.arange(256, dtype=np.float32) / np.float32(255.0)
    values = (decode_srgb(numbers) if texture.encoding == "srgb" else numbers)[pixels]
    values[..., 3] = numbers[pixels[..., 3]]
    return np.asarray(values)


def _stored(image: Image) -> tuple[Any, Encoding]:
    """Return computed values [h, w, 1 or 3] as pixels to store, and their encoding.

    Colors within 0..1 become 8-bit sRGB, numbers within 0..1 raw 8 bits, everything else stays float.
    """
    low, high = float(image.min(initial=0.0)), float(image.max(initial=0.0))
    size = image.shape[0], image.shape[1]
    if low < 0.0 or high > 1.0:
        pixels = np.ones((*size, 4), np.float32)
        pixels[..., :3] = image
        return pixels, "raw"
    encoding: Encoding = "srgb" if image.shape[2] == 3 else "raw"
    stored = np.full((*size, 4), 255, np.uint8)
    for rows in _strips(size):
        values = encode_srgb(image[rows]) if encoding == "srgb" else image[rows]
        stored[rows, :, :3] = np.rint(values * 255.0)
    return stored, encoding
