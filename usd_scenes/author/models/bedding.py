# SPDX-License-Identifier: Apache-2.0
"""Bedding, simulated by `cloth_simulation`, in the bed's coordinates: head at z = 0, foot towards +z."""

from __future__ import annotations

from functools import cache

import numpy as np

from usd_scenes.author import cloth_simulation as cloth
from usd_scenes.author.model import Model, make_model
from usd_scenes.author.models.bedroom import BED_LENGTH, BED_WIDTH, HEADBOARD, MATTRESS_TOP
from usd_scenes.author.models.pillows import stuffed

MATTRESS = cloth.box(
    (-BED_WIDTH / 2.0, 0.20, HEADBOARD), (BED_WIDTH / 2.0, MATTRESS_TOP, HEADBOARD + BED_LENGTH), 0.055
)

RAILS = cloth.box((-BED_WIDTH / 2.0 - 0.04, 0.15, HEADBOARD), (BED_WIDTH / 2.0 + 0.04, 0.36, BED_LENGTH + 0.14), 0.012)


@cache
def _duvet() -> cloth.Cloth:
    """Simulate a duvet of 2.10 × 1.75 m: slightly askew and pushed together into folds."""
    width, length = 2.12, 1.78
    flat = cloth.pattern(width, length, 0.026)
    across, along = 2.0 * flat[..., 0] / width, 2.0 * flat[..., 1] / length
    gap = 0.12 * ((1.0 - across**6).clip(0.0) * (1.0 - along**6).clip(0.0)) ** 0.5
    rng = np.random.default_rng(5)
    phase = rng.uniform(0.0, 6.28, 6)
    x = 0.94 * flat[..., 0] + 0.012 * flat[..., 1] + 0.02 * np.sin(3.1 * flat[..., 1] + phase[0])
    z = 0.90 * flat[..., 1] + 1.455 + 0.05 * np.sin(1.9 * flat[..., 0] + phase[1])
    y = MATTRESS_TOP + 0.10 + 0.03 * np.sin(7.0 * flat[..., 0] + 3.0 * flat[..., 1] + phase[2])
    y = y + 0.025 * np.sin(9.0 * flat[..., 1] - 4.0 * flat[..., 0] + phase[3])
    lumps = np.sin(11.0 * flat[..., 0] + 6.0 * np.sin(2.3 * flat[..., 1] + phase[4])) * np.sin(
        8.0 * flat[..., 1] + phase[5]
    )
    made = cloth.bag(flat, np.stack([x, y, z], axis=-1), gap * (1.0 + 0.22 * lumps), shear=0.25, bend=0.04)
    made.relax(1.5, [MATTRESS, RAILS], friction=0.35)
    return made


def duvet(name: str) -> Model:
    """Build a duvet on the bed."""
    uv = cloth.pattern(2.12, 1.78, 0.026)
    return make_model(name, "duvet", ("Cover", "DuvetLinen", cloth.bag_mesh(_duvet(), uv, 2)))


def _under_a_throw() -> cloth.Obstacle:
    """Return the duvet and mattress as an obstacle for a throw."""
    made = _duvet()
    mattress_z = np.linspace(HEADBOARD, HEADBOARD + BED_LENGTH, 60)
    edge_x = np.linspace(-BED_WIDTH / 2.0, BED_WIDTH / 2.0, 60)
    flat = np.stack([*(a.ravel() for a in np.meshgrid(edge_x, mattress_z))], axis=-1)
    bed = np.insert(flat, 1, MATTRESS_TOP - 0.02, axis=1)
    return cloth.landscape(np.concatenate([cloth.refined(made.sheet(0), 3).reshape(-1, 3), bed]), 0.012, 0.021)


def bed_throw(name: str, material: str = "ThrowWool") -> Model:
    """Build a knitted throw across the foot of the bed, hanging down one side."""
    width, length = 2.30, 0.78
    flat = cloth.pattern(width, length, 0.022)
    angle = np.radians(-7.0)
    x = np.cos(angle) * flat[..., 0] * 0.96 - np.sin(angle) * flat[..., 1] + 0.10
    z = np.sin(angle) * flat[..., 0] * 0.96 + np.cos(angle) * flat[..., 1] * 0.90 + 1.68
    y = 0.82 + 0.012 * np.sin(21.0 * flat[..., 1] + 3.0 * np.sin(4.0 * flat[..., 0]))
    made = cloth.sheet(flat, np.stack([x, np.broadcast_to(y, x.shape), z], axis=-1), shear=0.08, bend=0.03)
    made.relax(1.2, [_under_a_throw(), cloth.floor(0.012)], friction=0.45)
    mesh = cloth.blanket_mesh(cloth.refined(made.sheet()[:, ::-1], 2), cloth.refined(flat[:, ::-1], 2), 0.011)
    return make_model(name, "blanket", ("Wool", material, mesh))


def bed_pillow(name: str, material: str, width: float, height: float, thick: float, seed: int) -> Model:
    """Build a stuffed pillow that lies in the xz plane, its height along z."""
    return make_model(
        name, "pillow", ("Cover", material, stuffed(width, thick, seed, 0.0125, height).rotated("x", -90.0))
    )


def leaning(item: Model, at: tuple[float, float, float], pitch: float, yaw: float = 0.0, roll: float = 0.0) -> Model:
    """Lift a model's -z end by `pitch` degrees, rotate it by `yaw` about y, and place its lowest point at `at`."""
    turned = item.rotated("z", roll).rotated("x", pitch).rotated("y", yaw)
    low = turned.bounds[0][1]
    return turned.translated(at[0], at[1] - float(low), at[2])
