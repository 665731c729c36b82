# SPDX-License-Identifier: Apache-2.0
"""Bedroom furniture: bed, bedside table, lamps, wardrobe, chest of drawers."""

from __future__ import annotations

import numpy as np

from usd_scenes.author.model import Model, make_model
from usd_scenes.author.models.tables import drum_shade
from usd_scenes.author.models.tableware import shell
from usd_scenes.author.polygon_mesh import Array, PolygonMesh, grid
from usd_scenes.author.shapes import (
    circle,
    curve,
    cylinder,
    fillet,
    four_legs,
    lathe,
    leg,
    rectangle,
    rounded_box,
    sweep,
)
from usd_scenes.author.soft import cushion, wrinkles

BED_WIDTH, BED_LENGTH, MATTRESS_TOP = 1.60, 2.00, 0.55
HEADBOARD = 0.10  # m, how thick; the mattress begins there


def bed(name: str) -> Model:
    """Build an oak bed for a mattress of 1.60 × 2.00 m: its channeled headboard at z = 0, its foot towards +z."""
    width, length = BED_WIDTH + 0.07, HEADBOARD + BED_LENGTH + 0.03
    channels = []
    count = 9
    pitch = width / count
    for i in range(count):
        box = rounded_box((pitch - 0.001, 0.78, HEADBOARD - 0.02), 0.030, 4, (6, 20, 2))

        def fill(points: Array, seed: int = i) -> Array:
            x = points[:, 0] / (pitch / 2.0)
            bent = points.copy()
            bent[:, 2] += np.where(points[:, 2] > 0.0, 0.016 * (1.0 - x**2).clip(0.0), 0.0)
            bent[:, 2] += 0.0014 * wrinkles(points, 300 + seed, 0.20) * (points[:, 2] > 0.0)
            return bent

        channels.append(box.deformed(fill).translated((i - (count - 1) / 2.0) * pitch, 0.72, HEADBOARD / 2.0))
    rails = [
        rounded_box((0.030, 0.155, length - HEADBOARD), 0.006, 2)
        .with_uv(0.3 * s, 0.1)
        .translated(s * (width / 2.0 - 0.015), 0.275, (HEADBOARD + length) / 2.0)
        for s in (-1, 1)
    ]
    rails.append(rounded_box((width, 0.155, 0.030), 0.006, 2).with_uv(0.1, 0.5).translated(0.0, 0.275, length - 0.015))
    legs = [
        leg([x * (width / 2.0 - 0.06), 0.21, z], [x * (width / 2.0 - 0.045), 0.0, z + 0.012 * s], circle(0.030, 20))
        for x in (-1.0, 1.0)
        for z, s in ((0.30, -1.0), (length - 0.09, 1.0))
    ]
    base = rounded_box((width - 0.04, 0.10, length - HEADBOARD - 0.04), 0.01).translated(
        0.0, 0.265, (HEADBOARD + length) / 2
    )
    mattress = rounded_box((BED_WIDTH, MATTRESS_TOP - 0.315, BED_LENGTH), 0.055, 4, (30, 3, 36), grain=0)

    def tuck(points: Array) -> Array:
        bent = points.copy()
        swell = 0.0035 * wrinkles(points * (1.0, 0.4, 1.0), 310, 0.42, 3)
        top = points[:, 1] > 0.0
        bent[:, 1] += np.where(top, swell - 0.004, 0.0)
        pull = 0.0025 * np.sin(points[:, 0] * 70.0 + 1.5 * np.sin(points[:, 2] * 9.0))
        bent[:, 2] += np.where(~top & (np.abs(points[:, 2]) > 0.98), pull, 0.0)
        return bent

    sheet = mattress.deformed(tuck).translated(0.0, (MATTRESS_TOP + 0.315) / 2.0, HEADBOARD + BED_LENGTH / 2.0)
    back = rounded_box((width, 0.86, 0.020), 0.004).translated(0.0, 0.70, 0.010)
    return make_model(
        name,
        "bed",
        ("Headboard", "Oatmeal", [*channels, back]),
        ("Frame", "Oak", [*rails, *legs]),
        ("Base", "Oatmeal", base),
        ("Sheet", "BedSheet", sheet),
    )


