# SPDX-License-Identifier: Apache-2.0
"""Small bathroom objects: towel, toilet paper, soap, plunger."""

from __future__ import annotations

import numpy as np

from usd_scenes.author.implicit import surface
from usd_scenes.author.model import Model, make_model
from usd_scenes.author.polygon_mesh import Array, PolygonMesh, grid, merged
from usd_scenes.author.shapes import circle, curve, fillet, lathe, rounded_box, sweep
from usd_scenes.author.soft import cloth_back, wrinkles


def towel(name: str) -> Model:
    """Build a bath towel folded to 0.32 × 0.22 m, its folds to the front, with a woven border."""
    thick = 0.0140
    path = np.add(_folded(6, 0.0165, 0.096), (0.0, thick / 2.0))
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], -1)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    outline = np.concatenate([path + normal * thick / 2.0, path[::-1] - normal[::-1] * thick / 2.0])
    length = np.concatenate([along, along[::-1] + 2.0 * along[-1]])
    outline, length = np.concatenate([outline, outline[:1]]), np.append(length, length[-1] + thick)
    x = np.concatenate([[-0.160, -0.1585], np.linspace(-0.154, 0.154, 29), [0.1585, 0.160]])
    pinch = np.ones(len(x))
    pinch[[0, -1]], pinch[[1, -2]] = 0.35, 0.8
    middle = np.concatenate([path, path[::-1], path[:1]])
    rings = middle[None] + (outline - middle)[None] * pinch[:, None, None]
    points = np.concatenate([np.broadcast_to(x[:, None, None], (*rings.shape[:2], 1)), rings[..., ::-1]], axis=-1)
    uv = np.stack(np.broadcast_arrays(x[:, None], length[None]), axis=-1)
    cloth = grid(points, uv, closed=True)
    caps = []
    for row, sign in ((0, -1.0), (-1, 1.0)):
        count = len(path)
        strip = np.stack([points[row, :count], points[row, count : 2 * count][::-1]])
        caps.append(grid(strip if sign > 0 else strip[::-1], strip[..., [2, 1]]))
    whole = merged([cloth, *caps])

    def settle(points: Array) -> Array:
        q = points / (0.16, 0.1, 0.11)
        bent = points.copy()
        height = points[:, 1] / 0.10
        bent[:, 1] += height * (
            0.0020 * wrinkles(points * (1.0, 0.3, 1.0), 3, 0.26, 2)
            - 0.007 * np.abs(q[:, 0]) ** 4
            - 0.004 * np.abs(q[:, 2]) ** 4
        )
        bent[:, 2] += 0.0025 * wrinkles(points * (1.0, 3.0, 0.2), 4, 0.26, 1)
        bent[:, 0] += 0.0025 * np.sin(points[:, 1] * 300.0 + 1.0) + 0.0015 * wrinkles(
            points * (0.2, 3.0, 1.0), 5, 0.15, 2
        )
        return bent

    whole = whole.deformed(settle)
    border = [_border(whole, z, width) for z, width in ((0.036, 0.020), (0.062, 0.005), (0.010, 0.005))]
    return make_model(name, "towel", ("Cloth", "TowelBlue", whole), ("Border", "TowelBand", border))


def _folded(layers: int, pitch: float, reach: float) -> Array:
    """Return the profile (depth, height) of cloth folded back and forth, its layers `pitch` apart, m."""
    layer, turn = np.linspace(-reach, reach, 12), np.linspace(-np.pi / 2.0, np.pi / 2.0, 7)[1:-1]
    pieces = []
    for index in range(layers):
        forth = 1.0 if index % 2 == 0 else -1.0
        pieces.append(np.stack([forth * layer, np.full(12, pitch * index)], axis=-1))
        if index < layers - 1:
            bend = [forth * (reach + 0.55 * pitch * np.cos(turn)), pitch * (index + 0.5 * (1.0 + np.sin(turn)))]
            pieces.append(np.stack(bend, axis=-1))
    return np.concatenate(pieces)


def _border(cloth: PolygonMesh, z: float, width: float) -> PolygonMesh:
    """Build a woven band across the towel's upper layer, 1 mm above it."""
    x = np.linspace(-0.1575, 0.1575, 33)
    zs = np.linspace(z - width / 2.0, z + width / 2.0, 4)
    upper = cloth.points[cloth.normals[:, 1] > 0.8]
    points = np.zeros((4, 33, 3))
    for i, depth in enumerate(zs[::-1]):
        for j, along in enumerate(x):
            near = np.argsort((upper[:, 0] - along) ** 2 + (upper[:, 2] - depth) ** 2 - 0.02 * upper[:, 1])[:4]
            points[i, j] = along, upper[near, 1].mean() + 0.0012, depth
    return grid(points, points[..., [0, 2]])


