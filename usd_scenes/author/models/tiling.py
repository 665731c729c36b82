# SPDX-License-Identifier: Apache-2.0
"""Tiled walls and floors: separate, slightly misaligned tiles on a plane of grout."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from usd_scenes.author.model import Model, make_model
from usd_scenes.author.models.building import WallOpening, blocks
from usd_scenes.author.polygon_mesh import Array, PolygonMesh, grid, merged

JOINT, THICK, RECESS = 0.0022, 0.0085, 0.0016


def tiled_wall(
    name: str,
    width: float,
    height: float,
    material: str,
    tile: tuple[float, float],
    seed: int,
    openings: Sequence[WallOpening] = (),
    bond: float = 0.0,
    crooked: float = 0.35,
) -> Model:
    """Build tiles over 0..width along x and 0..height, facing +z from the wall at z = 0, cut at its openings.

    tile: width and height, m. bond: how far each row is shifted against the one below, in tiles. crooked: degrees.
    """
    rng = np.random.default_rng(seed)
    tiles, grout = [], []
    rows = int(np.ceil(height / tile[1] - 1e-6))
    for row in range(rows):
        y0, y1 = row * tile[1], min((row + 1) * tile[1], height)
        x = -tile[0] * ((bond * row) % 1.0)
        while x < width - 1e-6:
            pieces = [(max(x, 0.0), min(x + tile[0], width), y0, y1)]
            for hole in openings:
                pieces = [part for piece in pieces for part in _without(piece, hole)]
            for x0, x1, low, high in pieces:
                if x1 - x0 > 0.006 and high - low > 0.006:
                    tiles.append(_tile(x0, x1, low, high, rng, crooked))
            x += tile[0]
    cells_x = sorted({0.0, width, *(v for o in openings for v in (o.start, o.end) if 0.0 < v < width)})
    cells_y = sorted({0.0, height, *(v for o in openings for v in (o.sill, o.head) if 0.0 < v < height)})
    for x0, x1 in pairwise(cells_x):
        for y0, y1 in pairwise(cells_y):
            x, y = (x0 + x1) / 2.0, (y0 + y1) / 2.0
            if not any(o.start < x < o.end and o.sill < y < o.head for o in openings):
                grout.append(_plane(x0, x1, y0, y1, THICK - RECESS))
    edge = [_plane_edge(width, height)]
    slabs = (blocks(0.0, width, height, depth, openings) for depth in (THICK, THICK - RECESS))
    whole = make_model(name, "tiles", ("Tiles", material, tiles), ("Grout", "Grout", [*grout, *edge]))
    return whole.with_proxies(**dict(zip(("Tiles", "Grout"), slabs, strict=True)))


def tiled_floor(name: str, width: float, depth: float, material: str, tile: float, seed: int) -> Model:
    """Build square tiles about the origin, their top at y = 0."""
    wall = tiled_wall(name, width, depth, material, (tile, tile), seed, crooked=0.05)
    return replace(wall.rotated("x", -90.0).translated(-width / 2.0, -THICK, depth / 2.0), label="floor")


def checkered_floor(name: str, width: float, depth: float, materials: tuple[str, str], tile: float, seed: int) -> Model:
    """Build square tiles of two materials in turn about the origin, their top at y = 0."""
    rng = np.random.default_rng(seed)
    colors: tuple[list[PolygonMesh], list[PolygonMesh]] = ([], [])
    for row in range(int(np.ceil(depth / tile - 1e-6))):
        for column in range(int(np.ceil(width / tile - 1e-6))):
            x, y = column * tile, row * tile
            piece = _tile(x, min(x + tile, width), y, min(y + tile, depth), rng, 0.05)
            colors[(row + column) % 2].append(piece)
    parts = [(f"Tiles{index + 1}", material, colors[index]) for index, material in enumerate(materials)]
    whole = make_model(name, "floor", *parts, ("Grout", "Grout", _plane(0.0, width, 0.0, depth, THICK - RECESS)))
    slab = blocks(0.0, width, depth, THICK)
    whole = whole.with_proxies(Tiles1=slab, Tiles2=slab, Grout=blocks(0.0, width, depth, THICK - RECESS))
    return whole.rotated("x", -90.0).translated(-width / 2.0, -THICK, depth / 2.0)


def _without(piece: tuple[float, float, float, float], hole: WallOpening) -> list[tuple[float, float, float, float]]:
    """Return a rectangle (x0, x1, y0, y1) minus an opening, as rectangles."""
    x0, x1, y0, y1 = piece
    if hole.start >= x1 or hole.end <= x0 or hole.sill >= y1 or hole.head <= y0:
        return [piece]
    low, high = max(y0, hole.sill), min(y1, hole.head)
    parts = [(x0, x1, y0, low), (x0, x1, high, y1), (x0, hole.start, low, high), (hole.end, x1, low, high)]
    return [part for part in parts if part[1] - part[0] > 1e-6 and part[3] - part[2] > 1e-6]


def _tile(x0: float, x1: float, y0: float, y1: float, rng: np.random.Generator, crooked: float) -> PolygonMesh:
    """Build a pillowed face whose edges fall back into the joint."""
    gap, bevel = JOINT / 2.0, 0.0022
    xs = np.array(
        [x0 + gap, x0 + gap + 0.4 * bevel, x0 + gap + bevel, x1 - gap - bevel, x1 - gap - 0.4 * bevel, x1 - gap]
    )
    ys = np.array(
        [y0 + gap, y0 + gap + 0.4 * bevel, y0 + gap + bevel, y1 - gap - bevel, y1 - gap - 0.4 * bevel, y1 - gap]
    )
    fall = np.array([RECESS + 0.0008, 0.0005, 0.0, 0.0, 0.0005, RECESS + 0.0008])
    points = np.zeros((6, 6, 3))
    points[..., 0], points[..., 1] = xs[None], ys[:, None]
    points[..., 2] = THICK - np.maximum(fall[None], fall[:, None])
    lean = np.radians(rng.normal(0.0, crooked, 2)).clip(-0.012, 0.012)
    center = np.array([(x0 + x1) / 2.0, (y0 + y1) / 2.0])
    slope: Array = (points[..., :2] - center) @ lean
    points[..., 2] += np.where(points[..., 2] > THICK - RECESS, slope.clip(-0.0007, 0.0007), 0.0)
    return grid(points, points[..., :2] + rng.uniform(0.0, 1.0, 2))


def _plane(x0: float, x1: float, y0: float, y1: float, z: float) -> PolygonMesh:
    """Build a rectangle at z, facing +z."""
    points = np.array([[[x0, y0, z], [x1, y0, z]], [[x0, y1, z], [x1, y1, z]]])
    return grid(points, points[..., :2])


def _plane_edge(width: float, height: float) -> PolygonMesh:
    """Build the upper edge of the grout, visible where tiles end below the ceiling."""
    z = THICK - RECESS
    points = np.array([[[0.0, height, z], [width, height, z]], [[0.0, height, 0.0], [width, height, 0.0]]])
    return merged([grid(points, points[..., [0, 2]])])
