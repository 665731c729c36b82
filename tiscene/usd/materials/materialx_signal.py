# SPDX-License-Identifier: Apache-2.0
"""Values in a MaterialX network: constants, texture coordinates, affine lookups of image files, and computed images.

An operation on constants gives a constant. Multiplying and adding constants keeps a lookup, so that the file itself is
the texture. Everything else is computed per texel, in the space of the texture coordinates (`materialx_baker`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.description import VERTEX_COLORS
from tiscene.usd.materials.texture import IDENTITY, Affine, Wrap

Floats = NDArray[np.float64]
Image = NDArray[np.float32]

DEFAULT_SIZE = 512  # px, of images computed from texture coordinates alone


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
        uv: texture coordinates as a value of two components, or as a point.
        third: constant third component of such a point.
        row: row of the texture table that is looked up; VERTEX_COLORS: the vertices' colors.
        channels: channels of that texture, one per component.
        scale: float64 [c], factor of each component of the lookup.
        bias: float64 [c], summand of each component.
        image: float32 [h, w, c], computed values, row 0 at the top.
        coordinates: where a texture or image is looked up.
        wraps: wrap modes of the texture or image.
        border: float64 [c], the value outside of an image whose wrap mode is "black"; None: 0.
        tint: channels of the vertices' colors that multiply the components of a texture or image; () for none.
    """

    constant: Floats | None = None
    uv: Coordinates | None = None
    third: float = 0.0
    row: int | None = None
    channels: tuple[int, ...] = ()
    scale: Floats = field(default_factory=lambda: np.zeros(0))
    bias: Floats = field(default_factory=lambda: np.zeros(0))
    image: Image | None = None
    coordinates: Coordinates = Coordinates()
    wraps: tuple[Wrap, Wrap] = ("repeat", "repeat")
    border: Floats | None = None
    tint: tuple[int, ...] = ()

    @property
    def width(self) -> int:
        """Number of components."""
        if self.constant is not None:
            return len(self.constant)
        if self.image is not None:
            return int(self.image.shape[2])
        return 2 if self.uv is not None else len(self.channels)

    @property
    def is_zero(self) -> bool:
        """Whether the value is 0 everywhere."""
        return self.constant is not None and not self.constant.any()

    def select(self, components: Sequence[int]) -> Signal:
        """Return a signal of some of the components, in any order and number.

        Missing ones are the last, or that of the point of texture coordinates.
        """
        if self.uv is not None and list(components) != [0, 1]:
            point = np.pad(grid(DEFAULT_SIZE, self.uv), ((0, 0), (0, 0), (0, 1)), constant_values=self.third)
            values = point[..., [min(each, 2) for each in components]]
            return Signal(image=values, coordinates=Coordinates(primvar=self.uv.primvar))
        rows = [min(each, self.width - 1) for each in components]
        if self.constant is not None:
            return replace(self, constant=self.constant[rows])
        tint = tuple(self.tint[each] for each in rows) if self.tint else ()
        if self.image is not None:
            border = None if self.border is None else self.border[rows]
            return replace(self, image=self.image[..., rows], border=border, tint=tint)
        if self.row is not None:
            channels = tuple(self.channels[each] for each in rows)
            return replace(self, channels=channels, scale=self.scale[rows], bias=self.bias[rows], tint=tint)
        return self

    def of_width(self, width: int) -> Signal:
        """Return the signal with a number of components: one is repeated, further ones are dropped or repeated."""
        return self if self.width == width else self.select([0] * width if self.width == 1 else range(width))

    def extended(self, width: int, apply: Callable[..., Signal]) -> Signal:
        """Return two or three components with further ones: z is 0, w and alpha are 1; `apply` is the baker's."""
        if self.width not in (2, 3) or width <= self.width:
            return self
        further = np.array([0.0, 0.0, 0.0, 1.0])[self.width : width]
        if self.row is None or self.tint:
            return apply(lambda values: np.concatenate([values, np.ones_like(values[..., :1]) * further], -1), self)
        channels = self.channels + self.channels[-1:] * len(further)
        scale, bias = np.append(self.scale, 0.0 * further), np.append(self.bias, further)
        return replace(self, channels=channels, scale=scale, bias=bias)

    def affine(self, factor: Floats, summand: Floats) -> Signal | None:
        """Return `factor * signal + summand`; None if it must be computed per texel."""
        width = max(self.width, len(factor), len(summand))
        factor, summand = _wide(factor, width), _wide(summand, width)
        if self.constant is not None:
            return Signal(constant=_wide(self.constant, width) * factor + summand)
        if self.uv is not None and width <= 3:
            matrix = np.array([[factor[0], 0.0, summand[0]], [0.0, factor[1], summand[1]], [0.0, 0.0, 1.0]])
            third = self.third * factor[-1] + (summand[-1] if width == 3 else 0.0)
            return Signal(uv=self.uv.mapped(matrix), third=float(third))
        if self.tint and summand.any():
            return None
        if self.tint and self.image is not None:
            return self.of_width(width)._scaled_image(factor)
        if self.row is None or self.uv is not None:
            return None
        wide = self.of_width(width)
        return replace(wide, scale=wide.scale * factor, bias=wide.bias * factor + summand)

    @property
    def reads_vertices(self) -> bool:
        """Whether the vertices' colors are the value or a factor of it."""
        return self.row == VERTEX_COLORS or bool(self.tint)

    def tinted(self, colors: Signal) -> Signal | None:
        """Return the product of a texture or image and the vertices' colors; None for other signals."""
        if colors.row != VERTEX_COLORS or colors.bias.any():
            return None
        if self.reads_vertices or (self.row is None and self.image is None):
            return None
        width = max(self.width, colors.width)
        wide, factor = self.of_width(width), _wide(colors.scale, width)
        tint = colors.of_width(width).channels
        if wide.image is not None:
            return replace(wide._scaled_image(factor), tint=tint)
        return replace(wide, scale=wide.scale * factor, bias=wide.bias * factor, tint=tint)

    def _scaled_image(self, factor: Floats) -> Signal:
        assert self.image is not None
        border = None if self.border is None else self.border * factor
        return replace(self, image=self.image * factor.astype(np.float32), border=border)


