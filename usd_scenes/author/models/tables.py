# SPDX-License-Identifier: Apache-2.0
"""Tables, shelves, television, lamps, mirror, basket."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from usd_scenes.author.model import Model, make_model
from usd_scenes.author.polygon_mesh import PolygonMesh, merged
from usd_scenes.author.shapes import (
    circle,
    curve,
    cylinder,
    fillet,
    four_legs,
    lathe,
    rectangle,
    rounded_box,
    sphere,
    sweep,
)


def coffee_table(name: str) -> Model:
    """Build an oval walnut table, 1.20 × 0.68 × 0.40 m, with a shelf below, on splayed legs."""
    top = _oval_slab(1.20, 0.68, 0.026).translated(0.0, 0.387, 0.0)
    shelf = _oval_slab(0.86, 0.42, 0.016).translated(0.0, 0.155, 0.0)
    legs = four_legs((0.36, 0.376, 0.17), (0.46, 0.0, 0.25), circle(0.021, 16), 0.6)
    return make_model(
        name, "coffee table", ("Top", "Walnut", top), ("Shelf", "Walnut", shelf), ("Legs", "Walnut", legs)
    )


def _oval_slab(width: float, depth: float, height: float) -> PolygonMesh:
    """Build a tabletop in the shape of a superellipse with a rounded edge, grain along x."""
    h, r = height / 2.0, height * 0.42
    slab = lathe(
        fillet([[0.0, -h], [1.0 - r, -h], [1.0, -h + r], [1.0, h - r * 0.5], [1.0 - r * 0.5, h], [0.0, h]], r * 0.4, 2),
        72,
    )

    def stretch(points: np.ndarray) -> np.ndarray:
        angle = np.arctan2(points[:, 2], points[:, 0])
        radius = np.hypot(points[:, 0], points[:, 2])
        reach = (np.abs(np.cos(angle)) ** 2.5 + np.abs(np.sin(angle)) ** 2.5) ** (-1.0 / 2.5)
        inset = (1.0 - radius) * (radius > 0.5)
        bent = points.copy()
        bent[:, 0] = np.cos(angle) * reach * (width / 2.0 - inset) * np.where(radius > 0.5, 1.0, 0.0)
        bent[:, 2] = np.sin(angle) * reach * (depth / 2.0 - inset) * np.where(radius > 0.5, 1.0, 0.0)
        return bent

    bent = slab.deformed(stretch)
    return PolygonMesh(bent.points, bent.normals, bent.points[:, [0, 2]] * 1.0, bent.counts, bent.indices)


def dining_table(name: str) -> Model:
    """Build an oak table, 1.80 × 0.90 × 0.75 m: three boards on a black steel frame."""
    boards = [
        rounded_box((1.80, 0.032, 0.2985), 0.003, 2).with_uv(0.37 * i, 0.26 * i).translated(0.0, 0.734, (i - 1) * 0.30)
        for i in range(3)
    ]
    frame: list[PolygonMesh] = []
    for x in (-0.72, 0.72):
        loop = [[x, 0.0125, -0.36], [x, 0.0125, 0.36]], [[x, 0.7055, -0.36], [x, 0.7055, 0.36]]
        frame += [sweep(line, rectangle(0.06, 0.025, 0.004)) for line in loop]
        frame += [
            sweep([[x, 0.02, z], [x, 0.70, z]], rectangle(0.06, 0.025, 0.004), up=(0.0, 0.0, 1.0))
            for z in (-0.3475, 0.3475)
        ]
    frame.append(sweep([[-0.72, 0.69, 0.0], [0.72, 0.69, 0.0]], rectangle(0.05, 0.025, 0.004)))
    return make_model(name, "dining table", ("Top", "Oak", boards), ("Frame", "BlackMetal", frame))


def bookcase(name: str, width: float = 1.20, height: float = 2.10, depth: float = 0.30) -> Model:
    """Build an open oak bookcase with five shelves and a back."""
    sides = [
        rounded_box((0.024, height, depth), 0.002)
        .with_uv(0.3 * s, 0.1)
        .translated(s * (width / 2.0 - 0.012), height / 2.0, 0.0)
        for s in (-1, 1)
    ]
    shelves = [
        rounded_box((width - 0.05, 0.024, depth - 0.012), 0.002).with_uv(0.21 * i, 0.3 * i).translated(0.0, y, 0.004)
        for i, y in enumerate(shelf_heights(height))
    ]
    back = rounded_box((width - 0.04, height - 0.08, 0.008), 0.001).translated(
        0.0, height / 2.0 + 0.02, -depth / 2.0 + 0.006
    )
    plinth = rounded_box((width - 0.05, 0.06, 0.02), 0.002).translated(0.0, 0.03, depth / 2.0 - 0.03)
    return make_model(name, "bookcase", ("Case", "Oak", [*sides, *shelves, plinth]), ("Panel", "Oak", back))


def shelf_heights(height: float = 2.10) -> list[float]:
    """Return the center heights of a bookcase's boards, m; books stand 0.012 m above."""
    return [0.072 + i * (height - 0.084) / 5.0 for i in range(6)]


