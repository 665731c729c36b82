# SPDX-License-Identifier: Apache-2.0
"""Furniture and belongings of an entrance hall. Each stands on y = 0 and faces +z."""

from __future__ import annotations

import numpy as np

from usd_scenes.author.model import Model, make_model
from usd_scenes.author.models.bedroom import plate
from usd_scenes.author.models.tableware import dense
from usd_scenes.author.polygon_mesh import Array, PolygonMesh, grid, merged
from usd_scenes.author.shapes import (
    circle,
    curve,
    cylinder,
    fillet,
    four_legs,
    lathe,
    rectangle,
    rounded_box,
    sphere,
    sweep,
)
from usd_scenes.author.soft import cloth_back, wrinkles


def coat_rack(name: str) -> Model:
    """Build a bentwood coat stand, 1.78 m, with six hooks above and a felt hat on one of them."""
    pole = lathe(curve([[0.021, 0.10], [0.020, 0.60], [0.018, 1.20], [0.017, 1.66], [0.0, 1.665]], 30), 32)
    knob = lathe(curve([[0.0, 1.655], [0.018, 1.662], [0.026, 1.69], [0.017, 1.715], [0.0, 1.722]], 24), 36)
    legs, hooks = [], []
    for turn in np.arange(4) * 90.0 + 45.0:
        foot = curve(
            [
                [0.012, 0.46, 0.0],
                [0.030, 0.34, 0.0],
                [0.055, 0.20, 0.0],
                [0.13, 0.085, 0.0],
                [0.24, 0.035, 0.0],
                [0.27, 0.014, 0.0],
            ],
            36,
        )
        legs.append(sweep(foot, circle(0.0135, 16), up=(0.0, 0.0, 1.0), bevel=0.005).rotated("y", float(turn)))
    for turn in np.arange(6) * 60.0:
        arm = curve(
            [
                [0.012, 1.36, 0.0],
                [0.05, 1.43, 0.0],
                [0.115, 1.50, 0.0],
                [0.165, 1.57, 0.0],
                [0.180, 1.66, 0.0],
                [0.155, 1.735, 0.0],
            ],
            36,
        )
        hooks.append(
            sweep(arm, circle(0.0105, 14), np.linspace(1.0, 0.8, 36), up=(0.0, 0.0, 1.0), bevel=0.004).rotated(
                "y", float(turn)
            )
        )
        low = curve([[0.014, 1.27, 0.0], [0.055, 1.245, 0.0], [0.095, 1.265, 0.0], [0.105, 1.31, 0.0]], 24)
        hooks.append(sweep(low, circle(0.009, 14), up=(0.0, 0.0, 1.0), bevel=0.004).rotated("y", float(turn) + 30.0))
    ring = sweep(np.insert(circle(0.152, 72), 1, 0.145, axis=1), circle(0.0105, 14), closed=True)
    return make_model(
        name,
        "coat rack",
        ("Pole", "Walnut", [pole, knob]),
        ("Hooks", "Walnut", hooks),
        ("Legs", "Walnut", [*legs, ring]),
    )


def hat(name: str) -> Model:
    """Build a felt hat with a ribbon, 0.33 m across, lying on its brim."""
    profile = curve(
        [
            [0.165, 0.012],
            [0.130, 0.004],
            [0.098, 0.008],
            [0.093, 0.030],
            [0.091, 0.080],
            [0.078, 0.112],
            [0.040, 0.117],
            [0.0, 0.100],
        ],
        44,
    )
    felt = lathe(np.concatenate([(profile[::-1] - (0.003, 0.004)).clip(0.0), profile]), 72).scaled(1.0, 1.0, 1.18)
    band = lathe(fillet([[0.0945, 0.012], [0.0975, 0.014], [0.0955, 0.042], [0.0925, 0.043]], 0.001, 2), 72).scaled(
        1.0, 1.0, 1.18
    )
    return make_model(name, "hat", ("Felt", "Felt", felt), ("Ribbon", "BlackMetal", band))


