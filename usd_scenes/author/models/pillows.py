# SPDX-License-Identifier: Apache-2.0
"""Scatter pillows, stuffed by cloth simulation, which draws their sides in and wrinkles their seams."""

from __future__ import annotations

import numpy as np

from usd_scenes.author import cloth_simulation as cloth
from usd_scenes.author.model import Model, make_model
from usd_scenes.author.polygon_mesh import PolygonMesh


def stuffed(size: float, thick: float, seed: int, cell: float = 0.0105, height: float | None = None) -> PolygonMesh:
    """Simulate a stuffed pillow of two sheets, standing in the xy plane about the origin; uv in m over the front.

    size: their width, and their height where none is given.
    """
    flat = cloth.pattern(size, height or size, cell)
    across, along = 2.0 * flat[..., 0] / size, 2.0 * flat[..., 1] / (height or size)
    phase = np.random.default_rng(seed).uniform(0.0, 6.28, 4)
    lumps = np.sin(14.0 * flat[..., 0] + 5.0 * flat[..., 1] + phase[0]) * np.sin(17.0 * flat[..., 1] + phase[1])
    gap = thick * ((1.0 - across**2).clip(0.0) * (1.0 - along**2).clip(0.0)) ** 0.75 * (1.0 + 0.04 * lumps)
    y = 0.002 * np.sin(11.0 * flat[..., 0] + phase[2]) + 0.002 * np.sin(13.0 * flat[..., 1] + phase[3])
    made = cloth.bag(flat, np.stack([flat[..., 0], y, -flat[..., 1]], axis=-1), gap, bend=0.05)
    made.relax(0.4, [], drag=8.0, gravity=0.0)
    return cloth.bag_mesh(made, flat + size / 2.0).rotated("x", 90.0)


def painted_pillow(name: str) -> Model:
    """Build a cotton pillow, 0.45 m, with a child's painting on both sides."""
    cover = stuffed(0.475, 0.135, 3).with_uv(scale=1.0 / 0.475)
    return make_model(name, "pillow", ("Cover", "ScribbleCotton", cover))
