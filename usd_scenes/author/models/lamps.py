# SPDX-License-Identifier: Apache-2.0
"""Lamps that can be spawned: their emissive shades give light without a light prim."""

from __future__ import annotations

import numpy as np

from usd_scenes.author.model import Model, make_model
from usd_scenes.author.models.tables import drum_shade
from usd_scenes.author.polygon_mesh import PolygonMesh
from usd_scenes.author.shapes import circle, cylinder, fillet, lathe, sphere, sweep


def tripod_lamp(name: str) -> Model:
    """Build a floor lamp, 1.52 m: a drum of linen on three oak legs that cross a brass collar."""
    legs: list[PolygonMesh] = []
    for turn in np.arange(3) * 2.0 * np.pi / 3.0 + 0.5:
        out = np.array([np.sin(turn), 0.0, np.cos(turn)])
        foot, head = out * 0.30, out * 0.036 + (0.0, 1.17, 0.0)
        legs.append(sweep([foot, head], circle(0.0165, 18), [0.62, 1.0], up=(0.0, 0.0, 1.0), bevel=0.004))
    collar = lathe(fillet([[0.0, 1.075], [0.062, 1.075], [0.062, 1.097], [0.0, 1.097]], 0.003, 3), 48)
    hub = lathe(
        fillet([[0.0, 1.150], [0.060, 1.150], [0.062, 1.178], [0.020, 1.190], [0.010, 1.215], [0.0, 1.215]], 0.003, 3),
        48,
    )
    stem = cylinder(0.008, 0.24, 0.001, 16).translated(0.0, 1.31)
    socket = cylinder(0.019, 0.055, 0.003, 24).translated(0.0, 1.32)
    spider = [
        sweep(
            [[0.0, 1.425, 0.0], [0.197 * np.sin(a), 1.487, 0.197 * np.cos(a)]],
            circle(0.0028, 8),
            up=(0.3, 0.0, 1.0),
            bevel=0.001,
        )
        for a in np.arange(3) * 2.0 * np.pi / 3.0
    ]
    finial = sphere(0.011, 16).translated(0.0, 1.432)
    bulb = sphere(0.034, 24).scaled(1.0, 1.15, 1.0).translated(0.0, 1.375)
    return make_model(
        name,
        "floor lamp",
        ("Legs", "Oak", legs),
        ("Fittings", "Brass", [collar, hub, stem, socket, *spider, finial]),
        ("Shade", "LampShade", drum_shade(0.20, 0.24, 0.27).translated(0.0, 1.235, 0.0)),
        ("Bulb", "LampGlow", bulb),
    )
