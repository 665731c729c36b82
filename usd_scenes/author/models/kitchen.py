# SPDX-License-Identifier: Apache-2.0
"""Kitchen objects: a casserole, a stool."""

from __future__ import annotations

import numpy as np

from usd_scenes.author.model import Model, make_model
from usd_scenes.author.polygon_mesh import PolygonMesh, merged
from usd_scenes.author.shapes import circle, curve, cylinder, fillet, lathe, rectangle, sphere, sweep


def pot(name: str) -> Model:
    """Build a casserole of 0.24 m with its lid on, two handles and a knob."""
    radius, height = 0.12, 0.125
    outside = fillet(
        [[0.0, 0.0], [radius - 0.012, 0.0], [radius, 0.016], [radius, height - 0.004], [radius + 0.005, height]],
        0.008,
        4,
    )
    inside = fillet(
        [[radius + 0.004, height + 0.002], [radius - 0.0025, height - 0.002], [radius - 0.003, 0.02], [0.0, 0.004]],
        0.002,
        3,
    )
    body = lathe(np.concatenate([outside, inside]), 80)
    lid_line = curve(
        [[radius + 0.0045, 0.004], [radius - 0.004, 0.012], [0.080, 0.027], [0.030, 0.035], [0.0, 0.036]], 24
    )
    under = np.array([[0.0, 0.002], [radius - 0.004, 0.0], [radius + 0.004, 0.0015]])
    lid = lathe(np.concatenate([under, lid_line]), 80).translated(0.0, height + 0.001)
    band = lathe(
        fillet(
            [[radius + 0.002, 0.0], [radius + 0.0062, 0.0005], [radius + 0.0062, 0.0045], [radius + 0.002, 0.0050]],
            0.0012,
            2,
        ),
        80,
    ).translated(0.0, height + 0.0005)
    stem = cylinder(0.0065, 0.014, 0.001, 24).translated(0.0, height + 0.042)
    knob = lathe(
        curve([[0.0, 0.0], [0.009, 0.0015], [0.0175, 0.008], [0.0195, 0.0135], [0.0150, 0.0185], [0.0, 0.0200]], 20), 40
    )
    handles, rivets = [], []
    for side in (-1.0, 1.0):
        loop = curve(
            [
                [side * (radius - 0.002), 0.098, -0.042],
                [side * (radius + 0.022), 0.101, -0.040],
                [side * (radius + 0.040), 0.104, -0.020],
                [side * (radius + 0.040), 0.104, 0.020],
                [side * (radius + 0.022), 0.101, 0.040],
                [side * (radius - 0.002), 0.098, 0.042],
            ],
            28,
        )
        handles.append(sweep(loop, rectangle(0.0125, 0.0100, 0.0045, 3)))
        for z in (-0.042, 0.042):
            plate = (
                cylinder(0.012, 0.004, 0.0015, 24)
                .rotated("z", 90.0)
                .translated(side * (np.hypot(radius, 0.0) - 0.0058), 0.098, z)
            )
            rivets.append(merged([plate, sphere(0.0035, 12).translated(side * (radius - 0.0035), 0.098, z)]))
    return make_model(
        name,
        "pot",
        ("Body", "EnamelRed", body),
        ("Lid", "EnamelRed", lid),
        ("Rim", "Steel", [band, stem, *rivets]),
        ("Handles", "EnamelRed", handles),
        ("Knob", "BlackPlastic", knob.translated(0.0, height + 0.047)),
    )


def counter_stool(name: str) -> Model:
    """Build a counter stool, 0.65 m: a round oak seat on four black steel legs with a foot ring."""
    seat = lathe(
        fillet([[0.0, 0.612], [0.150, 0.612], [0.170, 0.622], [0.172, 0.642], [0.160, 0.650], [0.0, 0.642]], 0.008, 4),
        64,
    )
    flat = seat.points[:, [0, 2]] + (0.6, 0.3)
    seat = PolygonMesh(seat.points, seat.normals, flat, seat.counts, seat.indices)
    legs = [
        sweep(
            [[0.115 * np.sin(a), 0.615, 0.115 * np.cos(a)], [0.200 * np.sin(a), 0.0, 0.200 * np.cos(a)]],
            circle(0.0115, 16),
            up=(0.3, 0.0, 1.0),
        )
        for a in np.arange(4) * np.pi / 2.0 + np.pi / 4.0
    ]
    ring = sweep(np.insert(circle(0.172, 72), 1, 0.205, axis=1), circle(0.0085, 14), closed=True)
    return make_model(name, "stool", ("Seat", "Oak", seat), ("Legs", "BlackMetal", [*legs, ring]))
