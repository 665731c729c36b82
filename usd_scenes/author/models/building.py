# SPDX-License-Identifier: Apache-2.0
"""Parts of a room's shell: floor, walls with openings, windows, curtains, skirting, ceiling, door, rug."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from usd_scenes.author.model import Model, make_model
from usd_scenes.author.polygon_mesh import PolygonMesh, grid, merged
from usd_scenes.author.shapes import circle, cylinder, fillet, molding, molding_boxes, rounded_box, sphere, sweep
from usd_scenes.author.soft import curtain
from usd_scenes.author.textures.wood import STRIPS

ROOT = 0.004  # m; moldings overlap walls and floors by this much, because touching edges leak light
FOOTING = 0.02  # of walls beside floors whose joints no skirting covers, m


@dataclass(frozen=True)
class WallOpening:
    """A rectangular opening in a wall: from `start` to `end` along it, from `sill` to `head` above the floor, m."""

    start: float
    end: float
    sill: float
    head: float


def planks(width: float, depth: float, seed: int) -> Model:
    """Build an oak floor about the origin, its top at y = 0: beveled boards 0.16 m wide along z, each different."""
    rng = np.random.default_rng(seed)
    board, boards = 0.16, []
    columns = int(np.ceil(width / board))
    for column in range(columns):
        x0 = -width / 2.0 + column * board
        x1 = min(x0 + board, width / 2.0)
        z = -depth / 2.0 - rng.uniform(0.0, 1.4)
        while z < depth / 2.0:
            length = rng.uniform(1.2, 2.2)
            z0, z1 = max(z, -depth / 2.0), min(z + length, depth / 2.0)
            z += length
            if z1 - z0 > 0.02:
                boards.append(_plank(x0, x1, z0, z1, rng))
    under = grid(
        np.array(
            [[[-width, -0.012, depth], [width, -0.012, depth]], [[-width, -0.012, -depth], [width, -0.012, -depth]]]
        )
        / 2.0
        * (1, 2, 1),
        np.zeros((2, 2, 2)),
    )
    return make_model("Floor", "floor", ("Planks", "OakFloor", boards), ("Underlay", "FloorGap", under))


def _plank(x0: float, x1: float, z0: float, z1: float, rng: np.random.Generator) -> PolygonMesh:
    """Build a board with beveled edges and a random place in the texture."""
    gap, bevel, drop = 0.0004, 0.0022, 0.0016
    xs = [x0 + gap, x0 + gap, x0 + gap + bevel, x1 - gap - bevel, x1 - gap, x1 - gap]
    zs = [z1 - gap, z1 - gap, z1 - gap - bevel, z0 + gap + bevel, z0 + gap, z0 + gap]
    points = np.zeros((6, 6, 3))
    points[..., 0], points[..., 2] = np.array(xs)[None], np.array(zs)[:, None]
    inside = np.zeros((6, 6), dtype=bool)
    inside[2:4, 2:4] = True
    points[..., 1] = np.where(inside, 0.0, -drop)
    border = np.zeros((6, 6), dtype=bool)
    border[[0, -1]] = border[:, [0, -1]] = True
    points[border, 1] = -0.012
    points[inside, 1] += rng.normal(0.0, 0.00008, 4).clip(-0.0002, 0.0)
    strip = int(rng.integers(STRIPS))
    u = (points[..., 2] - z0) + rng.uniform(0.0, 2.4)
    v = (strip + 0.015 + 0.97 * (points[..., 0] - x0) / 0.16) * 0.16
    return grid(points, np.stack([u, v], axis=-1))


def wall(
    name: str,
    start: Sequence[float],
    end: Sequence[float],
    height: float,
    thickness: float,
    material: str,
    openings: Sequence[WallOpening] = (),
    footing: float = 0.0,
) -> Model:
    """Build a wall from start to end (x, z), with the room on the right and its body on the left.

    The wall is cut into boxes around its openings; faces between boxes are left out. It reaches below the floor by its
    footing, m, so that joints of floors beside it do not show what is outside.
    """
    a, b = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    length = float(np.linalg.norm(b - a))
    along = (b - a) / length
    cuts_x = sorted({-thickness, length + thickness, *(o.start for o in openings), *(o.end for o in openings)})
    cuts_y = sorted({-footing, height, *(o.sill for o in openings), *(o.head for o in openings)})

    def solid(i: int, j: int) -> bool:
        if not (0 <= i < len(cuts_x) - 1 and 0 <= j < len(cuts_y) - 1):
            return False
        x, y = (cuts_x[i] + cuts_x[i + 1]) / 2.0, (cuts_y[j] + cuts_y[j + 1]) / 2.0
        return not any(o.start < x < o.end and o.sill < y < o.head for o in openings)

    faces: list[PolygonMesh] = []

    def face(corners: Sequence[Sequence[float]], du: int, dv: int) -> None:
        p = np.array(corners, dtype=np.float64)
        faces.append(grid(p[[0, 1, 3, 2]].reshape(2, 2, 3), p[[0, 1, 3, 2]][:, [du, dv]].reshape(2, 2, 2)))

    t = -thickness
    for i in range(len(cuts_x) - 1):
        for j in range(len(cuts_y) - 1):
            if not solid(i, j):
                continue
            x0, x1, y0, y1 = cuts_x[i], cuts_x[i + 1], cuts_y[j], cuts_y[j + 1]
            face([[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0]], 0, 1)
            face([[x1, y0, t], [x0, y0, t], [x0, y1, t], [x1, y1, t]], 0, 1)
            if not solid(i + 1, j):
                face([[x1, y0, 0], [x1, y0, t], [x1, y1, t], [x1, y1, 0]], 2, 1)
            if not solid(i - 1, j):
                face([[x0, y0, t], [x0, y0, 0], [x0, y1, 0], [x0, y1, t]], 2, 1)
            if not solid(i, j + 1):
                face([[x0, y1, 0], [x1, y1, 0], [x1, y1, t], [x0, y1, t]], 0, 2)
            if not solid(i, j - 1):
                face([[x0, y0, t], [x1, y0, t], [x1, y0, 0], [x0, y0, 0]], 0, 2)
    right = np.array([-along[1], along[0]])
    matrix = np.array([[along[0], 0.0, right[0]], [0.0, 1.0, 0.0], [along[1], 0.0, right[1]]])
    boxes = blocks(-thickness, length + thickness, height, -thickness, openings)
    plaster, *boxes = (mesh.transformed(matrix).translated(a[0], 0.0, a[1]) for mesh in (merged(faces), *boxes))
    return make_model(name, "wall", ("Plaster", material, plaster)).with_proxies(Plaster=boxes)


def blocks(
    start: float, end: float, height: float, depth: float, openings: Sequence[WallOpening] = ()
) -> list[PolygonMesh]:
    """Build the boxes of a wall beside, below and above its openings: from start to end along x, z = 0 to depth."""
    boxes = []

    def block(x0: float, x1: float, y0: float, y1: float) -> None:
        if x1 > x0 and y1 > y0:
            box = rounded_box((x1 - x0, y1 - y0, abs(depth)))
            boxes.append(box.translated((x0 + x1) / 2.0, (y0 + y1) / 2.0, depth / 2.0))

    x = start
    for opening in sorted(openings, key=lambda each: each.start):
        block(x, opening.start, 0.0, height)
        block(opening.start, opening.end, 0.0, opening.sill)
        block(opening.start, opening.end, opening.head, height)
        x = opening.end
    block(x, end, 0.0, height)
    return boxes


def window(name: str, width: float, height: float, thickness: float) -> Model:
    """Build a pair of timber casements with a sill board, in the xy plane about the opening's lower middle.

    The room is on the +z side, z = 0 being the wall's inner face. Open to the air: there is no pane.
    """
    z, parts = -thickness * 0.62, []
    frame, sash = 0.055, 0.050
    for x in (-1.0, 1.0):
        parts.append(rounded_box((frame, height, 0.075), 0.004).translated(x * (width - frame) / 2.0, height / 2.0, z))
    for y in (frame / 2.0, height - frame / 2.0):
        parts.append(rounded_box((width - 2.0 * frame + 0.002, frame, 0.075), 0.004).translated(0.0, y, z))
    leaf_width, leaf_height = width / 2.0 - frame, height - 2.0 * frame
    for side in (-1.0, 1.0):
        center = side * leaf_width / 2.0
        for x in (-1.0, 1.0):
            parts.append(
                rounded_box((sash, leaf_height - 0.006, 0.052), 0.005).translated(
                    center + x * (leaf_width - sash - 0.004) / 2.0, height / 2.0, z + 0.018
                )
            )
        for y in (frame + sash / 2.0 + 0.003, height - frame - sash / 2.0 - 0.003):
            parts.append(rounded_box((leaf_width - 2.0 * sash, sash, 0.052), 0.005).translated(center, y, z + 0.018))
        bar = frame + leaf_height * 0.70
        parts.append(rounded_box((leaf_width - 2.0 * sash, 0.024, 0.030), 0.004).translated(center, bar, z + 0.018))
    sill = rounded_box((width + 0.12, 0.028, thickness * 0.62 + 0.045), 0.007, 2).translated(
        0.0, -0.013, -thickness * 0.31 + 0.0225
    )
    handle = [
        rounded_box((0.026, 0.070, 0.008), 0.003, 2).translated(0.028, height * 0.45, z + 0.048),
        sweep([[0.028, height * 0.45, z + 0.050], [0.028, height * 0.45, z + 0.080]], circle(0.007, 12)),
        sweep(
            [[0.028, height * 0.45 + 0.010, z + 0.082], [0.028, height * 0.45 - 0.11, z + 0.082]],
            circle(0.0075, 12),
            up=(0.0, 0.0, 1.0),
            bevel=0.004,
        ),
    ]
    return make_model(name, "window", ("Timber", "TrimPaint", [*parts, sill]), ("Handle", "Steel", handle))


def curtain_pair(name: str, opening: float, height: float, seed: int, width: float = 0.42) -> Model:
    """Build two curtains drawn aside and their rod, in the xy plane; hem at y = 0, rod at y = height."""
    cloth = [
        curtain(width, height - 0.02, seed + i, 6).translated(side * (opening / 2.0 + width * 0.38), 0.0, 0.0)
        for i, side in enumerate((-1.0, 1.0))
    ]
    reach = opening / 2.0 + width + 0.06
    rod = sweep([[-reach, height, 0.0], [reach, height, 0.0]], circle(0.011, 16))
    ends = [sphere(0.022, 20).translated(side * (reach + 0.012), height, 0.0) for side in (-1.0, 1.0)]
    brackets = [
        sweep([[side * (reach - 0.08), height, 0.0], [side * (reach - 0.08), height, -0.13]], circle(0.006, 10))
        for side in (-1.0, 1.0)
    ]
    return make_model(name, "curtain", ("Cloth", "Linen", cloth), ("Rod", "BlackMetal", [rod, *ends, *brackets]))


def skirting(name: str, runs: Sequence[Sequence[Sequence[float]]]) -> Model:
    """Build a skirting board, 0.10 m, along runs of floor points (x, z), with the room on the right."""
    outline = [[0.0165, -ROOT], [0.0165, 0.082], [0.010, 0.094], [0.008, 0.102], [-ROOT, 0.102]]
    profile = fillet(outline, 0.004, 3)
    boards = [molding(np.insert(np.asarray(run, dtype=np.float64), 1, 0.0, axis=1), profile) for run in runs]
    boxes = [box for run in runs for box in molding_boxes(run, 0.0165, 0.0, 0.102)]
    return make_model(name, "skirting", ("Timber", "TrimPaint", boards)).with_proxies(Timber=boxes)


def cornice(name: str, corners: Sequence[Sequence[float]], height: float) -> Model:
    """Build a plain coved cornice round a ceiling; corners are (x, z) with the room on the right."""
    angle = np.linspace(0.0, np.pi / 2.0, 7)
    cove = np.stack([0.012 + 0.055 * (1.0 - np.cos(angle)), -0.067 + 0.055 * np.sin(angle)], -1)
    # It meets the ceiling at a slant: a vertical edge thinner than a pixel would alias to a dotted line.
    profile = np.concatenate([[[-ROOT, -0.085], [0.012, -0.085]], cove, [[0.095, ROOT]]])
    path = np.insert(np.asarray(corners, dtype=np.float64), 1, height, axis=1)
    plaster = molding(path, fillet(profile, 0.002, 2), closed=True)
    boxes = molding_boxes([*corners, corners[0]], 0.06, height - 0.085, height)
    return make_model(name, "cornice", ("Plaster", "CeilingPaint", plaster)).with_proxies(Plaster=boxes)


def ceiling(width: float, depth: float, height: float, thickness: float = 0.25) -> Model:
    """Build a ceiling slab whose lower face is at `height`."""
    slab = rounded_box((width + 0.6, thickness, depth + 0.6), 0.002).translated(0.0, height + thickness / 2.0, 0.0)
    return make_model("Ceiling", "ceiling", ("Paint", "CeilingPaint", slab))


def door(name: str, width: float = 0.90, height: float = 2.05) -> Model:
    """Build a paneled door in its casing, facing +z from the wall at z = 0."""
    leaf = [rounded_box((width - 0.008, height - 0.004, 0.020), 0.003).translated(0.0, height / 2.0, 0.006)]
    for x in (-0.195, 0.195):
        for y, tall in ((0.50, 0.62), (1.43, 0.92)):
            corners = np.array([[-1, -1], [-1, 1], [1, 1], [1, -1]]) * (0.145, tall / 2.0) + (x, y)
            path = np.concatenate([corners, np.full((4, 1), 0.016)], axis=1)[::-1]
            leaf.append(
                molding(
                    path,
                    fillet([[0.0, 0.0], [0.0, 0.010], [-0.022, 0.004], [-0.026, 0.0]], 0.002, 2),
                    up=(0.0, 0.0, 1.0),
                    closed=True,
                )
            )
    casing = [
        rounded_box((0.075, height + 0.075, 0.034), 0.006, 2).translated(
            side * (width + 0.075) / 2.0, (height + 0.075) / 2.0, 0.016
        )
        for side in (-1, 1)
    ]
    casing.append(rounded_box((width, 0.075, 0.034), 0.006, 2).translated(0.0, height + 0.0375, 0.016))
    rose = cylinder(0.026, 0.008, 0.002, 32).rotated("x", 90.0).translated(width / 2.0 - 0.07, 1.02, 0.019)
    lever = [
        sweep([[width / 2.0 - 0.07, 1.02, 0.020], [width / 2.0 - 0.07, 1.02, 0.062]], circle(0.009, 14)),
        sweep([[width / 2.0 - 0.062, 1.02, 0.062], [width / 2.0 - 0.19, 1.02, 0.062]], circle(0.0095, 14), bevel=0.004),
    ]
    return make_model(name, "door", ("Timber", "TrimPaint", [*leaf, *casing]), ("Handle", "Steel", [rose, *lever]))


def switch(name: str) -> Model:
    """Build a rocker switch on the wall at z = 0."""
    plate = rounded_box((0.082, 0.082, 0.009), 0.003, 2).translated(0.0, 0.0, 0.0045)
    rocker = rounded_box((0.044, 0.060, 0.007), 0.002, 2).rotated("x", 4.0).translated(0.0, 0.0, 0.010)
    return make_model(name, "light switch", ("Plate", "WhitePlastic", [plate, rocker]))


def rug(name: str, width: float = 3.2, depth: float = 2.3, material: str = "Rug") -> Model:
    """Build a wool rug, 11 mm thick, with a fringe at its short ends."""
    rng = np.random.default_rng(3)
    pile = rounded_box((width, 0.011, depth), 0.005, 2, (40, 1, 30), grain=0).translated(0.0, 0.0056, 0.0)
    pile = replace(pile, uv=pile.points[:, [0, 2]] * (1.0, -1.0) + (width / 2.0, depth / 2.0))
    strands = []
    for side in (-1.0, 1.0):
        for z in np.arange(-depth / 2.0 + 0.01, depth / 2.0 - 0.005, 0.0125):
            skew, length = rng.normal(0.0, 0.006), rng.uniform(0.055, 0.075)
            line = [[0.0, 0.005, z], [0.03, 0.0045, z + 0.4 * skew], [length, 0.0022, z + skew]]
            tassel = sweep(
                np.array(line) * (side, 1.0, 1.0) + (side * (width / 2.0 - 0.003), 0.0, 0.0),
                circle(0.0022, 5),
                bevel=0.0,
            )
            strands.append(tassel)
    return make_model(name, "rug", ("Pile", material, pile), ("Fringe", "Cream", strands))


def socket(name: str) -> Model:
    """Build a double socket on the wall at z = 0."""
    plate = rounded_box((0.15, 0.08, 0.009), 0.003, 2).translated(0.0, 0.0, 0.0045)
    wells = [cylinder(0.019, 0.004, 0.001, 32).rotated("x", 90.0).translated(x, 0.0, 0.0085) for x in (-0.036, 0.036)]
    return make_model(name, "socket", ("Plate", "WhitePlastic", plate), ("Wells", "GrayPlastic", wells))
