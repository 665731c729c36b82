# SPDX-License-Identifier: Apache-2.0
"""MaterialX's noises of two and three dimensions as functions of texture coordinates.

The definitions are those of MaterialX's reference shaders: gradient noise (Perlin 2002), cell noise and Worley noise on
a lattice, hashed by Jenkins' lookup3, and sums of octaves. Noises of the place in space are held by no texture.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.usd.materials.materialx_baker import Baker
from tiscene.usd.materials.materialx_operations import ranged, rotate3d
from tiscene.usd.materials.materialx_signal import Signal

Array = NDArray[Any]
NOISES_2D = ("noise2d", "fractal2d", "cellnoise2d", "worleynoise2d", "unifiednoise2d")
NOISES_3D = ("noise3d", "fractal3d", "cellnoise3d", "worleynoise3d", "unifiednoise3d")
_PERLIN_SCALES = {2: 0.6616, 3: 0.9820}  # bring gradient noise of two or three dimensions to about -1..1
_MIX = (("a", "c", "b", 4), ("b", "a", "c", 6), ("c", "b", "a", 8))  # of Jenkins' mix: changed, subtracted, added
_MIX_LATER = (("a", "c", "b", 16), ("b", "a", "c", 19), ("c", "b", "a", 4))
_SHIFT, _FRACTAL_SHIFT = np.array([19.0, 73.0, 29.0]), np.array([19.0, 193.0, 17.0])  # of components of their own
_JITTER_TURNS = 90000.0  # degrees of a unified noise for each unit of its jitter


def lattice_hash(*cell: Array) -> Array:
    """Return the hash, uint32, of two to four integer coordinates."""
    start = np.uint32((0xDEADBEEF + 4 * len(cell) + 13) & 0xFFFFFFFF)
    places = [each.astype(np.int64).astype(np.uint32) for each in cell]
    values: dict[str, Array] = {name: start + each for name, each in zip("abc", places, strict=False)}
    values.setdefault("c", np.full(values["a"].shape, start, np.uint32))
    if len(places) == 4:
        for target, source, summand, turn in (*_MIX, *_MIX_LATER):
            values[target] = (values[target] - values[source]) ^ _rotated(values[source], turn)
            values[source] = values[source] + values[summand]
        values["a"] = values["a"] + places[3]
    order = (("c", "b"), ("a", "c"), ("b", "a"), ("c", "b"), ("a", "c"), ("b", "a"), ("c", "b"))
    for (target, source), turn in zip(order, (14, 11, 25, 16, 4, 14, 24), strict=True):
        values[target] = (values[target] ^ values[source]) - _rotated(values[source], turn)
    return values["c"]


def gradient_noise(at: Array, channels: int) -> Array:
    """Return gradient noise [..., channels] at coordinates [..., 2 or 3]; channels 1 or 3, which differ."""
    dimensions = at.shape[-1]
    cell = np.floor(at)
    rest = (at - cell).astype(np.float64)
    fade = rest * rest * rest * (rest * (rest * 6.0 - 15.0) + 10.0)
    corners = []
    for corner in itertools.product((0, 1), repeat=dimensions):
        step = np.array(corner[::-1])  # x varies first
        bits = lattice_hash(*np.moveaxis(cell + step, -1, 0))
        parts = [bits] if channels == 1 else [bits >> np.uint32(8 * k) & np.uint32(0xFF) for k in range(3)]
        offset = np.moveaxis(rest - step, -1, 0)
        corners.append(np.stack([_gradient(part, *offset) for part in parts], axis=-1))
    for axis in range(dimensions):
        weight = fade[..., axis : axis + 1]
        corners = [low + (high - low) * weight for low, high in zip(corners[::2], corners[1::2], strict=True)]
    return np.asarray(_PERLIN_SCALES[dimensions] * corners[0])


def cell_noise(at: Array, channels: int = 1) -> Array:
    """Return values of 0..1 [..., channels] for each cell of the lattice, at coordinates [..., 2 or 3]."""
    cell = tuple(np.moveaxis(np.floor(at), -1, 0))
    if channels == 1:
        return _unit(lattice_hash(*cell))[..., None]
    return np.stack([_unit(lattice_hash(*cell, np.full(cell[0].shape, k))) for k in range(channels)], axis=-1)


def worley_noise(at: Array, channels: int, jitter: float, solid: bool) -> Array:
    """Return the distances [..., channels] of the nearest points of the lattice's cells, or the noise of the nearest.

    Args:
        at: coordinates [..., 2 or 3].
        channels: number of nearest points, or of values.
        jitter: how far points are from the middles of their cells.
        solid: whether the values of the nearest point's cell are returned.
    """
    dimensions, cell = at.shape[-1], np.floor(at)
    offsets = []
    for step in itertools.product((-1, 0, 1), repeat=dimensions):
        points = (cell_noise(cell + np.array(step), 3)[..., :dimensions] - 0.5) * jitter + 0.5
        offsets.append(points + np.array(step) - (at - cell))
    distances = np.stack([(each * each).sum(axis=-1) for each in offsets], axis=-1)
    if not solid:
        return np.asarray(np.sqrt(np.sort(distances, axis=-1)[..., :channels]))
    nearest = distances.argmin(axis=-1)[..., None, None]
    return cell_noise(at + np.take_along_axis(np.stack(offsets, axis=-2), nearest, axis=-2)[..., 0, :], channels)


def fractal_noise(at: Array, octaves: int, lacunarity: float, diminish: float, channels: int) -> Array:
    """Return a sum of octaves of gradient noise; each is `lacunarity` times as fine and `diminish` times as strong."""
    total, strength, place = np.zeros((*at.shape[:-1], channels)), 1.0, np.asarray(at, np.float64)
    for _ in range(octaves):
        total += strength * gradient_noise(place, channels)
        strength *= diminish
        place = place * lacunarity
    return total


def _rotated(values: Array, bits: int) -> Array:
    return np.asarray(values << np.uint32(bits) | values >> np.uint32(32 - bits))


def _unit(bits: Array) -> Array:
    return np.asarray(bits.astype(np.float64) / 0xFFFFFFFF)


def _gradient(bits: Array, x: Array, y: Array, z: Array | None = None) -> Array:
    """Return the dot product of an offset with one of eight gradients, or of twelve in three dimensions."""
    chosen = bits & np.uint32(7 if z is None else 15)
    flat = chosen < 4
    if z is None:
        u, v = np.where(flat, x, y), 2.0 * np.where(flat, y, x)
    else:
        u, v = np.where(chosen < 8, x, y), np.where(flat, y, np.where((chosen == 12) | (chosen == 14), x, z))
    return np.where(chosen & np.uint32(1), -u, u) + np.where(chosen & np.uint32(2), -v, v)


def evaluate_noise(category: str, at: Array, channels: int, numbers: Sequence[float]) -> Array:
    """Return a noise node's values before amplitude and pivot.

    Args:
        category: one of NOISES_2D and NOISES_3D, but for unified noise.
        at: coordinates [..., 2 or 3].
        channels: of the values.
        numbers: octaves, lacunarity and diminish of fractal noise; jitter and style of Worley noise.
    """
    if category.startswith("cell"):
        return cell_noise(at)
    if category.startswith("worley"):
        return worley_noise(at, channels, numbers[0], numbers[1] > 0.5)
    dimensions = at.shape[-1]
    if category.startswith("noise"):
        if channels < 4:
            return gradient_noise(at, 1 if channels == 1 else 3)[..., :channels]
        return np.concatenate([gradient_noise(at, 3), gradient_noise(at + _SHIFT[:dimensions], 1)], axis=-1)
    octaves = int(np.clip(numbers[0], 1, 16)), numbers[1], numbers[2]
    first = fractal_noise(at, *octaves, 1 if channels < 3 else 3)
    if channels in (1, 3):
        return first
    return np.concatenate([first, fractal_noise(at + _FRACTAL_SHIFT[:dimensions], *octaves, 1)], axis=-1)


def _unified_noise(at: Array, kind: int, octaves: Sequence[float], jitter: float, style: float) -> Array:
    """Return unifiednoise2d or unifiednoise3d, after their graphs, before the range of the output."""
    degrees = np.array([(jitter - 1.0) * _JITTER_TURNS])
    if kind == 2:
        return evaluate_noise("worley", at, 1, (jitter, style))
    if at.shape[-1] == 2 and kind == 3:
        return evaluate_noise("fractal", np.insert(at, 2, degrees, axis=-1), 1, octaves)
    if jitter != 1.0:
        axis = (0.1, 1.0, 0.0) if at.shape[-1] == 3 else (0.0, 0.0, 1.0)
        point = at if at.shape[-1] == 3 else np.insert(at, 2, 0.0, axis=-1)
        at = rotate3d(point, degrees, np.array(axis))[..., : at.shape[-1]]
    if kind == 0:
        return 0.5 + 0.5 * gradient_noise(at, 1)
    return cell_noise(at) if kind == 1 else evaluate_noise("fractal", at, 1, octaves)


def noise_signal(
    category: str, at: Signal, width: int, value: Callable[[str, Any], Signal], baker: Baker
) -> Signal | None:
    """Return a noise node's output, computed per texel; None where its values have no such number of components.

    Args:
        category: one of NOISES_2D and NOISES_3D.
        at: texture coordinates, or a point [u, v, third].
        width: components of the output.
        value: returns an input by its name and default.
        baker: computes.
    """
    if width > 3 and category.startswith("worley"):
        return None

    def numbers(*named: tuple[str, float]) -> list[float]:
        return [float(baker.mean(value(name, start))[0]) for name, start in named]

    octaves = numbers(("octaves", 3.0), ("lacunarity", 2.0), ("diminish", 0.5))
    at = at if category.endswith("2d") else at.select((0, 1, 2))
    jitter, style, kind = numbers(("jitter", 1.0), ("style", 0.0), ("type", 0.0))
    if category.startswith("unified"):
        low, high, clamp, frequency, offset = (
            value(*each)
            for each in (("outmin", 0.0), ("outmax", 1.0), ("clampoutput", 1.0), ("freq", 1.0), ("offset", 0.0))
        )

        def unified(at: Array, low: Array, high: Array, clamp: Array, frequency: Array, offset: Array) -> Array:
            noise = _unified_noise(at * frequency + offset, int(kind), octaves, jitter, style)
            zero, one = np.zeros(1), np.ones(1)
            return ranged(noise, zero, one, one, low, high, clamp)

        return baker.apply(unified, at, low, high, clamp, frequency, offset)
    given = (jitter, style) if category.startswith("worley") else octaves
    scaled = category.startswith(("noise", "fractal"))
    return baker.apply(
        lambda at, factor, summand: factor * evaluate_noise(category, at, width, given) + summand,
        at,
        value("amplitude" if scaled else "", 1.0),
        value("pivot" if category.startswith("noise") else "", 0.0),
    )
