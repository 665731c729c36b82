# SPDX-License-Identifier: Apache-2.0
"""Bathtub, toilet, washbasin and their taps. Each stands on y = 0, its front at +z unless it says otherwise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from usd_scenes.author.model import Model, make_model
from usd_scenes.author.polygon_mesh import PolygonMesh, grid, merged
from usd_scenes.author.shapes import circle, curve, cylinder, fillet, lathe, rounded_box, sphere, sweep

Ring = tuple[float, float, float, float, float]
"""Half width along x, half depth along z, height, exponent of the superellipse (2 an ellipse), middle along z."""


def rings(outline: Sequence[Ring], egg: float = 0.0, segments: int = 72, smooth: int = 3) -> PolygonMesh:
    """Build a skin over superellipses stacked from the bottom on the outside; `egg` narrows them towards -z.

    smooth: how many rings a spline puts for each given one.
    """
    levels = curve(np.asarray(outline), smooth * (len(outline) - 1) + 1) if smooth > 1 else np.array(outline)
    levels[:, 2] = levels[:, 2].clip(min(ring[2] for ring in outline))  # a spline may dip below the floor
    angle = np.linspace(0.0, 2.0 * np.pi, segments + 1)
    points = np.zeros((len(levels), segments + 1, 3))
    for row, (a, b, y, n, z) in enumerate(levels):
        c, s = np.sin(angle), np.cos(angle)
        x = np.sign(c) * np.abs(c) ** (2.0 / n)
        w = np.sign(s) * np.abs(s) ** (2.0 / n)
        points[row, :, 0] = max(a, 0.0) * x * (1.0 + egg * w)
        points[row, :, 1] = y
        points[row, :, 2] = z + max(b, 0.0) * w
    points[:, -1] = points[:, 0]
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points[:, 0], axis=0), axis=1))])
    uv = np.stack(np.broadcast_arrays(angle[None] * 0.3, length[:, None]), axis=-1)
    return grid(points, uv, closed=True)


def bathtub(name: str) -> Model:
    """Build a free-standing oval tub, 1.68 × 0.76 × 0.58 m, its length along x, its waste in the middle."""
    shell = rings(
        [
            (0.0, 0.0, 0.0, 2.6, 0.0),
            (0.55, 0.24, 0.0, 2.6, 0.0),
            (0.64, 0.275, 0.0, 2.6, 0.0),
            (0.665, 0.290, 0.012, 2.6, 0.0),
            (0.725, 0.325, 0.20, 2.55, 0.0),
            (0.80, 0.358, 0.44, 2.5, 0.0),
            (0.832, 0.374, 0.562, 2.45, 0.0),
            (0.838, 0.379, 0.576, 2.45, 0.0),
            (0.830, 0.371, 0.585, 2.45, 0.0),
            (0.812, 0.354, 0.580, 2.45, 0.0),
            (0.800, 0.343, 0.560, 2.45, 0.0),
            (0.755, 0.312, 0.40, 2.5, 0.0),
            (0.680, 0.270, 0.20, 2.6, 0.0),
            (0.600, 0.225, 0.125, 2.6, 0.0),
            (0.40, 0.14, 0.105, 2.4, 0.0),
            (0.0, 0.0, 0.102, 2.2, 0.0),
        ],
        segments=96,
        smooth=4,
    )
    waste = lathe(fillet([[0.0, 0.102], [0.030, 0.104], [0.030, 0.108], [0.0, 0.110]], 0.002, 2), 28)
    overflow = cylinder(0.030, 0.012, 0.003, 28).rotated("x", 72.0).translated(0.0, 0.47, -0.325)
    return make_model(name, "bathtub", ("Tub", "Acrylic", shell), ("Waste", "Chrome", [waste, overflow]))


def toilet(name: str) -> Model:
    """Build a close-coupled toilet with its lid down, 0.37 × 0.78 × 0.66 m, its cistern's back on z = 0."""
    bowl = rings(
        [
            (0.0, 0.0, 0.0, 2.4, 0.34),
            (0.095, 0.22, 0.0, 2.6, 0.34),
            (0.108, 0.235, 0.006, 2.6, 0.34),
            (0.105, 0.225, 0.10, 2.5, 0.335),
            (0.120, 0.225, 0.20, 2.4, 0.345),
            (0.165, 0.26, 0.32, 2.3, 0.40),
            (0.181, 0.265, 0.385, 2.25, 0.435),
            (0.178, 0.262, 0.398, 2.25, 0.435),
            (0.12, 0.20, 0.398, 2.2, 0.435),
            (0.0, 0.0, 0.396, 2.2, 0.435),
        ],
        egg=-0.06,
        smooth=4,
    )
    seat = rings(_slab(0.183, 0.235, 0.402, 0.018, 0.465), egg=-0.10, smooth=1)
    lid = rings(_slab(0.180, 0.232, 0.422, 0.020, 0.465), egg=-0.10, smooth=1)
    block = rounded_box((0.22, 0.08, 0.18), 0.02, 3).translated(0.0, 0.355, 0.16)
    cistern = rounded_box((0.37, 0.36, 0.165), 0.028, 4).translated(0.0, 0.56, 0.0875)
    top = rounded_box((0.385, 0.026, 0.180), 0.010, 3).translated(0.0, 0.745, 0.092)
    hinges = [cylinder(0.012, 0.05, 0.003, 20).rotated("z", 90.0).translated(x, 0.420, 0.215) for x in (-0.075, 0.075)]
    button = [
        cylinder(0.030, 0.010, 0.002, 32).translated(0.0, 0.760, 0.095),
        cylinder(0.012, 0.013, 0.002, 24).translated(0.010, 0.761, 0.095),
    ]
    return make_model(
        name,
        "toilet",
        ("Bowl", "Ceramic", [bowl, block]),
        ("Cistern", "Ceramic", [cistern, top]),
        ("Seat", "SeatPlastic", [seat, lid]),
        ("Fittings", "Chrome", [*hinges, *button]),
    )