def sideboard(name: str, width: float = 1.80) -> Model:
    """Build a low walnut cabinet with three fronts on black legs, for the television."""
    case = [
        rounded_box((width, 0.022, 0.42), 0.003).translated(0.0, 0.489, 0.0),
        rounded_box((width - 0.002, 0.022, 0.418), 0.003).translated(0.0, 0.171, 0.0),
        rounded_box((0.022, 0.34, 0.418), 0.003).translated(-width / 2.0 + 0.011, 0.33, 0.0),
        rounded_box((0.022, 0.34, 0.418), 0.003).translated(width / 2.0 - 0.011, 0.33, 0.0),
        rounded_box((width - 0.04, 0.30, 0.01), 0.002).translated(0.0, 0.33, -0.19),
    ]
    front = (width - 0.05) / 3.0
    fronts = [
        rounded_box((front - 0.004, 0.288, 0.020), 0.002).with_uv(0.6 * i, 0.0).translated((i - 1) * front, 0.33, 0.196)
        for i in range(3)
    ]
    knobs = [sphere(0.012, 16).scaled(1.0, 1.0, 0.8).translated((i - 1) * front, 0.43, 0.213) for i in range(3)]
    legs = [
        cylinder(0.014, 0.16, 0.002, 16).translated(x * (width / 2 - 0.12), 0.08, z * 0.15)
        for x in (-1, 1)
        for z in (-1, 1)
    ]
    return make_model(
        name,
        "sideboard",
        ("Case", "Walnut", case),
        ("Fronts", "Walnut", fronts),
        ("Knobs", "Brass", knobs),
        ("Legs", "BlackMetal", legs),
    )


def television(name: str) -> Model:
    """Build a 55-inch television on two feet."""
    body = rounded_box((1.235, 0.715, 0.028), 0.006, 2).translated(0.0, 0.44, 0.0)
    screen = rounded_box((1.215, 0.690, 0.004), 0.001).translated(0.0, 0.445, 0.0135)
    feet = [sweep([[x, 0.004, -0.12], [x, 0.004, 0.12]], rectangle(0.022, 0.008, 0.002)) for x in (-0.42, 0.42)]
    feet += [
        sweep([[x, 0.0, 0.0], [x, 0.1, 0.0]], rectangle(0.02, 0.018, 0.002), up=(0.0, 0.0, 1.0)) for x in (-0.42, 0.42)
    ]
    return make_model(name, "television", ("Body", "BlackPlastic", [body, *feet]), ("Screen", "ScreenOff", screen))


def floor_lamp(name: str) -> Model:
    """Build a brass floor lamp, 1.58 m, with a linen drum shade and its plug 0.45 m behind; the room has the bulb."""
    base = lathe(
        fillet([[0.0, 0.0], [0.14, 0.0], [0.14, 0.018], [0.03, 0.026], [0.012, 0.05], [0.0, 0.05]], 0.004, 3), 48
    )
    stem = sweep([[0.0, 0.03, 0.0], [0.0, 1.42, 0.0]], circle(0.009, 16), up=(0.0, 0.0, 1.0))
    spider = [
        sweep(
            [[0.0, 1.42, 0.0], [0.185 * np.sin(a), 1.53, 0.185 * np.cos(a)]],
            circle(0.003, 8),
            up=(0.3, 0.0, 1.0),
            bevel=0.001,
        )
        for a in np.arange(3) * 2.0 * np.pi / 3.0
    ]
    ground = [[0.0, 0.008, -0.13], [-0.05, 0.006, -0.21], [0.03, 0.006, -0.32]]
    rising = [[0.09, 0.006, -0.41], [0.10, 0.05, -0.428], [0.10, 0.30, -0.43], [0.10, 0.305, -0.445]]
    cord = sweep(curve(ground + rising, 40), circle(0.004, 8), up=(1.0, 0.0, 0.0))
    return make_model(
        name,
        "floor lamp",
        ("Stand", "Brass", [base, stem, *spider]),
        ("Shade", "LampShade", drum_shade(0.205, 0.235, 0.27).translated(0.0, 1.31, 0.0)),
        ("Cord", "BlackPlastic", cord),
    )


