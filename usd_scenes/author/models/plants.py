# SPDX-License-Identifier: Apache-2.0
"""Plants in pots and twigs in a vase."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from usd_scenes.author.model import Model, make_model
from usd_scenes.author.models.tableware import shell, vase
from usd_scenes.author.polygon_mesh import Array, PolygonMesh, grid, merged, normalized, rotation
from usd_scenes.author.shapes import circle, curve, fillet, lathe, sphere, sweep
from usd_scenes.author.sheets import shell as solid_sheet


def leaf(length: float, width: float, droop: float, fold: float) -> PolygonMesh:
    """Build a leaf along +z from the origin, its upper side up: pointed, folded along the midrib, drooping."""
    t = np.linspace(0.0, 1.0, 11)[:, None]
    s = np.linspace(-1.0, 1.0, 7)[None, :]
    half = 0.5 * width * (np.sin(np.pi * t**0.80) ** 0.85) * (1.0 - 0.25 * t)
    x = s * half
    y = fold * np.abs(x) - droop * length * t**2 + 0.006 * np.sin(9.0 * t + 2.0 * s) * np.abs(s)
    z = length * (t - 0.18 * droop * t**2) + 0.0 * s
    points = np.stack(np.broadcast_arrays(x, y, z), axis=-1)
    uv = points[..., [0, 2]]
    top = grid(points, uv).reversed()
    bottom = top.reversed()
    thickness = PolygonMesh(
        bottom.points + bottom.normals * 0.0006, bottom.normals, bottom.uv, bottom.counts, bottom.indices
    )
    return merged([top, thickness])


def rubber_plant(name: str, height: float = 1.55, seed: int = 5, scale: float = 1.0) -> Model:
    """Build three stems with large glossy leaves in a ceramic pot; `scale` scales pot and leaves."""
    height = height / scale
    rng = np.random.default_rng(seed)
    pot = shell(
        curve(
            [[0.0, 0.008], [0.13, 0.006], [0.145, 0.0], [0.158, 0.02], [0.178, 0.15], [0.190, 0.30], [0.192, 0.33]], 30
        ),
        0.012,
        64,
    )
    soil = lathe([[0.176, 0.285], [0.10, 0.292], [0.0, 0.296]], 32)
    trunks: list[PolygonMesh] = []
    stems: list[PolygonMesh] = []
    young: list[PolygonMesh] = []
    old: list[PolygonMesh] = []
    for index in range(3):
        turn = index * 2.1 + rng.uniform(-0.3, 0.3)
        lean = rng.uniform(0.10, 0.20)
        top = height * (1.0, 0.82, 0.66)[index]
        foot = np.array([0.05 * np.sin(turn), 0.28, 0.05 * np.cos(turn)])
        tip = np.array([np.sin(turn) * lean, top, np.cos(turn) * lean])
        line = curve([foot, foot * 0.45 + tip * 0.55 + rng.normal(0.0, 0.02, 3), tip], 24)
        trunks.append(sweep(line, circle(0.010, 10), np.linspace(1.0, 0.45, 24), up=(1.0, 0.0, 0.0)))
        stems.append(trunks[-1])
        for n, t in enumerate(np.linspace(0.16, 1.0, 15 - 3 * index)):
            at = line[int(t * 23)]
            yaw = turn * 57.3 + n * 137.5 + rng.uniform(-14.0, 14.0)
            size = rng.uniform(0.85, 1.12) * (1.0 - 0.35 * t)
            pitch = -10.0 - 52.0 * t**1.6 + rng.uniform(-10.0, 10.0)
            blade = leaf(0.30 * size, 0.145 * size, rng.uniform(0.18, 0.42) * (1.0 - 0.6 * t), 0.32)
            stalk = sweep(
                curve([[0.0, 0.0, 0.0], [0.0, 0.006, 0.03], [0.0, 0.0, 0.065]], 5), circle(0.0028, 6), bevel=0.0
            )
            turn_matrix: Array = rotation("y", yaw) @ rotation("x", pitch)
            (young if t > 0.8 else old).append(
                blade.translated(0.0, 0.0, 0.06).transformed(turn_matrix).translated(*at)
            )
            stems.append(stalk.transformed(turn_matrix).translated(*at))
    parts: tuple[tuple[str, str, list[PolygonMesh]], ...] = (
        ("Pot", "Stoneware", [pot]),
        ("Soil", "Soil", [soil]),
        ("Stems", "Bark", stems),
        ("Leaves", "Leaf", old),
        ("YoungLeaves", "LeafPale", young),
    )
    plant = make_model(name, "plant", *parts)
    plant = plant.with_proxies(Stems=trunks, Leaves=_crown(old), YoungLeaves=_crown(young))
    sized = (part.mapped(lambda mesh: mesh.scaled(scale, scale, scale)) for part in plant.parts)
    return replace(plant, parts=tuple(sized))


def _crown(leaves: list[PolygonMesh]) -> PolygonMesh:
    """Build an ellipsoid around leaves, as a proxy."""
    bounds = merged(leaves).bounds
    return sphere(0.5, 24).scaled(*(bounds[1] - bounds[0])).translated(*bounds.mean(axis=0))


def branches(name: str, seed: int = 9) -> Model:
    """Build dry twigs with small leaves for a vase; they stand on y = 0."""
    rng = np.random.default_rng(seed)
    twigs: list[PolygonMesh] = []
    leaves: list[PolygonMesh] = []
    for index in range(6):
        turn = index * 1.05 + rng.uniform(-0.3, 0.3)
        reach, top = rng.uniform(0.08, 0.20), rng.uniform(0.42, 0.66)
        out = np.array([np.sin(turn), 0.0, np.cos(turn)])
        line = curve(
            [
                out * 0.01,
                out * 0.02 + (0.0, 0.24, 0.0),
                out * reach * 0.7 + (0.0, top * 0.75, 0.0),
                out * reach + (0.0, top, 0.0),
            ],
            18,
        )
        twigs.append(sweep(line, circle(0.0024, 6), np.linspace(1.0, 0.5, 18), up=(1.0, 0.0, 0.0), bevel=0.0))
        for n in range(8, 18):
            side = normalized(np.array([np.cos(n * 2.4), 0.35, np.sin(n * 2.4)]))
            yaw = np.degrees(np.arctan2(side[0], side[2]))
            leaves.append(leaf(0.055, 0.026, 0.2, 0.3).rotated("x", -25.0).rotated("y", yaw).translated(*line[n]))
    whole = make_model(name, "plant", ("Twigs", "Bark", twigs), ("Leaves", "LeafPale", leaves))
    return whole.with_proxies(Leaves=_crown(leaves))


def snake_plant(name: str) -> Model:
    """Build a snake plant: banded green leaves with yellow edges in a clay pot on its saucer, 0.42 m."""
    rng = np.random.default_rng(12)
    profile = [
        [0.0, 0.010],
        [0.052, 0.010],
        [0.056, 0.008],
        [0.076, 0.108],
        [0.086, 0.109],
        [0.088, 0.112],
        [0.088, 0.138],
        [0.086, 0.141],
    ]
    pot = shell(fillet(profile, 0.002, 2), 0.007, 64)
    saucer = shell(
        fillet([[0.0, 0.002], [0.070, 0.002], [0.072, 0.0], [0.076, 0.002], [0.090, 0.020]], 0.003, 3), 0.004, 64
    )
    soil = lathe([[0.0765, 0.120], [0.040, 0.126], [0.0, 0.127]], 32)
    swords = []
    for index in range(11):
        ring = 0.020 if index < 4 else 0.046
        turn = 2.4 * index + rng.uniform(-0.3, 0.3)
        length = rng.uniform(0.24, 0.30) if index < 4 else rng.uniform(0.13, 0.23)
        lean = (4.0 if index < 4 else 12.0) + rng.uniform(-3.0, 4.0)
        blade = _sword(length, rng.uniform(0.034, 0.042), rng.uniform(-25.0, 25.0))
        yaw = np.degrees(turn)
        foot = (ring * np.sin(turn), 0.118, ring * np.cos(turn))
        swords.append(
            blade.rotated("y", rng.uniform(-70.0, 70.0)).rotated("x", lean).rotated("y", yaw).translated(*foot)
        )
    return make_model(
        name,
        "plant",
        ("Pot", "Terracotta", [pot, saucer]),
        ("Soil", "Soil", soil),
        ("Leaves", "SnakeLeaf", swords),
    )


def _sword(length: float, width: float, twist: float) -> PolygonMesh:
    """Build a thick upright leaf, hollow in front; uv 0..1 across and along."""
    t = np.linspace(0.0, 1.0, 19)[:, None]
    s = np.linspace(-1.0, 1.0, 9)[None, :]
    half = 0.5 * width * np.interp(t, [0.0, 0.45, 0.8, 0.95, 1.0], [0.62, 1.0, 0.80, 0.30, 0.02])
    angle = np.radians(twist) * t
    x, z = s * half, 0.45 * half * s**2 + 0.02 * length * np.sin(2.6 * t)
    points = np.stack(
        np.broadcast_arrays(x * np.cos(angle) + z * np.sin(angle), length * t, z * np.cos(angle) - x * np.sin(angle)),
        -1,
    )
    return solid_sheet(points, np.stack(np.broadcast_arrays((s + 1.0) / 2.0, t), -1), 0.0035)


def vase_of_branches(name: str) -> Model:
    """Build a vase of sand-colored glaze with three green branches, 0.75 m."""
    twigs = branches("Branches", 31).translated(0.0, 0.012)
    return Model(name, "vase", (*vase("Vase", "SandGlaze").parts, *twigs.parts))