def _slab(a: float, b: float, y: float, thick: float, z: float) -> list[Ring]:
    """Return the rings of a lid: flat below, slightly domed above, with a round edge."""
    r = 0.4 * thick
    arc = np.linspace(-np.pi / 2.0, np.pi / 2.0, 7)
    edge = [(a - r + r * np.cos(t), b - r + r * np.cos(t), y + r + r * np.sin(t), 2.25, z) for t in arc]
    dome = [(a * s, b * s, y + thick - 0.20 * thick * s**2, 2.2, z) for s in (0.9, 0.6, 0.3, 0.0)]
    return [(0.0, 0.0, y, 2.2, z), (a * 0.7, b * 0.7, y, 2.2, z), *edge, *dome]


def vanity(name: str, width: float = 1.10, depth: float = 0.48) -> Model:
    """Build a hung oak cabinet of two drawers under a stone slab, its top at 0.82 m, its back on z = 0."""
    case = [
        rounded_box((width, 0.46, depth - 0.022), 0.003, grain=0).translated(0.0, 0.565, (depth - 0.022) / 2.0),
    ]
    front = width / 2.0
    fronts = [
        rounded_box((front - 0.006, 0.452, 0.020), 0.003, 2, grain=0)
        .with_uv(0.4 * s, 0.1 + 0.2 * s)
        .translated(s * front / 2.0, 0.565, depth - 0.012)
        for s in (-1.0, 1.0)
    ]
    grips = [
        rounded_box((0.18, 0.012, 0.020), 0.004, 2).translated(s * front / 2.0, 0.765, depth + 0.006)
        for s in (-1.0, 1.0)
    ]
    slab = rounded_box((width + 0.012, 0.025, depth + 0.010), 0.004, 3).translated(0.0, 0.8075, depth / 2.0 + 0.005)
    return make_model(
        name,
        "vanity",
        ("Case", "Oak", case),
        ("Fronts", "Oak", fronts),
        ("Grips", "Brass", grips),
        ("Top", "CounterStone", slab),
    )


def basin(name: str) -> Model:
    """Build a vessel washbasin, 0.52 × 0.38 × 0.13 m, standing on y = 0."""
    shell = rings(
        [
            (0.0, 0.0, 0.0, 2.8, 0.0),
            (0.18, 0.12, 0.0, 2.8, 0.0),
            (0.205, 0.14, 0.004, 2.8, 0.0),
            (0.235, 0.165, 0.05, 2.8, 0.0),
            (0.258, 0.186, 0.118, 2.8, 0.0),
            (0.260, 0.188, 0.127, 2.8, 0.0),
            (0.256, 0.184, 0.131, 2.8, 0.0),
            (0.250, 0.178, 0.127, 2.8, 0.0),
            (0.238, 0.167, 0.09, 2.8, 0.0),
            (0.205, 0.140, 0.035, 2.7, 0.0),
            (0.10, 0.07, 0.022, 2.4, 0.0),
            (0.0, 0.0, 0.020, 2.2, 0.0),
        ],
        smooth=4,
    )
    waste = lathe(fillet([[0.0, 0.020], [0.028, 0.022], [0.028, 0.027], [0.0, 0.029]], 0.002, 2), 28)
    return make_model(name, "washbasin", ("Basin", "Ceramic", shell), ("Waste", "Chrome", waste))


def basin_tap(name: str) -> Model:
    """Build a tall single-lever mixer; its spout reaches 0.15 m towards +z."""
    body = lathe(
        fillet([[0.0, 0.0], [0.028, 0.0], [0.028, 0.006], [0.021, 0.012], [0.021, 0.30], [0.0, 0.30]], 0.004, 3), 36
    )
    spout = sweep(
        curve([[0.0, 0.225, 0.0], [0.0, 0.245, 0.075], [0.0, 0.240, 0.135], [0.0, 0.218, 0.155]], 20),
        circle(0.0125, 18),
        up=(1.0, 0.0, 0.0),
        bevel=0.003,
    )
    head = lathe(fillet([[0.0, 0.303], [0.022, 0.303], [0.022, 0.336], [0.012, 0.342], [0.0, 0.342]], 0.004, 3), 36)
    lever = sweep([[0.0, 0.336, 0.0], [0.0, 0.352, 0.095]], circle(0.0055, 14), up=(1.0, 0.0, 0.0), bevel=0.002)
    return make_model(name, "tap", ("Chrome", "Chrome", [body, spout, head, lever]))