def drum_shade(top: float, bottom: float, height: float) -> PolygonMesh:
    """Build a shade of cloth on a wire at either rim, open above and below, 3 mm thick."""
    wall = [[bottom - 0.003, 0.0], [bottom, 0.0], [top, height], [top - 0.003, height], [bottom - 0.003, 0.0]]
    rims = [lathe(circle(0.004, 8)[[*range(8), 0]] + (r - 0.0015, y), 64) for r, y in ((bottom, 0.0), (top, height))]
    return merged([lathe(wall[1:3], 64), lathe([wall[3], wall[4]], 64), *rims])


def pendant(name: str, drop: float) -> Model:
    """Build a black metal dome on a cord: the ceiling is at y = 0, the rim at -drop."""
    outer = curve([[0.026, 0.20], [0.10, 0.185], [0.18, 0.12], [0.225, 0.0]], 16)[::-1]
    shell = lathe(np.concatenate([outer, outer[::-1] - (0.004, 0.003)]), 56)
    cap = lathe(fillet([[0.0, 0.195], [0.03, 0.195], [0.03, 0.25], [0.008, 0.26], [0.0, 0.26]], 0.006, 3), 32)
    cord = sweep([[0.0, 0.25 - drop, 0.0], [0.0, -0.02, 0.0]], circle(0.003, 8), up=(0.0, 0.0, 1.0), bevel=0.001)
    rose = lathe(fillet([[0.0, -0.03], [0.045, -0.03], [0.05, 0.0], [0.0, 0.0]], 0.006, 3), 40)
    return make_model(
        name,
        "ceiling lamp",
        ("Shade", "BlackMetal", [shell.translated(0.0, -drop), cap.translated(0.0, -drop), cord, rose]),
    )


def side_table(name: str) -> Model:
    """Build a round table, 0.45 m across and 0.50 m high, on a turned foot."""
    outline = [[0.0, 0.480], [0.210, 0.480], [0.225, 0.488], [0.225, 0.498], [0.215, 0.505], [0.0, 0.505]]
    stem = curve([[0.030, 0.02], [0.022, 0.10], [0.016, 0.26], [0.020, 0.40], [0.045, 0.478]], 24)
    foot = fillet([[0.0, 0.0], [0.150, 0.0], [0.150, 0.014], [0.034, 0.026], [0.0, 0.026]], 0.005, 3)
    top = lathe(fillet(outline, 0.003, 2), 64)
    top = replace(top, uv=top.points[:, [0, 2]] + (0.4, 0.3))
    return make_model(
        name, "side table", ("Top", "Oak", top), ("Foot", "BlackMetal", [lathe(stem, 32), lathe(foot, 48)])
    )


def mirror(name: str, radius: float = 0.38) -> Model:
    """Build a round mirror in a brass rim, facing +z from the wall at z = 0."""
    ring = np.insert(circle(radius + 0.004, 96), 2, 0.012, axis=1)
    rim = sweep(ring, rectangle(0.014, 0.024, 0.004), up=(0.0, 0.0, 1.0), closed=True)
    glass = lathe([[radius, 0.0], [0.0, 0.0]], 96).rotated("x", 90.0).translated(0.0, 0.0, 0.014)
    return make_model(name, "mirror", ("Rim", "Brass", rim), ("Glass", "MirrorSilver", glass))


def basket(name: str) -> Model:
    """Build a basket of coiled rope, 0.42 m across."""
    coils = []
    for level in range(15):
        t = level / 14.0
        radius = 0.185 + 0.028 * np.sin(np.pi * (0.15 + 0.75 * t))
        ring = np.insert(circle(radius, 48), 1, 0.012 + 0.0212 * level, axis=1)
        coils.append(sweep(ring, circle(0.0125, 9), closed=True))
    floor = cylinder(0.18, 0.014, 0.004, 40).translated(0.0, 0.009, 0.0)
    return make_model(name, "basket", ("Rope", "Cream", [*coils, floor]))
