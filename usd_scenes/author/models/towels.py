# SPDX-License-Identifier: Apache-2.0
"""Hanging and folded towels and a bath mat, simulated by `cloth_simulation`."""

from __future__ import annotations

import numpy as np

from usd_scenes.author import cloth_simulation as cloth
from usd_scenes.author.model import Model, make_model
from usd_scenes.author.polygon_mesh import grid, merged
from usd_scenes.author.shapes import rounded_box
from usd_scenes.author.soft import wrinkles


def hanging_towel(
    name: str, material: str, width: float, front: float, back: float, radius: float, seed: int, thick: float = 0.009
) -> Model:
    """Build a towel over a bar along x of `radius`, whose top is at y = 0: `front` m hang at +z, `back` m at -z."""
    length = front + back
    flat = cloth.pattern(width, length, 0.016)
    reach = radius + thick / 2.0
    s = flat[..., 1] + (length / 2.0 - back)  # along the cloth, 0 on top of the bar, growing to the front
    turn = np.clip(s / reach, -np.pi / 2.0, np.pi / 2.0)
    hang = np.abs(s) - np.abs(turn) * reach
    rng = np.random.default_rng(seed)
    phase = rng.uniform(0.0, 6.28, 5)
    u = flat[..., 0]
    folds = np.sin(24.0 * u + phase[0] + 2.5 * hang) + 0.5 * np.sin(39.0 * u + phase[1])
    gather = 1.0 - 0.16 * np.minimum(1.0, (hang + 0.06) / 0.35)
    x = u * gather + 0.01 * np.sin(5.0 * s + phase[2])
    y = -radius + reach * np.cos(turn) - hang
    z = reach * np.sin(turn) + np.sign(s) * (0.003 + 0.017 * (folds + 1.5) * np.minimum(1.0, (hang + 0.03) / 0.30))
    made = cloth.sheet(flat, np.stack([x, y, z], axis=-1), shear=0.12, bend=0.05)
    bar = cloth.rod((-width, -radius, 0.0), (width, -radius, 0.0), reach)
    wall = cloth.box((-2.0, -3.0, -1.0), (2.0, 1.0, -0.052), 0.01)
    made.pin(made.sheets[0][np.abs(s) < 0.010])
    made.relax(1.2, [bar, wall], friction=0.6, drag=4.0)
    fine = cloth.refined(made.sheet(), 2)
    mesh = cloth.blanket_mesh(fine[:, ::-1], cloth.refined(flat, 2)[:, ::-1], thick)
    return make_model(name, "towel", ("Terry", material, mesh))


def hooked_towel(name: str, material: str, width: float, length: float, seed: int) -> Model:
    """Build a towel that hangs by its loop from a `bathroom.hook` at the origin, in front of the wall at z = 0."""
    flat = cloth.pattern(width, length, 0.018)
    s = length / 2.0 - flat[..., 1]  # down from its upper edge
    rng = np.random.default_rng(seed)
    phase = rng.uniform(0.0, 6.28, 4)
    u = flat[..., 0]
    spread = 0.16 + 0.40 * np.clip(s / length, 0.0, 1.0) ** 0.7
    x = u * spread
    pleat = np.sin(30.0 * u + phase[0]) + 0.5 * np.sin(53.0 * u + phase[1] + 3.0 * s)
    z = 0.048 + 0.020 * (1.0 - spread) * pleat + 0.012 * np.sin(4.0 * s + phase[2]) * np.minimum(1.0, 4.0 * s)
    y = 0.016 - s - 0.55 * np.abs(u) * np.exp(-s / 0.5)
    made = cloth.sheet(flat, np.stack([x, y, np.maximum(z, 0.022)], axis=-1), shear=0.06, bend=0.05)
    made.pin(made.sheets[0][(s < 0.012) & (np.abs(u) < 0.03)])
    wall = cloth.box((-3.0, -3.0, -1.0), (3.0, 3.0, 0.016), 0.01)
    made.relax(1.6, [wall], friction=0.3, drag=5.0)
    fine = cloth.refined(made.sheet(), 2)
    return make_model(name, "towel", ("Terry", material, cloth.blanket_mesh(fine, cloth.refined(flat, 2), 0.008)))


def folded_towel(
    name: str, material: str, width: float = 0.34, depth: float = 0.24, layers: int = 3, seed: int = 1
) -> Model:
    """Build a bath towel folded into a soft block that lies on y = 0, its fold towards +z."""
    parts = []
    for layer in range(layers):
        leaf = rounded_box((width, 0.026, depth), 0.0125, 4, (24, 1, 18), grain=0)

        def sag(points: np.ndarray, layer: int = layer) -> np.ndarray:
            bent = points.copy()
            bent[:, 1] += 0.0022 * wrinkles(points + np.array([0.0, 1.7 * layer, 0.0]), seed, 0.16, 2)
            bent[:, 0] *= 1.0 + 0.012 * np.sin(9.0 * points[:, 2] + layer)
            bent[:, 2] += 0.004 * np.sin(7.0 * points[:, 0] + 2.0 * layer + seed)
            bent[:, 1] -= 0.006 * (np.abs(points[:, 0]) / (width / 2.0)) ** 4 * (layer + 1) / layers
            return bent

        parts.append(leaf.deformed(sag).translated(0.003 * np.sin(3.1 * layer + seed), 0.0135 + 0.0245 * layer, 0.0))
    return make_model(name, "towel", ("Terry", material, parts))


def bath_mat(name: str, material: str, width: float = 0.80, depth: float = 0.52) -> Model:
    """Build a thick tufted mat lying on y = 0 with a hemmed edge."""
    cell = 0.02
    flat = cloth.pattern(width, depth, cell)
    across, along = np.abs(2.0 * flat[..., 0] / width), np.abs(2.0 * flat[..., 1] / depth)
    inside = np.minimum((1.0 - across) * width, (1.0 - along) * depth) / 2.0
    level = 0.006 + 0.011 * np.clip((inside - 0.03) / 0.02, 0.0, 1.0)
    points = np.stack([flat[..., 0], level, -flat[..., 1]], axis=-1)
    points[..., 1] += 0.0015 * wrinkles(points.reshape(-1, 3), 5, 0.09).reshape(level.shape) * (inside > 0.05)
    top = grid(points, flat)
    base = rounded_box((width, 0.010, depth), 0.0045, 2).translated(0.0, 0.0052, 0.0)
    bands = [
        rounded_box((wide, 0.007, depth - 0.085), 0.003, 2, (2, 1, 24))
        .translated(side * (width / 2.0 - at), 0.0175, 0.0)
        .deformed(lambda points: points + np.array([0.0, 0.0015, 0.0]) * wrinkles(points, 5, 0.09)[:, None])
        for side in (-1.0, 1.0)
        for at, wide in ((0.095, 0.030), (0.150, 0.014))
    ]
    return make_model(name, "bath mat", ("Terry", material, merged([top, base])), ("Bands", "TerryWhite", bands))
