# SPDX-License-Identifier: Apache-2.0
"""Fitted kitchen: cabinets with framed doors, worktops, extractor hood, shelves, table.

A run of cabinets extends from x = 0 along +x; its back is on z = 0 and its doors face +z.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from usd_scenes.author.model import Model, make_model
from usd_scenes.author.polygon_mesh import PolygonMesh, grid, merged
from usd_scenes.author.shapes import circle, curve, cylinder, fillet, lathe, rectangle, rounded_box, sphere, sweep

DEPTH, TOP, SLAB = 0.58, 0.90, 0.030  # m: depth of a cabinet, height and thickness of the worktop
PLINTH = 0.10


def framed_door(width: float, height: float) -> PolygonMesh:
    """Build a door of a frame about a recessed panel, its lower left corner at the origin, its back on z = 0."""
    border, thick = min(0.062, 0.36 * height, 0.36 * width), 0.020
    panel = rounded_box((width - 1.6 * border, height - 1.6 * border, 0.010), 0.001).translated(0.0, 0.0, 0.006)
    side = rounded_box((border, height, thick), 0.0025, 2).translated(0.0, 0.0, thick / 2.0)
    rail = rounded_box((width - 2.0 * border + 0.001, border, thick), 0.0025, 2).translated(0.0, 0.0, thick / 2.0)
    parts = [panel, *(side.translated(x * (width - border) / 2.0) for x in (-1.0, 1.0))]
    parts += [rail.translated(0.0, y * (height - border) / 2.0) for y in (-1.0, 1.0)]
    return merged(parts).translated(width / 2.0, height / 2.0)


def knob(x: float, y: float, z: float) -> PolygonMesh:
    """Build a turned knob that stands out from z."""
    profile = curve([[0.007, 0.0], [0.006, 0.010], [0.014, 0.018], [0.0155, 0.024], [0.010, 0.030], [0.0, 0.031]], 18)
    return lathe(profile, 28).rotated("x", 90.0).translated(x, y, z)


def base_units(name: str, units: Sequence[tuple[float, str]], paint: str = "CabinetGreen") -> Model:
    """Build base cabinets.

    Args:
        name: prim name.
        units: width, m, and kind of each from the left: "doors", "door", "drawers", "sink" or "gap".
        paint: material of cases and doors.
    """
    cases, fronts, knobs, plinths = [], [], [], []
    x, top, gap = 0.0, TOP - SLAB, 0.002
    for width, kind in units:
        if kind == "gap":
            x += width
            continue
        ceiling = top - 0.235 if kind == "sink" else top
        cases.append(
            rounded_box((width, ceiling - PLINTH, DEPTH - 0.022), 0.001).translated(
                x + width / 2.0, (ceiling + PLINTH) / 2.0, (DEPTH - 0.022) / 2.0
            )
        )
        plinths.append(
            rounded_box((width, PLINTH, 0.018), 0.002).translated(x + width / 2.0, PLINTH / 2.0, DEPTH - 0.075)
        )
        z, low = DEPTH - 0.022, PLINTH + 0.004
        if kind == "drawers":
            heights = np.array([0.30, 0.27, 0.19]) / 0.76 * (ceiling - low - 0.004)
            for height in heights.tolist():
                fronts.append(framed_door(width - 2.0 * gap, height - gap).translated(x + gap, low, z))
                knobs += [knob(x + width * at, low + 0.5 * height, z + 0.020) for at in (0.30, 0.70)]
                low += height
        else:
            count = 1 if kind == "door" else 2
            each, height = width / count, ceiling - low - 0.004
            for index in range(count):
                fronts.append(framed_door(each - 2.0 * gap, height).translated(x + index * each + gap, low, z))
                edge = 0.035 if index == count - 1 and count > 1 else each - 0.035
                knobs.append(knob(x + index * each + edge, low + height - 0.055, z + 0.020))
        x += width
    return make_model(
        name,
        "kitchen cabinet",
        ("Cases", paint, cases),
        ("Fronts", paint, fronts),
        ("Knobs", "Brass", knobs),
        ("Plinth", paint, plinths),
    )


def worktop(name: str, pieces: Sequence[tuple[float, float, float, float]], material: str = "Marble") -> Model:
    """Build slabs whose upper face is at `TOP`, each over x0 to x1 and z0 to z1, m."""
    slabs = []
    for index, (x0, x1, z0, z1) in enumerate(pieces):
        slab = rounded_box((x1 - x0, SLAB, z1 - z0), 0.004, 3).with_uv(0.37 * index, 0.21 * index)
        slabs.append(slab.translated((x0 + x1) / 2.0, TOP - SLAB / 2.0, (z0 + z1) / 2.0))
    return make_model(name, "worktop", ("Slabs", material, slabs))


def shelf(name: str, width: float, depth: float = 0.22) -> Model:
    """Build an oak shelf on two black brackets about x = 0, its upper face on y = 0, its back on z = 0."""
    board = rounded_box((width, 0.028, depth), 0.004, 2).translated(0.0, -0.014, depth / 2.0)
    brackets = []
    for x in (-width / 2.0 + 0.14, width / 2.0 - 0.14):
        brackets.append(rounded_box((0.022, 0.16, 0.005), 0.0015).translated(x, -0.105, 0.0027))
        brackets.append(rounded_box((0.022, 0.005, depth - 0.03), 0.0015).translated(x, -0.031, (depth - 0.03) / 2.0))
        brace = curve([[x, -0.165, 0.006], [x, -0.12, 0.08], [x, -0.036, depth - 0.05]], 12)
        brackets.append(sweep(brace, rectangle(0.010, 0.005, 0.001), up=(1.0, 0.0, 0.0)))
    return make_model(name, "shelf", ("Board", "Oak", board), ("Brackets", "BlackMetal", brackets))


def hood(name: str, height: float) -> Model:
    """Build an extractor hood, 0.60 m wide, its lower edge on y = 0, its chimney up to `height`; its back on z = 0."""
    levels = [
        (0.30, 0.50, 0.0),
        (0.30, 0.50, 0.055),
        (0.296, 0.494, 0.060),
        (0.125, 0.26, 0.225),
        (0.120, 0.255, height),
    ]
    rings = np.array([[[-w, y, 0.0], [w, y, 0.0], [w, y, d], [-w, y, d], [-w, y, 0.0]] for w, d, y in levels])
    skins = []
    for a, b in itertools.pairwise(rings):
        for i in (1, 2, 3):  # right side, front, left side
            quad = np.stack([a[[i + 1, i]], b[[i + 1, i]]])[:, ::-1]
            side = np.linalg.norm(quad[0, 1] - quad[0, 0])
            rise = np.linalg.norm(quad[1, 0] - quad[0, 0])
            skins.append(grid(quad[:, ::-1], np.array([[[0.0, 0.0], [side, 0.0]], [[0.0, rise], [side, rise]]])))
    under = rounded_box((0.596, 0.012, 0.496), 0.003).translated(0.0, 0.010, 0.249)
    filters = [rounded_box((0.25, 0.004, 0.36), 0.001).translated(x, 0.003, 0.25) for x in (-0.135, 0.135)]
    keys = [
        cylinder(0.006, 0.004, 0.001, 16).rotated("x", 90.0).translated(x, 0.028, 0.501) for x in (0.12, 0.15, 0.18)
    ]
    lip = sweep([[-0.301, 0.0, 0.502], [0.301, 0.0, 0.502]], rectangle(0.006, 0.006, 0.002))
    return make_model(
        name,
        "extractor hood",
        ("Canopy", "BrushedSteel", [*skins, under, lip]),
        ("Filters", "Aluminium", filters),
        ("Keys", "BlackPlastic", keys),
    )


def round_table(name: str, radius: float = 0.45, height: float = 0.75) -> Model:
    """Build a round oak table on a white turned foot."""
    h = height
    outline = [
        [0.0, h - 0.028],
        [radius - 0.012, h - 0.028],
        [radius, h - 0.018],
        [radius, h - 0.006],
        [radius - 0.006, h],
        [0.0, h],
    ]
    top = lathe(fillet(outline, 0.004, 3), 96)
    top = PolygonMesh(top.points, top.normals, top.points[:, [0, 2]] + (0.5, 0.4), top.counts, top.indices)
    stem = curve([[0.055, 0.05], [0.040, 0.13], [0.048, 0.24], [0.034, 0.40], [0.044, 0.56], [0.10, h - 0.028]], 36)
    foot = lathe(
        fillet([[0.0, 0.0], [0.24, 0.0], [0.245, 0.020], [0.12, 0.050], [0.05, 0.075], [0.0, 0.075]], 0.008, 4), 64
    )
    return make_model(name, "table", ("Top", "Oak", top), ("Foot", "TrimPaint", [lathe(stem, 44), foot]))


def wall_clock(name: str, radius: float = 0.15) -> Model:
    """Build a round clock that shows ten past ten, facing +z from the wall at z = 0."""
    rim = sweep(
        np.insert(circle(radius, 72), 2, 0.020, axis=1), rectangle(0.014, 0.040, 0.005), up=(0.0, 0.0, 1.0), closed=True
    )
    face = lathe([[radius, 0.0], [0.0, 0.0]], 72).rotated("x", 90.0).translated(0.0, 0.0, 0.022)
    marks = []
    for hour in range(12):
        long = 0.026 if hour % 3 == 0 else 0.014
        mark = rounded_box((0.0055, long, 0.0015), 0.0004).translated(0.0, 0.84 * radius - long / 2.0, 0.0228)
        marks.append(mark.rotated("z", 30.0 * hour))
    for length, width, turn in ((0.50, 0.008, 55.0), (0.74, 0.005, -60.0)):
        hand = rounded_box((width, length * radius + 0.02, 0.0015), 0.0005).translated(
            0.0, length * radius / 2.0, 0.026
        )
        marks.append(hand.rotated("z", turn))
    marks.append(sphere(0.008, 16).scaled(1.0, 1.0, 0.5).translated(0.0, 0.0, 0.026))
    back = cylinder(radius - 0.004, 0.016, 0.002, 64).rotated("x", 90.0).translated(0.0, 0.0, 0.010)
    return make_model(
        name, "clock", ("Rim", "BlackMetal", [rim, back]), ("Face", "Porcelain", face), ("Marks", "BlackPlastic", marks)
    )