def bedside_table(name: str) -> Model:
    """Build an oak bedside table, 0.45 × 0.40 × 0.50 m: a drawer over an open shelf, on legs; its back at z = -0.20."""
    width, depth, top = 0.45, 0.40, 0.50
    boards = [
        rounded_box((width, 0.020, depth), 0.003, 2).with_uv(0.1, 0.2).translated(0.0, top - 0.010, 0.0),
        rounded_box((width - 0.036, 0.016, depth - 0.01), 0.002).with_uv(0.5, 0.6).translated(0.0, 0.158, 0.0),
        rounded_box((width - 0.036, 0.016, depth - 0.01), 0.002).with_uv(0.7, 0.3).translated(0.0, 0.330, 0.0),
        rounded_box((width - 0.036, 0.33, 0.010), 0.002).with_uv(0.2, 0.0).translated(0.0, 0.315, -depth / 2.0 + 0.010),
    ]
    boards += [
        rounded_box((0.018, top - 0.168, depth), 0.003, 2, grain=2)
        .with_uv(0.4 * s, 0.33)
        .translated(s * (width / 2.0 - 0.009), (top + 0.128) / 2.0, 0.0)
        for s in (-1, 1)
    ]
    drawer = (
        rounded_box((width - 0.042, 0.134, 0.018), 0.0025, 2)
        .with_uv(0.9, 0.45)
        .translated(0.0, 0.408, depth / 2 - 0.011)
    )
    knob = lathe(
        fillet([[0.0, 0.0], [0.006, 0.0], [0.006, 0.012], [0.013, 0.018], [0.012, 0.026], [0.0, 0.027]], 0.003, 3), 24
    )
    legs = four_legs((0.185, 0.155, 0.155), (0.200, 0.0, 0.170), circle(0.016, 16))
    return make_model(
        name,
        "bedside table",
        ("Case", "Oak", [*boards, *legs]),
        ("Drawer", "Oak", drawer),
        ("Knob", "Brass", knob.rotated("x", 90.0).translated(0.0, 0.408, depth / 2 - 0.002)),
    )


def table_lamp(name: str) -> Model:
    """Build a bedside lamp, 0.44 m: a ribbed ceramic foot under a linen drum; the room has the bulb, at 0.33 m."""
    profile = curve(
        [
            [0.0, 0.0],
            [0.058, 0.0],
            [0.064, 0.010],
            [0.080, 0.075],
            [0.074, 0.135],
            [0.040, 0.185],
            [0.018, 0.205],
            [0.016, 0.22],
        ],
        48,
    )
    foot = lathe(profile, 96)

    def ribs(points: Array) -> Array:
        angle = np.arctan2(points[:, 0], points[:, 2])
        height = np.clip(points[:, 1] / 0.03, 0.0, 1.0) * np.clip((0.18 - points[:, 1]) / 0.05, 0.0, 1.0)
        radius = np.hypot(points[:, 0], points[:, 2])
        scale = 1.0 - 0.0028 * height * (0.5 + 0.5 * np.cos(24.0 * angle)) / np.maximum(radius, 1e-3)
        return np.stack([points[:, 0] * scale, points[:, 1], points[:, 2] * scale], axis=-1)

    neck = cylinder(0.011, 0.05, 0.002, 24).translated(0.0, 0.24, 0.0)
    spider = [
        sweep(
            [[0.0, 0.262, 0.0], [0.112 * np.sin(a), 0.43, 0.112 * np.cos(a)]],
            circle(0.0018, 6),
            up=(0.3, 0.0, 1.0),
            bevel=0.0,
        )
        for a in np.arange(3) * 2.0 * np.pi / 3.0
    ]
    return make_model(
        name,
        "table lamp",
        ("Foot", "SandGlaze", foot.deformed(ribs)),
        ("Neck", "Brass", [neck, *spider]),
        ("Shade", "BedsideShade", drum_shade(0.115, 0.155, 0.20).translated(0.0, 0.235, 0.0)),
    )