def coat(name: str, material: str, seed: int, width: float = 0.44, length: float = 0.98) -> Model:
    """Build a coat that hangs by its collar at the origin, its back to z = 0, its sleeves beside it."""
    rows, columns = 34, 65
    t = np.linspace(0.0, 1.0, rows)[:, None]
    angle = np.linspace(0.0, 2.0 * np.pi, columns)[None, :]
    half = width / 2.0 * np.interp(t, [0.0, 0.04, 0.16, 0.32, 1.0], [0.20, 0.36, 0.94, 0.86, 1.10])
    deep = np.interp(t, [0.0, 0.04, 0.16, 0.4, 1.0], [0.045, 0.055, 0.085, 0.090, 0.115])
    side, front = np.sin(angle), np.cos(angle)
    fold = np.sin(9.0 * angle + seed) + 0.6 * np.sin(14.0 * angle + 2.1 * seed + 3.0 * t)
    swell = 1.0 + 0.075 * fold * t**0.8
    points = np.zeros((rows, columns, 3))
    points[..., 0] = half * np.sign(side) * np.abs(side) ** 0.9 * swell
    points[..., 2] = deep * (1.05 + np.sign(front) * np.abs(front) ** 0.8 * swell)
    points[..., 1] = (
        0.01 - length * t + 0.0 * angle - 0.07 * np.abs(side) * np.exp(-t * 9.0) * (1.0 - np.exp(-t * 60.0))
    )
    flat = points.reshape(-1, 3)
    flat += 0.004 * wrinkles(flat, seed, 0.18)[:, None] * np.array([0.4, 0.0, 1.0])
    points[:, -1] = points[:, 0]
    cut = np.abs(angle - np.pi)  # the opening in front would be at angle 0
    uv = np.stack(np.broadcast_arrays(cut * half, length * (1.0 - t)), axis=-1)
    body = grid(points[::-1], uv[::-1], closed=True)
    sleeves = []
    for s in (-1.0, 1.0):
        line = curve(
            [
                [s * 0.165, -0.120, 0.085],
                [s * 0.222, -0.175, 0.088],
                [s * 0.246, -0.36, 0.100],
                [s * 0.250, -0.54, 0.115],
                [s * 0.244, -0.68, 0.128],
            ],
            26,
        )
        girth = np.stack([np.linspace(1.0, 0.92, 26), np.linspace(1.0, 0.86, 26)], axis=-1)
        tube = sweep(line, circle(0.062, 24) * (0.72, 1.0), girth, up=(0.0, 0.0, 1.0), bevel=0.006)
        sleeves.append(
            tube.deformed(
                lambda p: p + 0.004 * wrinkles(p * (1.0, 2.2, 1.0), seed + 3, 0.11)[:, None] * np.array([1.0, 0.0, 1.0])
            )
        )
    collar_line = curve(
        [
            [-0.070, -0.010, 0.075],
            [-0.060, 0.012, 0.040],
            [0.0, 0.022, 0.020],
            [0.060, 0.012, 0.040],
            [0.070, -0.010, 0.075],
            [0.052, -0.060, 0.120],
        ],
        30,
    )
    collar = sweep(collar_line, rectangle(0.014, 0.062, 0.006, 3), up=(0.0, 1.0, 0.0), bevel=0.004)
    back = collar_line * (-1.0, 1.0, 1.0)
    collar2 = sweep(back[20:], rectangle(0.014, 0.062, 0.006, 3), up=(0.0, 1.0, 0.0), bevel=0.004)
    buttons = [
        cylinder(0.011, 0.006, 0.002, 20).rotated("x", 90.0).translated(0.028, y, 0.196 + 0.03 * -y)
        for y in (-0.24, -0.38, -0.52, -0.66)
    ]
    return make_model(
        name, "coat", ("Cloth", material, [body, *sleeves, collar, collar2]), ("Buttons", "BlackPlastic", buttons)
    )


