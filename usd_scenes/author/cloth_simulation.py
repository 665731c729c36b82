# SPDX-License-Identifier: Apache-2.0
"""Cloth by extended position-based dynamics (Macklin et al. 2016) in many small steps: what lies, hangs and is stuffed.

Run once, when a thing is authored, and saved as its mesh. Only elementwise arithmetic, which rounds alike everywhere.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from usd_scenes.author.polygon_mesh import Array, PolygonMesh, grid, merged

Indices = NDArray[np.int64]
Obstacle = Callable[[Array], tuple[Array, Array]]
"""Points [n, 3] to their distance outside it [n] and the unit direction away from it [n, 3]."""
GRAVITY = 9.81
STEP = 1.0 / 600.0


@dataclass
class _Springs:
    """Pairs that share no particle, so that all can be solved at once. apart: they only push."""

    first: Indices
    second: Indices
    rest: Array
    stiffness: float
    apart: bool = False

    def solve(self, points: Array, mobility: Array) -> None:
        a, b = self.first, self.second
        offset = points[b] - points[a]
        length = np.sqrt(_dot(offset, offset)) + 1e-12
        error = length - self.rest
        if self.apart:
            error = np.minimum(error, 0.0)
        share = mobility[a] + mobility[b]
        move = (self.stiffness * error / (length * np.where(share > 0.0, share, 1.0)))[:, None] * offset
        points[a] += mobility[a][:, None] * move
        points[b] -= mobility[b][:, None] * move


@dataclass
class Cloth:
    """One rectangular piece, or two sewn together at their edge; grids of particles [rows, columns].

    sheets: particle numbers of each piece; of a bag's second one the edge is the first one's.
    """

    points: Array
    sheets: list[Indices]
    springs: list[_Springs]
    mobility: Array = field(init=False)

    def __post_init__(self) -> None:
        self.mobility = np.ones(len(self.points))

    def pin(self, particles: Indices) -> None:
        """Holds some particles where they are."""
        self.mobility[particles.reshape(-1)] = 0.0

    def relax(
        self,
        seconds: float,
        obstacles: Sequence[Obstacle],
        friction: float = 0.5,
        drag: float = 2.0,
        gravity: float = 1.0,
    ) -> None:
        """Lets it fall. friction: of contacts, 0..1 of the way slid in a step. drag: of the air, 1/s."""
        points, velocity = self.points, np.zeros_like(self.points)
        weight = np.array([0.0, -GRAVITY * gravity, 0.0])
        loose = (self.mobility > 0.0)[:, None]
        for _ in range(round(seconds / STEP)):
            velocity = (velocity + weight * STEP) * (1.0 - drag * STEP)
            before = points.copy()
            points += np.where(loose, velocity * STEP, 0.0)
            for springs in self.springs:
                springs.solve(points, self.mobility)
            for obstacle in obstacles:
                distance, away = obstacle(points)
                depth = np.maximum(-distance, 0.0)
                touches = (depth > 0.0)[:, None] & loose
                points += np.where(touches, depth[:, None] * away, 0.0)
                slid = points - before
                slid -= _dot(slid, away)[:, None] * away
                points -= np.where(touches, friction * slid, 0.0)
            velocity = (points - before) / STEP
            speed = np.sqrt(_dot(velocity, velocity))[:, None]
            velocity *= np.minimum(1.0, 4.0 / np.maximum(speed, 1e-9))

    def sheet(self, number: int = 0) -> Array:
        """Positions of one piece, [rows, columns, 3]."""
        return self.points[self.sheets[number]]


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2])


def _grid_springs(at: Indices, flat: Array, stretch: float, shear: float, bend: float) -> list[_Springs]:
    """Stretch, shear and bending of a grid of particles whose pattern lies `flat` [n, 3], in independent groups."""
    rows, columns = at.shape
    i, j = np.mgrid[0:rows, 0:columns]
    result = []
    for di, dj, reach, stiffness in (
        (0, 1, 1, stretch),
        (1, 0, 1, stretch),
        (1, 1, 1, shear),
        (1, -1, 1, shear),
        (0, 2, 2, bend),
        (2, 0, 2, bend),
    ):
        if stiffness <= 0.0:
            continue
        inside = (i + di < rows) & (j + dj < columns) & (j + dj >= 0)
        along = j if di == 0 else i
        for parity in (0, 1):
            chosen = inside & ((along // reach) % 2 == parity)
            first, second = at[i[chosen], j[chosen]], at[i[chosen] + di, j[chosen] + dj]
            span = flat[second] - flat[first]
            keep = first != second
            rest = np.sqrt(_dot(span, span))
            result.append(_Springs(first[keep], second[keep], rest[keep], stiffness))
    return result


def sheet(pattern: Array, start: Array, *, stretch: float = 0.9, shear: float = 0.25, bend: float = 0.06) -> Cloth:
    """One piece. pattern: [rows, columns, 2], m, laid flat; start: [rows, columns, 3]. Stiffnesses 0..1, of a step."""
    rows, columns = pattern.shape[:2]
    at = np.arange(rows * columns).reshape(rows, columns)
    flat = np.insert(pattern.reshape(-1, 2), 1, 0.0, axis=1)
    return Cloth(np.round(start.reshape(-1, 3), 7), [at], _grid_springs(at, flat, stretch, shear, bend))


def bag(
    pattern: Array, start: Array, gap: Array, *, stretch: float = 0.9, shear: float = 0.2, bend: float = 0.03
) -> Cloth:
    """Two pieces sewn together, kept apart by their filling. gap: its thickness, [rows, columns], m, 0 at the edge.

    The first piece is the one on top: `start` moved along +y by half the gap.
    """
    rows, columns = pattern.shape[:2]
    count = rows * columns
    top = np.arange(count).reshape(rows, columns)
    bottom = top + count
    edge = np.zeros((rows, columns), dtype=bool)
    edge[[0, -1]] = edge[:, [0, -1]] = True
    bottom[edge] = top[edge]
    flat = np.insert(pattern.reshape(-1, 2), 1, 0.0, axis=1)
    lift = np.array([0.0, 0.5, 0.0]) * gap[..., None]
    points = np.concatenate([(start + lift).reshape(-1, 3), (start - lift).reshape(-1, 3)])
    springs: list[_Springs] = []
    for at in (top, bottom):
        springs += _grid_springs(at, np.concatenate([flat, flat]), stretch, shear, bend)
    inside = ~edge
    springs.append(_Springs(top[inside], bottom[inside], gap[inside], 0.35, apart=True))
    cloth = Cloth(np.round(points, 7), [top, bottom], springs)
    cloth.mobility[np.setdiff1d(np.arange(2 * count), np.concatenate([top.ravel(), bottom.ravel()]))] = 0.0
    return cloth


def pattern(width: float, height: float, cell: float) -> Array:
    """A rectangle about the origin, [rows, columns, 2], columns along x; rows run from -height/2 to +height/2."""
    columns, rows = round(width / cell), round(height / cell)
    x, y = np.meshgrid(np.linspace(-width / 2, width / 2, columns + 1), np.linspace(-height / 2, height / 2, rows + 1))
    return np.stack([x, y], axis=-1)


def box(low: Sequence[float], high: Sequence[float], radius: float) -> Obstacle:
    """A box with round edges."""
    center, half = (np.add(low, high)) / 2.0, (np.subtract(high, low)) / 2.0 - radius

    def measure(points: Array) -> tuple[Array, Array]:
        local = points - center
        q = np.abs(local) - half
        outside = np.maximum(q, 0.0)
        length = np.sqrt(_dot(outside, outside))
        deepest = np.maximum(np.maximum(q[:, 0], q[:, 1]), q[:, 2])
        axis = np.where(q >= deepest[:, None], 1.0, 0.0)
        away = np.where((length > 1e-9)[:, None], outside / np.maximum(length, 1e-9)[:, None], axis)
        size = np.sqrt(_dot(away, away))[:, None]
        return length + np.minimum(deepest, 0.0) - radius, away / size * np.where(local < 0.0, -1.0, 1.0)

    return measure


def rod(start: Sequence[float], end: Sequence[float], radius: float) -> Obstacle:
    """A round bar from start to end."""
    a, b = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    along = b - a
    square = float(along[0] ** 2 + along[1] ** 2 + along[2] ** 2)

    def measure(points: Array) -> tuple[Array, Array]:
        t = np.clip(_dot(points - a, np.broadcast_to(along, points.shape)) / square, 0.0, 1.0)
        offset = points - (a + t[:, None] * along)
        length = np.sqrt(_dot(offset, offset))
        return length - radius, offset / np.maximum(length, 1e-9)[:, None]

    return measure


def floor(height: float = 0.0) -> Obstacle:
    up = np.array([0.0, 1.0, 0.0])
    return lambda points: (points[:, 1] - height, np.broadcast_to(up, points.shape))


def landscape(points: Array, cell: float, clearance: float, slope: float = 6.0) -> Obstacle:
    """What lies under a cloth: the height over x and z of dense points [n, 3], no cliff steeper than `slope`."""
    low = points.min(axis=0) - 0.6
    shape = np.ceil((points.max(axis=0) + 0.6 - low) / cell).astype(int)[[0, 2]] + 1
    height = np.full(tuple(shape), points[:, 1].min() - 1.0)
    at = np.round((points[:, [0, 2]] - low[[0, 2]]) / cell).astype(int)
    np.maximum.at(height, (at[:, 0], at[:, 1]), points[:, 1])
    for axis in (0, 1):
        height = np.maximum.reduce([np.roll(height, way, axis) for way in (-1, 0, 1)])
    for _ in range(int(0.6 / cell)):
        for axis in (0, 1):
            for way in (1, -1):
                height = np.maximum(height, np.roll(height, way, axis) - slope * cell)

    def measure(where: Array) -> tuple[Array, Array]:
        u = (where[:, [0, 2]] - low[[0, 2]]) / cell
        base = np.clip(np.floor(u).astype(int), 0, shape - 2)
        t = np.clip(u - base, 0.0, 1.0)
        i, j = base[:, 0], base[:, 1]
        a, b, c, d = height[i, j], height[i + 1, j], height[i, j + 1], height[i + 1, j + 1]
        level = (a + (b - a) * t[:, 0]) * (1.0 - t[:, 1]) + (c + (d - c) * t[:, 0]) * t[:, 1]
        dx = ((b - a) * (1.0 - t[:, 1]) + (d - c) * t[:, 1]) / cell
        dz = ((c - a) * (1.0 - t[:, 0]) + (d - b) * t[:, 0]) / cell
        size = np.sqrt(1.0 + dx * dx + dz * dz)
        away = np.stack([-dx, np.ones_like(dx), -dz], axis=-1) / size[:, None]
        return (where[:, 1] - level) / size - clearance, away

    return measure


def refined(points: Array, times: int = 2) -> Array:
    """A grid with its cells split by Catmull-Rom interpolation, [rows, columns, k]."""
    result = points
    for axis in (0, 1):
        p = np.moveaxis(result, axis, 0)
        before = np.concatenate([2.0 * p[:1] - p[1:2], p[:-2]])
        after = np.concatenate([p[2:], 2.0 * p[-1:] - p[-2:-1]])
        a, b = p[:-1], p[1:]
        pieces = []
        for step in range(times):
            t = step / times
            cubic = (3.0 * (a - b) + after - before) * t**3 + (2.0 * before - 5.0 * a + 4.0 * b - after) * t**2
            pieces.append(0.5 * (cubic + (b - before) * t) + a)
        woven = np.stack(pieces, axis=1).reshape(-1, *p.shape[1:])
        result = np.moveaxis(np.concatenate([woven, p[-1:]]), 0, axis)
    return result


def blanket_mesh(points: Array, uv: Array, thickness: float) -> PolygonMesh:
    """A single cloth made solid: `points` [rows, columns, 3] are its middle, its front where columns x rows points."""
    middle = grid(points, uv)
    normals = middle.normals.reshape(points.shape)
    rows, columns = points.shape[:2]
    inset = np.minimum.reduce(
        [
            *np.broadcast_arrays(
                *[np.minimum(k, n - 1 - k) for k, n in zip(np.mgrid[0:rows, 0:columns], (rows, columns), strict=True)]
            )
        ]
    )
    half = thickness / 2.0 * np.minimum(1.0, 0.12 + 0.5 * inset)[..., None]
    return merged([grid(points + normals * half, uv), grid(points - normals * half, uv).reversed()])


def bag_mesh(cloth: Cloth, uv: Array, refine: int = 1) -> PolygonMesh:
    """Both pieces of a bag; its first one's front is where columns x rows points away from the second."""
    top, bottom = (refined(cloth.sheet(k), refine) for k in (0, 1))
    coordinates = refined(uv, refine)
    front = grid(top, coordinates)
    middle = front.normals.reshape(top.shape)[top.shape[0] // 2, top.shape[1] // 2]
    gap = (top - bottom)[top.shape[0] // 2, top.shape[1] // 2]
    upright = float((middle * gap).sum()) > 0.0
    back = grid(bottom, coordinates)
    return merged([front if upright else front.reversed(), back.reversed() if upright else back])