def wardrobe(name: str, width: float = 1.80, height: float = 2.20, depth: float = 0.60) -> Model:
    """Build a painted wardrobe of three doors with fluted fronts, its back on z = 0."""
    case = [
        rounded_box((width, 0.025, depth), 0.003).translated(0.0, height - 0.0125, depth / 2.0),
        rounded_box((width - 0.004, 0.08, depth - 0.06), 0.003).translated(0.0, 0.040, depth / 2.0 - 0.02),
        rounded_box((width - 0.05, height - 0.10, 0.02), 0.002).translated(0.0, height / 2.0 + 0.03, 0.012),
    ]
    case += [
        rounded_box((0.025, height - 0.025, depth), 0.003).translated(
            s * (width / 2 - 0.0125), (height - 0.025) / 2, depth / 2
        )
        for s in (-1, 1)
    ]
    leaf = (width - 0.056) / 3.0
    doors, handles = [], []
    tall = height - 0.025 - 0.086
    for i in range(3):
        x = (i - 1) * leaf
        y = 0.084 + tall / 2.0
        doors.append(rounded_box((leaf - 0.004, tall, 0.016), 0.0025, 2, grain=1).translated(x, y, depth - 0.012))
        for side in (-1.0, 1.0):
            stile = rounded_box((0.070, tall, 0.008), 0.002, 2, grain=1)
            doors.append(stile.translated(x + side * (leaf / 2.0 - 0.037), y, depth - 0.001))
        for level in (0.084 + 0.05, 0.084 + tall * 0.42, 0.084 + tall - 0.05):
            rail = rounded_box((leaf - 0.146, 0.090 if level > 0.2 else 0.10, 0.008), 0.002, 2, grain=0)
            doors.append(rail.translated(x, level, depth - 0.001))
        grip = x + (leaf / 2.0 - 0.036) * (1.0 if i == 0 else -1.0)
        handles.append(
            sweep([[grip, 1.02, depth + 0.026], [grip, 1.18, depth + 0.026]], circle(0.006, 12), up=(0, 0, 1))
        )
        handles += [
            sweep([[grip, h, depth], [grip, h, depth + 0.026]], circle(0.005, 10), bevel=0.0) for h in (1.04, 1.16)
        ]
    return make_model(
        name, "wardrobe", ("Case", "SagePaint", case), ("Doors", "SagePaint", doors), ("Handles", "Brass", handles)
    )