def bath_tap(name: str) -> Model:
    """Build a floor-standing bath filler with a hand shower in its cradle; its spout reaches 0.22 m towards +z."""
    post = sweep([[0.0, 0.0, 0.0], [0.0, 0.80, 0.0]], circle(0.016, 24), up=(0.0, 0.0, 1.0))
    foot = lathe(fillet([[0.0, 0.0], [0.050, 0.0], [0.050, 0.010], [0.018, 0.014], [0.0, 0.014]], 0.003, 3), 40)
    bar = sweep([[-0.09, 0.80, 0.0], [0.09, 0.80, 0.0]], circle(0.022, 24), up=(0.0, 0.0, 1.0), bevel=0.004)
    spout = sweep(
        curve([[0.0, 0.80, 0.0], [0.0, 0.90, 0.0], [0.0, 0.965, 0.06], [0.0, 0.955, 0.17], [0.0, 0.90, 0.215]], 32),
        circle(0.013, 18),
        up=(1.0, 0.0, 0.0),
        bevel=0.003,
    )
    wheels = [
        merged(
            [
                cylinder(0.024, 0.030, 0.005, 28).rotated("z", 90.0).translated(s * 0.115, 0.80, 0.0),
                sweep([[s * 0.118, 0.80, 0.0], [s * 0.118, 0.862, 0.0]], circle(0.005, 12), up=(0.0, 0.0, 1.0)),
            ]
        )
        for s in (-1.0, 1.0)
    ]
    handset = [
        sweep([[0.06, 0.83, 0.03], [0.06, 1.02, 0.05]], circle(0.011, 16), up=(0.0, 0.0, 1.0), bevel=0.003),
        cylinder(0.030, 0.020, 0.005, 32).rotated("x", 62.0).translated(0.06, 1.035, 0.062),
    ]
    hose = sweep(
        curve(
            [
                [0.06, 0.83, 0.03],
                [0.075, 0.60, 0.05],
                [0.10, 0.30, 0.04],
                [0.06, 0.24, 0.02],
                [0.02, 0.45, 0.02],
                [0.0, 0.78, 0.012],
            ],
            60,
        ),
        circle(0.0055, 10),
        up=(0.0, 0.0, 1.0),
        bevel=0.0,
    )
    return make_model(name, "tap", ("Chrome", "Chrome", [post, foot, bar, spout, *wheels, *handset, hose]))


def towel_radiator(name: str, width: float = 0.50, height: float = 1.10) -> Model:
    """Build a chrome ladder on the wall at z = 0, its foot at y = 0; `radiator_bars` has the heights of its bars."""
    posts = [
        sweep([[x, 0.0, 0.055], [x, height, 0.055]], circle(0.013, 18), up=(0.0, 0.0, 1.0))
        for x in (-width / 2.0, width / 2.0)
    ]
    bars = [
        sweep([[-width / 2.0, y, 0.066], [width / 2.0, y, 0.066]], circle(0.0105, 16), up=(0.0, 0.0, 1.0))
        for y in radiator_bars(height)
    ]
    brackets = [
        sweep([[x, y, 0.0], [x, y, 0.055]], circle(0.009, 14))
        for x in (-width / 2.0, width / 2.0)
        for y in (0.14, height - 0.14)
    ]
    return make_model(name, "towel radiator", ("Chrome", "Chrome", [*posts, *bars, *brackets]))


def radiator_bars(height: float = 1.10) -> list[float]:
    """Return the heights of a towel radiator's bars, in three groups, m."""
    third = height / 3.0
    return [0.05 + group * third + step * 0.062 for group in range(3) for step in range(5)]


def wall_lamp(name: str) -> Model:
    """Build an opal globe, 0.14 m, on a brass arm from the wall at z = 0; the globe's middle is at z = 0.11."""
    plate = cylinder(0.042, 0.012, 0.003, 36).rotated("x", 90.0).translated(0.0, -0.09, 0.006)
    arm = sweep(
        curve([[0.0, -0.09, 0.01], [0.0, -0.092, 0.07], [0.0, -0.088, 0.105], [0.0, -0.06, 0.11]], 16),
        circle(0.007, 14),
        up=(1.0, 0.0, 0.0),
    )
    cup = cylinder(0.026, 0.018, 0.004, 28).translated(0.0, -0.062, 0.11)
    return make_model(
        name,
        "wall lamp",
        ("Globe", "OpalGlobe", sphere(0.066, 40).translated(0.0, 0.0, 0.11)),
        ("Arm", "Brass", [plate, arm, cup]),
    )