def umbrella(length: float, seed: int) -> dict[str, PolygonMesh]:
    """Build a rolled umbrella on its tip at the origin, `length` m high: its cloth, shaft and cane."""
    t = np.linspace(0.0, 1.0, 20)[:, None]
    angle = np.linspace(0.0, 2.0 * np.pi, 65)[None, :]
    radius = np.interp(t, [0.0, 0.06, 0.5, 0.93, 1.0], [0.006, 0.011, 0.024, 0.031, 0.026])
    pleat = 1.0 + 0.20 * np.sin(8.0 * angle + 5.0 * t + seed) * np.minimum(1.0, 6.0 * t)
    points = np.stack(
        [radius * pleat * np.sin(angle), 0.07 + 0.66 * length * t + 0.0 * angle, radius * pleat * np.cos(angle)],
        axis=-1,
    )
    points[:, -1] = points[:, 0]
    cloth = grid(points, points[..., :2], closed=True)
    strap = lathe(fillet([[0.028, 0.0], [0.0315, 0.002], [0.0315, 0.018], [0.028, 0.020]], 0.001, 2), 40)
    top = 0.07 + 0.66 * length
    shaft = [
        sweep([[0.0, 0.0, 0.0], [0.0, 0.09, 0.0]], circle(0.0042, 12), up=(0.0, 0.0, 1.0)),
        sweep([[0.0, top - 0.03, 0.0], [0.0, length - 0.10, 0.0]], circle(0.0065, 14), up=(0.0, 0.0, 1.0)),
    ]
    bend = curve(
        [
            [0.0, length - 0.13, 0.0],
            [0.0, length - 0.045, 0.0],
            [0.018, length - 0.008, 0.0],
            [0.052, length, 0.0],
            [0.086, length - 0.014, 0.0],
            [0.100, length - 0.05, 0.0],
            [0.099, length - 0.075, 0.0],
        ],
        40,
    )
    cane = sweep(bend, circle(0.0115, 18), up=(0.0, 0.0, 1.0), bevel=0.004)
    return {"Cloth": merged([cloth, strap.translated(0.0, 0.07 + 0.50 * length)]), "Metal": merged(shaft), "Wood": cane}


def umbrella_stand(name: str) -> Model:
    """Build a ribbed metal stand, 0.24 m across and 0.52 m high, with two umbrellas in it."""
    r, h = 0.115, 0.52
    wires = [
        sweep(
            [[r * np.sin(a), 0.015, r * np.cos(a)], [r * np.sin(a), h, r * np.cos(a)]],
            circle(0.0035, 8),
            up=(np.cos(a), 0.0, -np.sin(a)),
        )
        for a in np.arange(20) * 2.0 * np.pi / 20
    ]
    hoops = [sweep(np.insert(circle(r, 64), 1, y, axis=1), circle(0.0065, 12), closed=True) for y in (0.012, 0.27, h)]
    tray = lathe(
        fillet(
            [[0.0, 0.0], [r - 0.004, 0.0], [r + 0.002, 0.022], [r - 0.004, 0.022], [r - 0.010, 0.008], [0.0, 0.006]],
            0.002,
            2,
        ),
        56,
    )
    groups: dict[str, list[PolygonMesh]] = {}
    for index, (turn, lean, x, z, size) in enumerate(
        ((60.0, 7.5, -0.045, -0.030, 0.90), (215.0, 8.5, 0.035, 0.045, 0.86))
    ):
        for part, mesh in umbrella(size, 3 * index).items():
            groups.setdefault(f"{part}{index}", []).append(
                mesh.rotated("y", 40.0 * index).rotated("z", lean).rotated("y", turn).translated(x, 0.010, z)
            )
    return make_model(
        name,
        "umbrella stand",
        ("Stand", "BlackMetal", [*wires, *hoops, tray]),
        ("UmbrellaA", "UmbrellaNavy", groups["Cloth0"]),
        ("UmbrellaB", "UmbrellaWine", groups["Cloth1"]),
        ("Shafts", "Steel", groups["Metal0"] + groups["Metal1"]),
        ("Canes", "Walnut", groups["Wood0"] + groups["Wood1"]),
    )


