# SPDX-License-Identifier: Apache-2.0
"""Doors of a home: a glazed front door, and an open leaf for a doorway."""

from __future__ import annotations

import numpy as np

from usd_scenes.author.model import Model, make_model
from usd_scenes.author.polygon_mesh import PolygonMesh
from usd_scenes.author.shapes import circle, cylinder, fillet, molding, rounded_box, sweep

LEAF, TALL, TRANSOM = 0.95, 2.05, 0.34  # m: width and height of the front door's leaf, height of the light above it
PANES = ((-0.20, 1.38, 0.27, 0.98), (0.20, 1.38, 0.27, 0.98))  # centers and sizes in the leaf, m


def _panel(x: float, y: float, width: float, height: float, z: float) -> PolygonMesh:
    """Build the molding of a panel that faces +z."""
    corners = np.array([[-1, -1], [-1, 1], [1, 1], [1, -1]]) * (width / 2.0, height / 2.0) + (x, y)
    path = np.concatenate([corners, np.full((4, 1), z)], axis=1)[::-1]
    profile = fillet([[0.0, 0.0], [0.0, 0.012], [-0.022, 0.005], [-0.026, 0.0]], 0.002, 2)
    return molding(path, profile, up=(0.0, 0.0, 1.0), closed=True)


def lever_handle(x: float, z: float, towards: float) -> list[PolygonMesh]:
    """Build a lever with its rose on a face at z; the lever points along x by the sign of `towards`."""
    rose = cylinder(0.026, 0.008, 0.002, 32).rotated("x", 90.0).translated(x, 1.02, z + 0.003)
    neck = sweep([[x, 1.02, z], [x, 1.02, z + 0.046]], circle(0.009, 14))
    ends = sorted((x - 0.008 * towards, x + 0.12 * towards))
    return [rose, neck, sweep([[at, 1.02, z + 0.046] for at in ends], circle(0.0095, 14), bevel=0.004)]


def front_door(name: str) -> Model:
    """Build a front door with two frosted panes and a light above, in an opening 0.16 m deep behind z = 0."""
    z, frame = -0.12, 0.07
    wide, high = LEAF + 2.0 * frame, TALL + TRANSOM + 2.0 * frame
    timber = [
        rounded_box((frame, high, 0.10), 0.005, 2).translated(x * (wide - frame) / 2.0, high / 2.0, z)
        for x in (-1.0, 1.0)
    ]
    for y in (TALL + frame / 2.0, high - frame / 2.0):
        timber.append(rounded_box((LEAF + 0.004, frame, 0.10), 0.005, 2).translated(0.0, y, z))
    stile = 0.065
    for x in (-1.0, 0.0, 1.0):
        timber.append(
            rounded_box((stile if x else 0.13, TALL - 0.01, 0.046), 0.004, 2).translated(
                x * (LEAF - stile) / 2.0, TALL / 2.0, z
            )
        )
    for y, tall in ((0.12, 0.24), (0.82, 0.14), (TALL - 0.09, 0.18)):
        timber.append(rounded_box((LEAF - 0.01, tall, 0.045), 0.004, 2).translated(0.0, y, z))
    for x, y, width, height in PANES:
        timber.append(_panel(x, y, width, height, z + 0.018))
    for x in (-0.20, 0.20):
        timber.append(rounded_box((0.27, 0.52, 0.024), 0.003).translated(x, 0.49, z))
        timber.append(_panel(x, 0.49, 0.27, 0.50, z + 0.010))
    panes = [
        rounded_box((width + 0.02, height + 0.02, 0.006), 0.001).translated(x, y, z) for x, y, width, height in PANES
    ]
    panes.append(
        rounded_box((LEAF + 0.01, TRANSOM + 0.01, 0.006), 0.001).translated(0.0, TALL + frame + TRANSOM / 2.0, z)
    )
    metal = lever_handle(-LEAF / 2.0 + 0.055, z + 0.022, 1.0)
    metal.append(rounded_box((0.20, 0.035, 0.006), 0.002, 2).translated(0.0, 0.82, z + 0.026))
    step = rounded_box((wide, 0.02, 0.20), 0.004).translated(0.0, 0.004, z)
    return make_model(
        name,
        "door",
        ("Timber", "SagePaint", timber),
        ("Panes", "FrostedPane", panes),
        ("Brass", "Brass", metal),
        ("Step", "CounterStone", step),
    )


def open_leaf(name: str, width: float = 0.90, height: float = 2.04) -> Model:
    """Build a door's leaf of 40 mm, its hinges on the y axis; it extends along +x and shows panels on both sides."""
    body = [rounded_box((width, height, 0.030), 0.003, 2).translated(width / 2.0, height / 2.0 + 0.006)]
    handles = []
    for side in (0.0, 180.0):
        for x in (-0.195, 0.195):
            for y, tall in ((0.50, 0.62), (1.43, 0.92)):
                body.append(_panel(x, y, 0.29, tall, 0.015).rotated("y", side).translated(width / 2.0))
        grip = (
            lever_handle(width / 2.0 - 0.07, 0.015, -1.0)
            if side == 0.0
            else lever_handle(-width / 2.0 + 0.07, 0.015, 1.0)
        )
        handles += [mesh.rotated("y", side).translated(width / 2.0) for mesh in grip]
    hinges = [cylinder(0.008, 0.09, 0.002, 16).translated(0.0, y) for y in (0.22, 1.02, 1.84)]
    return make_model(name, "door", ("Timber", "TrimPaint", body), ("Handles", "Steel", [*handles, *hinges]))
