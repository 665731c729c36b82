# SPDX-License-Identifier: Apache-2.0
"""Soft shapes by formula: cushions, upholstery, curtains, throws, wrinkled by smooth random fields.

Cloth that needs contact with other objects is simulated instead, by `cloth_simulation`.
"""

from __future__ import annotations

import numpy as np

from usd_scenes.author.polygon_mesh import Array, PolygonMesh, grid, merged
from usd_scenes.author.shapes import circle, rounded_box, sweep


def wrinkles(points: Array, seed: int, wavelength: float, octaves: int = 3) -> Array:
    """Return a smooth random field over space, about unit variance: waves in random directions."""
    rng = np.random.default_rng(seed)
    total = np.zeros(len(points))
    for octave in range(octaves):
        for _ in range(8):
            direction = rng.normal(size=3)
            direction *= 2.0 * np.pi / (wavelength * 0.55**octave * np.linalg.norm(direction))
            total += np.sin(points @ direction + rng.uniform(0.0, 2.0 * np.pi)) * 0.6**octave / 2.0
    return total


def pillow(
    width: float, height: float, thickness: float, seed: int, cells: int = 36, piping: float = 0.0
) -> PolygonMesh:
    """Build a scatter pillow standing in the xy plane: two panels sewn along the edge, pulled in between its corners.

    The uv of the front panel covers 0..width and 0..height, m; that of the back panel is its mirror image.

    Args:
        width: m.
        height: m.
        thickness: m.
        seed: of the wrinkles.
        cells: grid cells along each side.
        piping: radius of a cord in the seam, m; 0 for none.
    """
    t = np.linspace(-1.0, 1.0, cells + 1)
    t = np.sin(t * np.pi / 2.0) * 0.35 + t * 0.65
    s, r = np.meshgrid(t, t)

    def outline(a: Array, b: Array) -> Array:
        """Draw the seams between the corners inward, as the filling does."""
        return np.asarray(a * (1.0 - 0.055 * (1.0 - b**2) * np.abs(a) ** 3))

    x, y = outline(s, r) * width / 2.0, outline(r, s) * height / 2.0
    dome = ((1.0 - np.abs(s) ** 2.6) * (1.0 - np.abs(r) ** 2.6)) ** 0.52
    panels = []
    for sign in (1.0, -1.0):
        z = sign * thickness / 2.0 * dome
        points = np.stack([x, y, z], axis=-1)
        flat = points.reshape(-1, 3)
        edge = np.clip(1.0 - np.maximum(np.abs(s), np.abs(r)), 0.0, 1.0).reshape(-1)
        radial = np.arctan2(r, s).reshape(-1)
        rng = np.random.default_rng(seed + (1 if sign > 0 else 2))
        tucks = sum(np.sin(n * radial + rng.uniform(0.0, 6.28)) for n in (17, 23, 31)) / 3.0
        z_offset = 0.0030 * wrinkles(flat, seed + int(sign), 0.16) * np.minimum(1.0, edge * 4.0)
        z_offset += 0.0045 * tucks * np.exp(-(((edge - 0.09) / 0.08) ** 2)) * np.minimum(1.0, edge * 30.0)
        points[..., 2] += sign * z_offset.reshape(points.shape[:2])
        uv = np.stack([(s + 1.0) / 2.0 * width, (r + 1.0) / 2.0 * height], axis=-1)
        panel = grid(points, uv)
        panels.append(panel if sign > 0 else panel.reversed(keep_normals=False))
    if piping > 0.0:
        seam = np.stack([x, y, 0.0 * x], axis=-1)
        border = np.concatenate([seam[0, :-1], seam[:-1, -1], seam[-1, :0:-1], seam[:0:-1, 0]])
        panels.append(sweep(border, circle(piping, 8), up=(0.0, 0.0, 1.0), closed=True))
    return merged(panels)


def cushion(
    width: float,
    height: float,
    depth: float,
    seed: int,
    crown: float = 0.02,
    radius: float = 0.035,
    pitch: float = 0.045,
) -> PolygonMesh:
    """Build an upholstery cushion about the origin: a filled box, higher in the middle, with welted seams.

    Args:
        width: along x, m.
        height: along y, m.
        depth: along z, m.
        seed: of the wrinkles.
        crown: height of the swelling in the middle, m.
        radius: of the edges, m.
        pitch: approximate side of its quads, m.
    """
    divisions = (max(4, round(width / pitch)), 3, max(4, round(depth / pitch)))
    box = rounded_box((width, height, depth), radius, 3, divisions)
    half = np.array([width, height, depth]) / 2.0

    def fill(points: Array) -> Array:
        q = points / half
        swell = (1.0 - np.abs(q[:, 0]) ** 3).clip(0.0) * (1.0 - np.abs(q[:, 2]) ** 3).clip(0.0)
        result = points.copy()
        result[:, 1] += crown * swell * np.where(q[:, 1] > 0.0, 1.0, 0.25) * np.sign(q[:, 1])
        belly = 1.0 + 0.012 * (1.0 - q[:, 1] ** 2)
        result[:, 0] *= belly
        result[:, 2] *= belly
        result[:, 1] += 0.0035 * wrinkles(points, seed, 0.30) * (q[:, 1] > 0.0)
        return result

    top = half[1] - 0.35 * radius
    corner = 0.65 * radius
    loop = _rounded_loop(half[0] - 0.12 * radius, half[2] - 0.12 * radius, corner)
    welts = [sweep(np.insert(loop, 1, level, axis=1), circle(0.0045, 8), closed=True) for level in (top, -top)]
    return merged([box.deformed(fill), *welts])