def suitcase(name: str) -> Model:
    """Build a ribbed hard-shell suitcase on four wheels, 0.40 × 0.62 × 0.25 m, its handle pushed in."""
    w, h, d, foot = 0.40, 0.555, 0.24, 0.048
    shells = []
    for side in (-1.0, 1.0):
        half = rounded_box((w, h, d / 2.0 - 0.004), 0.034, 3, (44, 3, 1))

        def ribs(points: Array, side: float = side) -> Array:
            """Press ribs into the broad face."""
            bent = points.copy()
            face = np.clip((side * points[:, 2] - 0.02) / 0.03, 0.0, 1.0)
            inside = np.clip((w / 2.0 - 0.035 - np.abs(points[:, 0])) / 0.02, 0.0, 1.0)
            ridge = np.cos(points[:, 0] * 2.0 * np.pi / 0.045)
            bent[:, 2] += side * 0.0038 * np.tanh(3.0 * ridge) * face * inside
            return bent

        shells.append(half.deformed(ribs).translated(0.0, foot + h / 2.0, side * (d / 4.0)))
    seam = rounded_box((w - 0.004, h - 0.004, 0.012), 0.0055, 3).translated(0.0, foot + h / 2.0)
    rubber, metal = [seam], []
    for x in (-0.155, 0.155):
        for z in (-0.082, 0.082):
            rubber.append(cylinder(0.024, 0.020, 0.004, 28).rotated("z", 90.0).translated(x, 0.024, z))
            rubber.append(rounded_box((0.034, 0.034, 0.034), 0.008, 3).translated(x, foot + 0.004, z))
    handle = curve(
        [
            [-0.075, foot + h - 0.006, 0.0],
            [-0.068, foot + h + 0.018, 0.0],
            [0.0, foot + h + 0.026, 0.0],
            [0.068, foot + h + 0.018, 0.0],
            [0.075, foot + h - 0.006, 0.0],
        ],
        24,
    )
    rubber.append(sweep(handle, rectangle(0.024, 0.013, 0.005, 3), up=(0.0, 0.0, 1.0), bevel=0.003))
    metal += [
        rounded_box((0.032, 0.020, 0.052), 0.004, 3).translated(x, foot + h - 0.006, 0.0) for x in (-0.075, 0.075)
    ]
    metal.append(rounded_box((0.014, 0.075, 0.042), 0.005, 3).translated(w / 2.0 - 0.004, foot + 0.62 * h, 0.0))
    bar = [rounded_box((0.19, 0.022, 0.026), 0.008, 3).translated(0.0, foot + h + 0.012, -0.088)]
    bar += [
        rounded_box((0.020, 0.03, 0.020), 0.004, 2).translated(x, foot + h - 0.004, -0.088) for x in (-0.080, 0.080)
    ]
    return make_model(
        name,
        "suitcase",
        ("Shell", "ShellTeal", shells),
        ("Rubber", "BlackPlastic", [*rubber, *bar]),
        ("Locks", "Steel", metal),
    )


def arched_mirror(name: str, width: float = 0.62, height: float = 1.10) -> Model:
    """Build a mirror with a round top in an oak frame, its back on z = 0, its lower edge on y = 0."""
    r = width / 2.0
    angle = np.linspace(0.0, np.pi, 49)
    arch = np.stack([r * np.cos(angle), height - r + r * np.sin(angle)], axis=-1)
    outline = np.concatenate([[[r, 0.0]], arch, [[-r, 0.0]]])
    line = dense(np.concatenate([outline, outline[:1]]), 0.08)[:-1]
    frame = sweep(np.insert(line, 2, 0.014, axis=1), rectangle(0.030, 0.026, 0.005, 3), up=(0.0, 0.0, 1.0), closed=True)
    glass = plate(outline - (0.0, height / 2.0), 0.010).translated(0.0, height / 2.0)
    sides = [rounded_box((0.03, height - r, 0.026)).translated(x * r, (height - r) / 2.0, 0.014) for x in (-1.0, 1.0)]
    return make_model(name, "mirror", ("Frame", "Oak", frame), ("Glass", "MirrorSilver", glass)).with_proxies(
        Frame=sides
    )