def chest_of_drawers(name: str, width: float = 1.10, height: float = 0.82, depth: float = 0.45) -> Model:
    """Build an oak chest of six drawers on short legs, its back at z = -depth / 2."""
    case = [
        rounded_box((width, 0.024, depth), 0.003, 2).with_uv(0.2, 0.1).translated(0.0, height - 0.012, 0.0),
        rounded_box((width - 0.044, 0.02, depth - 0.01), 0.002).translated(0.0, 0.15, -0.004),
        rounded_box((width - 0.044, height - 0.16, 0.012), 0.002).translated(
            0.0, (height + 0.14) / 2.0, -depth / 2 + 0.012
        ),
        rounded_box((0.018, height - 0.18, depth - 0.03), 0.002, grain=1).translated(
            0.0, (height + 0.14) / 2.0, -0.004
        ),
    ]
    case += [
        rounded_box((0.022, height - 0.164, depth), 0.003, 2, grain=1)
        .with_uv(0.3 * s, 0.2)
        .translated(s * (width / 2.0 - 0.011), (height + 0.116) / 2.0, 0.0)
        for s in (-1, 1)
    ]
    rows = (0.235, 0.215, 0.185)
    fronts, knobs = [], []
    bottom, front = 0.163, (width - 0.062) / 2.0
    knob = lathe(
        fillet([[0.0, 0.0], [0.006, 0.0], [0.006, 0.012], [0.014, 0.019], [0.013, 0.027], [0.0, 0.028]], 0.003, 3), 24
    )
    for row, tall in enumerate(rows):
        for column in (-1.0, 1.0):
            x, y = column * (front + 0.018) / 2.0, bottom + tall / 2.0
            box = rounded_box((front - 0.005, tall - 0.005, 0.018), 0.0025, 2, grain=0)
            fronts.append(box.with_uv(0.23 * row + 0.4 * column, 0.21 * row).translated(x, y, depth / 2.0 - 0.010))
            knobs += [
                knob.rotated("x", 90.0).translated(x + s * front * 0.26, y + 0.01, depth / 2.0 - 0.001)
                for s in (-1.0, 1.0)
            ]
        bottom += tall
    top, foot = (width / 2 - 0.07, 0.145, depth / 2 - 0.06), (width / 2 - 0.05, 0.0, depth / 2 - 0.045)
    legs = four_legs(top, foot, circle(0.022, 16))
    return make_model(
        name,
        "chest of drawers",
        ("Case", "Oak", [*case, *legs]),
        ("Drawers", "Oak", fronts),
        ("Knobs", "Brass", knobs),
    )


def bench(name: str, width: float = 1.10) -> Model:
    """Build an upholstered bench, 0.44 m high, on splayed oak legs."""
    seat = cushion(width, 0.10, 0.38, 320, 0.014, 0.032).translated(0.0, 0.395, 0.0)
    frame = [rounded_box((width - 0.05, 0.045, 0.020), 0.004).translated(0.0, 0.325, z) for z in (-0.15, 0.15)]
    frame += [
        rounded_box((0.020, 0.045, 0.30), 0.004).translated(x * (width / 2 - 0.035), 0.325, 0.0) for x in (-1.0, 1.0)
    ]
    frame += four_legs((width / 2 - 0.06, 0.345, 0.145), (width / 2 - 0.025, 0.0, 0.175), circle(0.019, 16))
    return make_model(name, "bench", ("Seat", "Oatmeal", seat), ("Frame", "Oak", frame))


def standing_mirror(name: str, width: float = 0.60, height: float = 0.80) -> Model:
    """Build a framed mirror with round corners, facing +z from the wall at z = 0, about its center."""
    corner = 0.09
    outline = rectangle(width, height, corner, 10)
    path = np.insert(outline, 2, 0.013, axis=1)
    rim = sweep(path, rectangle(0.018, 0.026, 0.004), up=(0.0, 0.0, 1.0), closed=True)
    whole = make_model(name, "mirror", ("Rim", "Oak", rim), ("Glass", "MirrorSilver", plate(outline * 0.985, 0.016)))
    return whole.with_proxies(Rim=rounded_box((width + 0.018, height + 0.018, 0.014)).translated(0.0, 0.0, 0.007))


def plate(outline: Array, z: float) -> PolygonMesh:
    """Build a flat convex face at z, facing +z, as a fan of rings about its middle."""
    ring = np.insert(np.concatenate([outline, outline[:1]]), 2, z, axis=1)
    points = np.stack([ring, 0.5 * ring + (0.0, 0.0, 0.5 * z), np.tile((0.0, 0.0, z), (len(ring), 1))])
    mesh = grid(points, points[..., :2])
    return mesh if mesh.normals[:, 2].mean() > 0.0 else mesh.reversed()


def glass_of_water(name: str) -> Model:
    """Build a tumbler, 0.10 m, of thick glass, two thirds full."""
    outside = fillet([[0.0, 0.0], [0.030, 0.0], [0.036, 0.10]], 0.005, 3)
    glass = shell(np.concatenate([outside[:-1], np.linspace(outside[-2], outside[-1], 8)[1:]]), 0.0022, 40)
    return make_model(name, "glass", ("Glass", "ClearGlass", glass))