def _rounded_loop(x: float, z: float, radius: float) -> Array:
    """Return a closed rectangle of half sides x and z with round corners, as points at most 0.05 m apart, [n, 2]."""
    angle = np.linspace(0.0, np.pi / 2.0, 6)
    arc = np.stack([np.cos(angle), np.sin(angle)], axis=-1) * radius
    corners = []
    for sign_x, sign_z, flip in ((1, 1, False), (-1, 1, True), (-1, -1, False), (1, -1, True)):
        part = arc[::-1] if flip else arc
        corners.append(part * (sign_x, sign_z) + ((x - radius) * sign_x, (z - radius) * sign_z))
    points = np.concatenate(corners)
    dense = []
    for a, b in zip(points, np.roll(points, -1, axis=0), strict=True):
        steps = max(1, int(np.linalg.norm(b - a) / 0.05))
        dense.append(a + (b - a) * np.arange(steps)[:, None] / steps)
    return np.concatenate(dense)


def curtain(width: float, height: float, seed: int, folds: int = 7, depth: float = 0.055) -> PolygonMesh:
    """Build a hanging curtain in the xy plane, its hem at y = 0, with pleats that widen downward."""
    rng = np.random.default_rng(seed)
    columns, rows = folds * 14, 28
    t = np.linspace(0.0, 1.0, columns + 1)[None, :]
    down = np.linspace(1.0, 0.0, rows + 1)[:, None]
    phase = rng.uniform(0.0, 6.28, 4)
    wander = sum(np.sin((n + 1) * 2.1 * t + phase[n] + 1.4 * down * (n - 1.5)) for n in range(4)) * 0.10
    angle = 2.0 * np.pi * folds * t + wander * (0.6 + 2.4 * down)
    amplitude = depth * (0.55 + 0.45 * down) * (1.0 + 0.22 * np.sin(5.0 * t + phase[0]) * down)
    z = amplitude * (np.sin(angle) + 0.22 * np.sin(2.0 * angle + 0.6))
    x = (t - 0.5) * width * (1.0 + 0.05 * down) + 0.35 * depth * np.cos(2.0 * angle) * (0.4 + 0.6 * down)
    y = height * (1.0 - down) + 0.0 * t
    z = z + 0.010 * np.sin(9.0 * t + 4.0 * down + phase[1]) * down
    points = np.stack([x, y, z], axis=-1)[::-1]
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points[0], axis=0), axis=1))])
    uv = np.stack(np.broadcast_arrays(length[None, :], points[:, :1, 1]), axis=-1)
    front = grid(points, uv)
    return merged([front, cloth_back(front, 0.002)])


def cloth_back(front: PolygonMesh, thickness: float) -> PolygonMesh:
    """Build the back side of a cloth from its front."""
    back = front.reversed()
    return PolygonMesh(back.points + back.normals * thickness, back.normals, back.uv, back.counts, back.indices)


def throw(width: float, length: float, radius: float, drop: float, seed: int) -> PolygonMesh:
    """Build a woolen throw over an arm along z of `radius`; it hangs down by `drop` m on each side."""
    columns, rows = round(length / 0.02), round(width / 0.025)
    arc = np.pi * radius
    s = np.linspace(-drop - arc / 2.0, drop + arc / 2.0, columns + 1)
    turn = np.clip(s / (arc / 2.0), -1.0, 1.0) * np.pi / 2.0
    x = np.sin(turn) * radius
    y = np.cos(turn) * radius - np.maximum(np.abs(s) - arc / 2.0, 0.0)
    z = np.linspace(-width / 2.0, width / 2.0, rows + 1)
    points = np.zeros((rows + 1, columns + 1, 3))
    points[..., 0], points[..., 1], points[..., 2] = x[None], y[None], z[:, None]
    hang = np.maximum(np.abs(s) - arc / 2.0, 0.0)[None] / max(drop, 1e-6)
    ripple = wrinkles(points.reshape(-1, 3) * (0.3, 0.15, 1.0), seed, 0.13, 2).reshape(points.shape[:2])
    points[..., 0] += np.sign(s)[None] * (0.010 + 0.012 * (ripple + 1.0)) * hang**0.7
    points[..., 1] += (0.004 + 0.003 * ripple) * (1.0 - hang)
    points[..., 2] *= 1.0 - 0.06 * hang * (1.0 + 0.3 * ripple)
    points[..., 1] += 0.02 * np.sin(7.0 * z + seed)[:, None] * hang
    uv = np.stack(np.broadcast_arrays(s[None], z[:, None]), axis=-1)
    front = grid(points, uv).reversed()
    return merged([front, cloth_back(front, 0.006)])