def console(name: str, width: float = 1.00) -> Model:
    """Build a narrow oak table with two drawers and a shelf, 1.00 × 0.80 × 0.32 m, its back on z = 0."""
    d, h = 0.32, 0.80
    top = rounded_box((width, 0.026, d), 0.005, 2).translated(0.0, h - 0.013, d / 2.0)
    case = rounded_box((width - 0.06, 0.125, d - 0.04), 0.003).translated(0.0, h - 0.088, d / 2.0)
    fronts = [
        rounded_box(((width - 0.08) / 2.0, 0.105, 0.018), 0.004, 2)
        .with_uv(0.5 * i, 0.2)
        .translated((i - 0.5) * (width - 0.072) / 2.0, h - 0.088, d - 0.018)
        for i in range(2)
    ]
    knobs = [sphere(0.0125, 24).translated((i - 0.5) * (width - 0.072) / 2.0, h - 0.088, d + 0.004) for i in range(2)]
    legs = [
        leg.translated(0.0, 0.0, d / 2.0)
        for leg in four_legs(
            (width / 2 - 0.045, h - 0.03, d / 2 - 0.04),
            (width / 2 - 0.03, 0.0, d / 2 - 0.025),
            rectangle(0.040, 0.040, 0.006),
            0.72,
        )
    ]
    shelf = rounded_box((width - 0.07, 0.020, d - 0.06), 0.004, 2).translated(0.0, 0.17, d / 2.0)
    return make_model(
        name,
        "console table",
        ("Top", "Oak", [top, case]),
        ("Fronts", "Oak", fronts),
        ("Legs", "Oak", [*legs, shelf]),
        ("Knobs", "Brass", knobs),
    )


def doormat(name: str) -> Model:
    """Build a coir mat, 0.75 × 0.45 m, with a dark border."""
    pile = rounded_box((0.73, 0.016, 0.43), 0.005, 1, (6, 1, 4)).translated(0.0, 0.010)
    edge = rounded_box((0.75, 0.008, 0.45), 0.003, 2).translated(0.0, 0.004)
    return make_model(name, "doormat", ("Coir", "Coir", pile), ("Edge", "RubberBlack", edge))


def scarf(name: str, material: str) -> Model:
    """Build a knitted scarf that hangs over a bar along z of radius 12 mm at the origin."""
    s = np.linspace(-0.62, 0.55, 48)
    z = np.linspace(-0.085, 0.085, 13)
    radius = 0.015
    turn = np.clip(s / (np.pi / 2 * radius), -1.0, 1.0) * np.pi / 2.0
    fall = np.maximum(np.abs(s) - np.pi / 2 * radius, 0.0)
    points = np.zeros((len(z), len(s), 3))
    points[..., 0] = np.sin(turn) * (radius + 0.012 * (1.0 - np.exp(-fall * 8.0)))
    points[..., 1] = np.cos(turn) * radius - fall
    points[..., 2] = z[:, None] * (0.62 + 0.38 * np.minimum(1.0, fall / 0.5))
    points[..., 0] += np.sign(s) * 0.010 * np.sin(46.0 * z[:, None] + 2.0 * np.sign(s)) * np.minimum(1.0, fall * 5.0)
    front = grid(points, np.stack(np.broadcast_arrays(s[None], z[:, None]), axis=-1)).reversed()
    return make_model(name, "scarf", ("Knit", material, [front, cloth_back(front, 0.005)]))