def lookup(row: int, channels: tuple[int, ...]) -> Signal:
    """Return channels of a texture, or of the vertices' colors (VERTEX_COLORS), as they are."""
    return Signal(row=row, channels=channels, scale=np.ones(len(channels)), bias=np.zeros(len(channels)))


def number(*values: float) -> Signal:
    """Return a constant."""
    return Signal(constant=np.array(values, np.float64))


def rotation(degrees: float) -> Floats:
    """Return the 3x3 matrix that turns coordinates counter-clockwise."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def shift(u: float, v: float) -> Floats:
    """Return the 3x3 matrix that moves coordinates."""
    return np.array([[1.0, 0.0, u], [0.0, 1.0, v], [0.0, 0.0, 1.0]])


def placement(pivot: Floats, scale: Floats, degrees: Floats, offset: Floats, translate_first: bool) -> Floats:
    """Return the 3x3 matrix of place2d: about a pivot, divide by a scale, turn clockwise, subtract an offset."""
    turn, move = rotation(-degrees[0]), shift(*-offset)
    size = np.diag([*(1.0 / np.where(scale == 0.0, 1.0, scale)), 1.0])
    middle = size @ turn @ move if translate_first else move @ turn @ size
    return np.asarray(shift(*pivot) @ middle @ shift(*-pivot))


def affine_operation(category: str, operands: Sequence[Signal]) -> Signal | None:
    """Return the result of an operation that keeps a lookup affine; None for all others."""
    if category not in ("multiply", "add", "subtract", "invert", "divide", "mix", "contrast"):
        return None
    one, zero = np.ones(1), np.zeros(1)
    first, second = operands[0], operands[1]
    if category == "mix" and operands[2].constant is not None:
        weight = operands[2].constant
        if first.constant is not None:
            return second.affine(weight, first.constant * (1.0 - weight))
        return first.affine(1.0 - weight, second.constant * weight) if second.constant is not None else None
    if category == "contrast" and second.constant is not None and operands[2].constant is not None:
        return first.affine(second.constant, operands[2].constant * (1.0 - second.constant))
    if category in ("mix", "contrast"):
        return None
    if category == "invert":
        return first.affine(-one, second.constant) if second.constant is not None else None
    if second.constant is not None:
        if category == "divide":
            return first.affine(1.0 / np.where(second.constant == 0.0, 1.0, second.constant), zero)
        return {
            "multiply": lambda: first.affine(second.constant, zero),
            "add": lambda: first.affine(one, second.constant),
            "subtract": lambda: first.affine(one, -second.constant),
        }[category]()
    if category == "multiply" and first.constant is None:
        return first.tinted(second) or second.tinted(first)
    if first.constant is None or category == "divide":
        return None
    if category == "multiply":
        return second.affine(first.constant, zero)
    return second.affine(one if category == "add" else -one, first.constant)


def _wide(values: Floats, width: int) -> Floats:
    return np.resize(values, width) if len(values) == 1 else values[:width]


def grid(size: int, coordinates: Coordinates | None) -> Image:
    """Return the coordinates of texels [size, size, 2], row 0 at the top (v = 1)."""
    at = (np.arange(size) + 0.5) / size
    u, v = np.meshgrid(at, at[::-1])
    matrix = (coordinates or Coordinates()).matrix()
    moved = np.stack([u, v], axis=-1) @ matrix[:2, :2].T + matrix[:2, 2]
    return moved.astype(np.float32)


def widened(operands: Sequence[Signal], is_point: Sequence[bool]) -> list[Signal]:
    """Return operands with equal numbers of components, except for single numbers and points of a pattern."""
    width = max((each.width for each, at in zip(operands, is_point, strict=True) if not at), default=1)
    return [
        each if at or each.width in (1, width) else each.of_width(width)
        for each, at in zip(operands, is_point, strict=True)
    ]
