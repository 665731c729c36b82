# SPDX-License-Identifier: Apache-2.0
"""Fork, spoon, knife and napkin: each lies on y = 0 along z, its handle towards +z."""

from __future__ import annotations

import numpy as np

from usd_scenes.author.model import Model, make_model
from usd_scenes.author.models.tableware import shell
from usd_scenes.author.polygon_mesh import Array, PolygonMesh
from usd_scenes.author.shapes import curve, rectangle, rounded_box, sweep

HANDLE_WIDTHS = np.array([0.9, 0.8, 0.75, 0.8, 1.0, 1.35, 1.75, 2.0, 1.7, 0.9])


def _handle(start: float, end: float) -> PolygonMesh:
    """Build a flat handle that rises from the neck and rests on its end."""
    z = np.linspace(start, end, 10)
    y = 0.004 + 0.010 * np.sin(np.pi * np.clip((z - start) / (end - start), 0.0, 1.0)) ** 0.8
    widths = np.stack([HANDLE_WIDTHS, np.linspace(1.1, 0.8, 10)], axis=-1)
    return sweep(np.stack([0.0 * z, y, z], axis=-1), rectangle(0.0085, 0.0030, 0.0013, 2), widths, bevel=0.001)


def fork(name: str) -> Model:
    """Build a table fork, 0.20 m, with four tines."""
    root = curve([[0.0, 0.004, 0.012], [0.0, 0.0015, -0.005], [0.0, 0.002, -0.028]], 10)
    palm = sweep(root, rectangle(0.024, 0.0024, 0.001, 2), np.stack([np.linspace(0.32, 1.0, 10), np.ones(10)], -1))
    tines = []
    for i in range(4):
        x = (i - 1.5) * 0.0066
        line = curve([[x, 0.002, -0.026], [x, 0.0035, -0.052], [x, 0.0095, -0.078]], 8)
        tines.append(sweep(line, rectangle(0.0040, 0.0022, 0.0009, 2), np.linspace(1.0, 0.5, 8), bevel=0.0006))
    return make_model(name, "fork", ("Tines", "Steel", [palm, *tines]), ("Handle", "Steel", _handle(0.010, 0.120)))


def spoon(name: str) -> Model:
    """Build a table spoon, 0.20 m: an egg-shaped bowl on the handle."""
    angle = np.linspace(0.0, np.pi / 2.0, 14)
    round_bowl = shell(np.stack([0.021 * np.sin(angle), 0.011 * (1.0 - np.cos(angle))], axis=-1), 0.0012, 40)

    def egg(points: Array) -> Array:
        z = points[:, 2] / 0.021
        return np.stack([points[:, 0] / (1.0 + 0.16 * z), points[:, 1], 0.035 * z - 0.038], axis=-1)

    neck = sweep(
        curve([[0.0, 0.0080, -0.006], [0.0, 0.0085, 0.002], [0.0, 0.0045, 0.014]], 6),
        rectangle(0.008, 0.003, 0.0013, 2),
    )
    return make_model(
        name, "spoon", ("Bowl", "Steel", [round_bowl.deformed(egg), neck]), ("Handle", "Steel", _handle(0.010, 0.120))
    )


def knife(name: str) -> Model:
    """Build a table knife, 0.22 m."""
    blade = rounded_box((0.0014, 0.020, 0.105), 0.0006, 1, (1, 2, 10), grain=2)

    def taper(points: Array) -> Array:
        bent = points.copy()
        t = np.clip((-points[:, 2] - 0.02) / 0.0325, 0.0, 1.0)
        bent[:, 1] = np.where(points[:, 1] > 0.0, points[:, 1] - 0.010 * t**2, points[:, 1] + 0.002 * t)
        return bent

    flat = blade.deformed(taper).rotated("z", 90.0).translated(0.0, 0.0016, -0.045)
    grip = sweep([[0.0, 0.0042, 0.004], [0.0, 0.0042, 0.110]], rectangle(0.016, 0.008, 0.003, 3), [0.8, 1.0])
    return make_model(name, "knife", ("Steel", "Steel", [flat, grip]))


def napkin(name: str) -> Model:
    """Build a linen napkin folded in three."""
    folds = []
    for i in range(3):
        leaf = rounded_box((0.105 - 0.002 * i, 0.0034, 0.21), 0.0015, 2, (6, 1, 10), grain=2)

        def sag(points: Array, i: int = i) -> Array:
            bent = points.copy()
            bent[:, 1] += 0.0012 * np.sin(40.0 * points[:, 0] + 1.7 * i) * np.sin(26.0 * points[:, 2] + i)
            return bent

        folds.append(leaf.deformed(sag).translated(0.001 * i, 0.0024 + 0.0034 * i, -0.0015 * i))
    return make_model(name, "napkin", ("Linen", "Linen", folds))
