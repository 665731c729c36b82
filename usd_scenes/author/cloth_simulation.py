# SPDX-License-Identifier: Apache-2.0
"""Cloth simulation by position-based dynamics with small steps, after Macklin et al., "XPBD" (2016).

Used for cloth that lies, hangs or is stuffed. It runs once, when a model is authored; the result is saved as a mesh.
All arithmetic is elementwise, so that it rounds alike on every processor.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from usd_scenes.author.polygon_mesh import Array, PolygonMesh, grid, merged

Indices = NDArray[np.int64]
Obstacle = Callable[[Array], tuple[Array, Array]]
"""Maps points [n, 3] to their signed distances [n] and the unit directions away from the obstacle [n, 3]."""
GRAVITY = 9.81  # m/s²
STEP = 1.0 / 600.0  # s


@dataclass
class _Springs:
    """Distance constraints between disjoint pairs of particles, which can all be solved at once.

    Attributes:
        first: [k], one particle of each pair.
        second: [k], the other one.
        rest: rest lengths, [k], m.
        stiffness: fraction of the error corrected in a step, 0..1.
        push_only: whether only compression is corrected.
    """

    first: Indices
    second: Indices
    rest: Array
    stiffness: float
    push_only: bool = False

    def solve(self, points: Array, mobility: Array) -> None:
        """Move the points [n, 3] in place; `mobility` [n] is 0 for pinned particles, else 1."""
        a, b = self.first, self.second
        offset = points[b] - points[a]
        length = np.sqrt(_dot(offset, offset)) + 1e-12
        error = length - self.rest
        if self.push_only:
            error = np.minimum(error, 0.0)
        share = mobility[a] + mobility[b]
        move = (self.stiffness * error / (length * np.where(share > 0.0, share, 1.0)))[:, None] * offset
        points[a] += mobility[a][:, None] * move
        points[b] -= mobility[b][:, None] * move


@dataclass
class Cloth:
    """One rectangular sheet, or two sewn together at their edges.

    Attributes:
        points: positions, [n, 3], m.
        sheets: particles of each sheet, [rows, columns]; a bag's sheets share their edge particles.
        springs: the constraints, in the order in which they are solved.
        mobility: [n], 0 for pinned particles, else 1.
    """

    points: Array
    sheets: list[Indices]
    springs: list[_Springs]
    mobility: Array = field(init=False)

    def __post_init__(self) -> None:
        self.mobility = np.ones(len(self.points))

    def pin(self, particles: Indices) -> None:
        """Fix some particles in place."""
        self.mobility[particles.reshape(-1)] = 0.0

    def relax(
        self,
        seconds: float,
        obstacles: Sequence[Obstacle],
        friction: float = 0.5,
        drag: float = 2.0,
        gravity: float = 1.0,
    ) -> None:
        """Simulate.

        Args:
            seconds: simulated time.
            obstacles: what the cloth collides with.
            friction: fraction of the sliding removed at contacts in each step, 0..1.
            drag: of the air, 1/s.
            gravity: multiple of GRAVITY.
        """
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
        """Return the positions of a sheet, [rows, columns, 3]."""
        return self.points[self.sheets[number]]


def _dot(a: Array, b: Array) -> Array:
    """Return the dot products of rows [n, 3] in a fixed order of additions."""
    return np.asarray(a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2])


def _grid_springs(at: Indices, flat: Array, stretch: float, shear: float, bend: float) -> list[_Springs]:
    """Return stretch, shear and bending springs of a grid of particles with rest positions `flat` [n, 3]."""
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
    """Return a cloth of one sheet.

    Args:
        pattern: rest positions, [rows, columns, 2], m.
        start: initial positions, [rows, columns, 3], m.
        stretch: stiffness, fraction of the error corrected in a step, 0..1.
        shear: stiffness against shear, as `stretch`.
        bend: stiffness against bending, as `stretch`.
    """
    rows, columns = pattern.shape[:2]
    at = np.arange(rows * columns).reshape(rows, columns)
    flat = np.insert(pattern.reshape(-1, 2), 1, 0.0, axis=1)
    return Cloth(np.round(start.reshape(-1, 3), 7), [at], _grid_springs(at, flat, stretch, shear, bend))


def bag(
    pattern: Array, start: Array, gap: Array, *, stretch: float = 0.9, shear: float = 0.2, bend: float = 0.03
) -> Cloth:
    """Return a cloth of two sheets sewn together, with a filling between them.

    Args:
        pattern: rest positions of each sheet, [rows, columns, 2], m.
        start: initial positions of the middle, [rows, columns, 3], m; the first sheet starts half the gap above.
        gap: thickness of the filling, [rows, columns], m, 0 at the edge.
        stretch: stiffness, fraction of the error corrected in a step, 0..1.
        shear: stiffness against shear, as `stretch`.
        bend: stiffness against bending, as `stretch`.
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
    springs.append(_Springs(top[inside], bottom[inside], gap[inside], 0.35, push_only=True))
    cloth = Cloth(np.round(points, 7), [top, bottom], springs)
    cloth.mobility[np.setdiff1d(np.arange(2 * count), np.concatenate([top.ravel(), bottom.ravel()]))] = 0.0
    return cloth


def pattern(width: float, height: float, cell: float) -> Array:
    """Return rest positions of a rectangle about the origin: [rows, columns, 2], columns along x, rows along y."""
    columns, rows = round(width / cell), round(height / cell)
    x, y = np.meshgrid(np.linspace(-width / 2, width / 2, columns + 1), np.linspace(-height / 2, height / 2, rows + 1))
    return np.stack([x, y], axis=-1)


def box(low: Sequence[float], high: Sequence[float], radius: float) -> Obstacle:
    """Return a box with round edges as an obstacle."""
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
    """Return a round bar from start to end as an obstacle."""
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
    """Return a horizontal plane as an obstacle."""
    up = np.array([0.0, 1.0, 0.0])
    return lambda points: (points[:, 1] - height, np.broadcast_to(up, points.shape))


def landscape(points: Array, cell: float, clearance: float, slope: float = 6.0) -> Obstacle:
    """Return a height field as an obstacle.

    Args:
        points: dense points [n, 3] below the cloth; the highest one in each cell counts.
        cell: side of the cells, m.
        clearance: distance kept from the surface, m.
        slope: maximum slope; steeper steps are filled.
    """
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
    """Subdivide a grid [rows, columns, k] by Catmull-Rom interpolation, each cell `times` times along each side."""
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
    """Build a solid mesh of a sheet with middle `points` [rows, columns, 3]; the front faces along columns × rows."""
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
    """Build the mesh of a bag, facing outward; `refine` splits each cell that many times along each side."""
    top, bottom = (refined(cloth.sheet(k), refine) for k in (0, 1))
    coordinates = refined(uv, refine)
    front = grid(top, coordinates)
    middle = front.normals.reshape(top.shape)[top.shape[0] // 2, top.shape[1] // 2]
    gap = (top - bottom)[top.shape[0] // 2, top.shape[1] // 2]
    upright = float((middle * gap).sum()) > 0.0
    back = grid(bottom, coordinates)
    return merged([front if upright else front.reversed(), back.reversed() if upright else back])