def toilet_paper(name: str) -> Model:
    """Build a roll of toilet paper standing on its end, 0.10 m high, its last sheet a little loose."""
    height, radius, core = 0.100, 0.056, 0.0205
    outer = lathe(
        fillet([[core + 0.0015, 0.0], [radius, 0.0], [radius, height], [core + 0.0015, height]], 0.0025, 3), 72
    )
    rings = []
    for y, sign in ((0.0, -1.0), (height, 1.0)):
        radii = np.arange(core + 0.004, radius - 0.003, 0.0032)
        for r in radii:
            line = np.array([[r - 0.0005, y], [r, y + sign * 0.0005], [r + 0.0005, y]])
            rings.append(lathe(line if sign < 0 else line[::-1], 64))
    tube = lathe(
        fillet(
            [
                [core, -0.0005],
                [core + 0.0016, -0.0005],
                [core + 0.0016, height + 0.0005],
                [core, height + 0.0005],
                [core, -0.0005],
            ],
            0.0004,
            2,
        ),
        40,
    )
    angle = np.linspace(0.0, 1.5, 16)
    spiral = np.stack([(radius + 0.0006) * np.sin(angle), (radius + 0.0006) * np.cos(angle)], -1)
    start, lead = spiral[-1], np.array([np.cos(1.5), -np.sin(1.5)])
    outward = np.array([np.sin(1.5), np.cos(1.5)])
    t = np.linspace(0.0, 1.0, 12)[1:, None]
    tail = start + lead * 0.062 * t + outward * (0.010 * t**1.5 - 0.004 * np.sin(5.0 * t))
    path = np.concatenate([spiral, tail])
    ys = np.linspace(0.0008, height - 0.0008, 9)
    points = np.zeros((9, len(path), 3))
    points[..., 0], points[..., 2], points[..., 1] = path[:, 0], path[:, 1], ys[:, None]
    sag = np.concatenate([np.zeros(16), np.linspace(0.0, 1.0, 11)]) ** 1.5
    points[..., 1] -= 0.0006 * sag
    points[..., 2] += 0.003 * sag * np.sin(ys * 60.0)[:, None]
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    front = grid(points, np.stack(np.broadcast_arrays(length[None], ys[:, None]), -1))
    return make_model(
        name,
        "toilet paper",
        ("Roll", "Tissue", [outer, *rings]),
        ("Sheet", "Tissue", [front, cloth_back(front, 0.0004)]),
        ("Core", "Cardboard", tube),
    ).with_proxies(Sheet=rounded_box((0.002, height, 0.062), 0.0005).translated(0.062, height / 2.0, -0.027))


def soap(name: str) -> Model:
    """Build a used bar of soap, 0.09 m: a soft oval with the maker's mark pressed into it."""

    def bar(points: Array) -> Array:
        x, y, z = points[:, 0] / 0.045, (points[:, 1] - 0.0145) / 0.0145, points[:, 2] / 0.029
        shape = (np.abs(x) ** 2.7 + np.abs(z) ** 2.7 + 1e-9) ** (2.6 / 2.7) + np.abs(y) ** 2.6
        body = (shape ** (1.0 / 2.6) - 1.0) * 0.0145
        oval = np.hypot(points[:, 0] / 0.031, points[:, 2] / 0.0180)
        groove = np.exp(-(((oval - 1.0) / 0.075) ** 2)) + 0.9 * _mark(points[:, 0], points[:, 2]) * (oval < 0.8)
        return np.asarray(body + 0.0020 * groove * (points[:, 1] > 0.018))

    body = surface(bar, [-0.047, 0.0, -0.031], [0.047, 0.030, 0.031], 0.0013)
    return make_model(name, "soap", ("Bar", "SoapGreen", body))


def _mark(x: Array, z: Array) -> Array:
    """Return the relief of the maker's mark, two leaves on a stem."""
    depth = np.exp(-((x / 0.0008) ** 2)) * (np.abs(z) < 0.009)
    for side in (-1.0, 1.0):
        u, v = side * x - 0.006, z + 0.001 + 0.35 * (side * x - 0.006)
        depth = np.maximum(depth, np.exp(-(((u / 0.0072) ** 2 + (v / 0.0034) ** 2) ** 2)))
    return np.asarray(depth)


def plunger(name: str) -> Model:
    """Build a plunger, 0.52 m: a rubber cup on a wooden stick."""
    outside = curve(
        [
            [0.068, 0.0],
            [0.070, 0.004],
            [0.064, 0.010],
            [0.066, 0.022],
            [0.062, 0.045],
            [0.042, 0.068],
            [0.026, 0.076],
            [0.022, 0.084],
        ],
        30,
    )
    neck = fillet([[0.022, 0.084], [0.021, 0.108], [0.024, 0.110], [0.024, 0.118], [0.0135, 0.120]], 0.002, 3)
    inside = curve([[0.016, 0.074], [0.038, 0.062], [0.057, 0.042], [0.061, 0.020], [0.062, 0.002]], 16)
    cup = lathe(np.concatenate([[[0.0, 0.074]], inside, outside, neck[1:]]), 64)
    stick = lathe(
        fillet(
            [
                [0.0, 0.080],
                [0.0125, 0.080],
                [0.0120, 0.30],
                [0.0125, 0.49],
                [0.0135, 0.505],
                [0.0105, 0.520],
                [0.0, 0.521],
            ],
            0.004,
            4,
        ),
        32,
    ).with_uv(swap=True)
    bead = sweep(
        np.stack([0.0128 * np.sin(a := np.arange(32) * np.pi / 16), 0.0 * a + 0.470, 0.0128 * np.cos(a)], -1),
        circle(0.0018, 8),
        closed=True,
    )
    return make_model(name, "plunger", ("Cup", "RubberRed", cup), ("Stick", "Oak", [stick, bead]))
