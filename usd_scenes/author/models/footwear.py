# SPDX-License-Identifier: Apache-2.0
"""Shoes and rubber boots in pairs, as smooth implicit surfaces. They stand on y = 0, their toes towards +z."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from usd_scenes.author.implicit import Field, ellipsoid, limb, surface, union
from usd_scenes.author.model import Model, make_model
from usd_scenes.author.polygon_mesh import Array, PolygonMesh, merged
from usd_scenes.author.shapes import circle, curve, sweep
from usd_scenes.author.sheets import plate


def _above(field: Field, level: float, blend: float = 0.006) -> Field:
    """Return the part of a field above a height, its edge rounded over `blend` m."""

    def distance(points: Array) -> Array:
        a, b = field(points), level - points[:, 1]
        return np.asarray(np.maximum(a, b) + np.maximum(blend - np.abs(a - b), 0.0) ** 2 / (4.0 * blend))

    return distance


def _without(field: Field, hole: Field, blend: float = 0.004) -> Field:
    """Return a field minus another, with round edges."""

    def distance(points: Array) -> Array:
        a, b = field(points), -hole(points)
        return np.asarray(np.maximum(a, b) + np.maximum(blend - np.abs(a - b), 0.0) ** 2 / (4.0 * blend))

    return distance


def _sole(length: float, grow: float, inward: float) -> Array:
    """Return the outline of a left sole, (x, z), counter-clockwise; `inward` bends the toes towards +x."""
    half = length / 2.0
    right = [
        (0.000, -half),
        (0.026, -half + 0.010),
        (0.033, -0.095),
        (0.029, -0.030),
        (0.041, 0.045),
        (0.043, 0.090),
        (0.024, half - 0.012),
    ]
    left = [
        (0.000, half),
        (-0.026, half - 0.014),
        (-0.042, 0.080),
        (-0.043, 0.030),
        (-0.033, -0.040),
        (-0.033, -0.100),
        (-0.024, -half + 0.012),
    ]
    line = curve(np.array(right + left), 72, closed=True)
    line[:, 0] += inward * np.clip(line[:, 1] / half, 0.0, 1.0) ** 2
    middle = line.mean(axis=0)
    size = np.linalg.norm(line - middle, axis=1, keepdims=True)
    return np.asarray((line + (line - middle) / size * grow) * (1.0, -1.0))[::-1]


def _pair(
    make: Callable[[], dict[str, PolygonMesh]], apart: float, turns: tuple[float, float], shift: float
) -> dict[str, list[PolygonMesh]]:
    """Return the parts of a left object and its mirror image side by side."""
    parts: dict[str, list[PolygonMesh]] = {}
    for name, mesh in make().items():
        right = mesh.scaled(-1.0, 1.0, 1.0)
        parts[name] = [
            mesh.rotated("y", turns[0]).translated(-apart / 2.0, 0.0, 0.0),
            right.rotated("y", turns[1]).translated(apart / 2.0, 0.0, shift),
        ]
    return parts


def _sneaker() -> dict[str, PolygonMesh]:
    body = union(
        [
            ellipsoid((0.003, 0.048, 0.080), (0.044, 0.040, 0.066)),
            limb((0.001, 0.046, 0.060), (0.0, 0.062, -0.050), 0.040, 0.036),
            ellipsoid((0.0, 0.066, -0.085), (0.036, 0.062, 0.052)),
            limb((0.0, 0.080, -0.028), (0.0, 0.100, -0.080), 0.032, 0.033),
        ],
        0.030,
    )
    opening = union(
        [
            limb((0.0, 0.125, -0.080), (0.0, 0.090, -0.074), 0.030, 0.026),
            limb((0.0, 0.130, -0.052), (0.0, 0.098, -0.040), 0.022, 0.015),
        ],
        0.02,
    )
    upper = surface(_above(_without(body, opening), 0.020), (-0.06, 0.0, -0.16), (0.06, 0.16, 0.16), 0.0074)
    sole = plate(_sole(0.290, 0.003, 0.006), 0.026, 0.006, 4)
    cap = _above(ellipsoid((0.003, 0.034, 0.096), (0.0445, 0.029, 0.0525)), 0.022)
    toe = surface(lambda p: np.maximum(cap(p), 0.108 - p[:, 2]), (-0.06, 0.0, 0.09), (0.06, 0.09, 0.16), 0.0074)
    laces = []
    for index in range(5):
        z = 0.052 - 0.021 * index
        y = 0.0865 + 0.0072 * index + 0.0004 * index**2
        line = curve(
            [
                [-0.026, y - 0.010, z],
                [-0.012, y + 0.003, z - 0.002],
                [0.012, y + 0.003, z + 0.002],
                [0.026, y - 0.010, z],
            ],
            16,
        )
        laces.append(sweep(line, circle(0.0028, 8) * (1.5, 0.7), up=(0.0, 1.0, 0.0), bevel=0.001))
    return {"Upper": upper, "Sole": merged([sole, toe]), "Laces": merged(laces)}


def shoes(name: str) -> Model:
    """Build a pair of canvas sneakers, 0.29 m long."""
    parts = _pair(_sneaker, 0.125, (4.0, -9.0), -0.012)
    return make_model(
        name,
        "shoes",
        ("Uppers", "CanvasRed", parts["Upper"]),
        ("Soles", "WhitePlastic", parts["Sole"]),
        ("Laces", "Tissue", parts["Laces"]),
    )


def _wellington() -> dict[str, PolygonMesh]:
    body = union(
        [
            ellipsoid((0.003, 0.052, 0.075), (0.046, 0.042, 0.068)),
            limb((0.001, 0.052, 0.060), (0.0, 0.080, -0.045), 0.043, 0.046),
            ellipsoid((0.0, 0.060, -0.075), (0.041, 0.056, 0.052)),
            limb((0.0, 0.10, -0.062), (0.0, 0.345, -0.058), 0.048, 0.068),
        ],
        0.035,
    )
    hole = limb((0.0, 0.20, -0.060), (0.0, 0.46, -0.058), 0.035, 0.063)

    def cut(points: Array) -> Array:
        """Cut the shaft level at its top."""
        return np.asarray(np.maximum(body(points), points[:, 1] - 0.335))

    upper = surface(_above(_without(cut, hole, 0.003), 0.022), (-0.09, 0.0, -0.16), (0.09, 0.36, 0.16), 0.0100)
    ring = np.insert(circle(0.0665, 56), 1, 0.333, axis=1) + np.array([0.0, 0.0, -0.058])
    band = sweep(ring, circle(0.0042, 10), closed=True)
    sole = plate(_sole(0.296, 0.007, 0.006), 0.024, 0.004, 3)
    return {"Shaft": upper, "Band": band, "Sole": sole}


def boots(name: str) -> Model:
    """Build a pair of rubber boots, 0.34 m high."""
    parts = _pair(_wellington, 0.155, (6.0, -5.0), 0.010)
    return make_model(
        name,
        "boots",
        ("Shafts", "RubberGreen", parts["Shaft"]),
        ("Bands", "RubberBlack", parts["Band"]),
        ("Soles", "RubberBlack", parts["Sole"]),
    )
