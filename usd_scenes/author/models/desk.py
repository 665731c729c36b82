# SPDX-License-Identifier: Apache-2.0
"""Desk objects: cellphone, pen, alarm clock, cardboard box, waste bin."""

from __future__ import annotations

import numpy as np

from usd_scenes.author.implicit import Field, surface
from usd_scenes.author.model import Model, make_model
from usd_scenes.author.polygon_mesh import Array, PolygonMesh, grid, merged
from usd_scenes.author.shapes import circle, curve, cylinder, fillet, lathe, rectangle, rounded_box, sphere, sweep
from usd_scenes.author.sheets import plate, unit_uv
from usd_scenes.author.soft import wrinkles


def cellphone(name: str) -> Model:
    """Build a cellphone on its back, 0.0715 × 0.147 m, its screen lit, three lenses behind."""
    width, length, thick = 0.0715, 0.147, 0.0078
    body = plate(rectangle(width, length, 0.011, 8), thick, 0.0024, 4)
    glass = plate(rectangle(width - 0.0030, length - 0.0030, 0.0098, 8), 0.0006, 0.0003, 2).translated(
        0.0, thick - 0.0003
    )
    right, top = (width - 0.0068) / 2.0, (length - 0.0068) / 2.0
    outline = rectangle(2.0 * right, 2.0 * top, 0.0080, 8)
    display = plate(outline, 0.0002, 0.0).translated(0.0, thick + 0.0002)
    display = unit_uv(display, (-right, top), (right, -top))
    island = (
        plate(rectangle(0.032, 0.034, 0.008, 6), 0.0016, 0.0006).rotated("z", 180.0).translated(-0.0165, 0.0006, -0.053)
    )
    lenses, rings = [], []
    for x, z in ((-0.0245, -0.0608), (-0.0245, -0.0452), (-0.0090, -0.0530)):
        rings.append(cylinder(0.0066, 0.0020, 0.0005, 28).translated(x, -0.0014, z))
        lenses.append(cylinder(0.0052, 0.0006, 0.0002, 28).translated(x, -0.0022, z))
    camera = cylinder(0.0016, 0.0004, 0.0001, 16).translated(0.0, thick + 0.00025, -0.064)
    buttons = [
        rounded_box((0.0012, 0.0030, span), 0.0006, 2).translated(side * (width / 2.0 + 0.0001), thick / 2.0, z)
        for side, z, span in ((1.0, -0.026, 0.017), (-1.0, -0.034, 0.010), (-1.0, -0.019, 0.010))
    ]
    return make_model(
        name,
        "cellphone",
        ("Case", "PhoneCase", [body, island, *rings]),
        ("Glass", "ScreenOff", [glass, *lenses, camera]),
        ("Display", "PhoneScreen", display),
        ("Buttons", "Aluminium", buttons),
    )


def pen(name: str) -> Model:
    """Build a retractable ball pen along z, 0.142 m, its point towards -z, its clip up."""
    radius = 0.0052

    def lathed(profile: list[list[float]], rounding: float = 0.0004) -> PolygonMesh:
        """Build a surface of revolution about z from a profile from -z to +z."""
        return lathe(fillet(profile, rounding, 2), 28).rotated("x", 90.0).translated(0.0, radius, 0.0)

    tip = lathed(
        [[0.0, -0.0710], [0.0005, -0.0708], [0.0011, -0.0680], [0.0016, -0.0660], [0.0042, -0.0530], [0.0042, -0.0500]]
    )
    grip = lathed(
        [[0.0042, -0.0505], [0.0050, -0.0500], [0.0052, -0.0300], [0.0049, -0.0160], [0.0047, -0.0150]], 0.002
    )
    ribs = [
        lathed([[0.0048, z], [0.00545, z + 0.0006], [0.00545, z + 0.0016], [0.0048, z + 0.0022]])
        for z in np.arange(-0.046, -0.020, 0.0040)
    ]
    ring = lathed([[0.0046, -0.0155], [0.0054, -0.0152], [0.0054, -0.0128], [0.0046, -0.0125]])
    barrel = lathed(
        [[0.0046, -0.0130], [0.0051, -0.0126], [0.0052, 0.0200], [0.0047, 0.0560], [0.0036, 0.0600], [0.0, 0.0602]],
        0.0012,
    )
    button = lathed([[0.0026, 0.0590], [0.0026, 0.0690], [0.0018, 0.0710], [0.0, 0.0712]], 0.0008)
    arc = curve(
        [
            [0.0, 2.0 * radius - 0.0006, 0.0560],
            [0.0, 2.0 * radius + 0.0022, 0.0530],
            [0.0, 2.0 * radius + 0.0020, 0.0400],
            [0.0, 2.0 * radius + 0.0002, 0.0170],
            [0.0, 2.0 * radius + 0.0010, 0.0140],
        ],
        16,
    )
    clip = sweep(
        arc, rectangle(0.0040, 0.0011, 0.0004, 2), np.stack([np.linspace(1.15, 0.8, 16), np.ones(16)], -1), bevel=0.0004
    )
    collar = lathed([[0.0044, 0.0530], [0.0052, 0.0534], [0.0050, 0.0570], [0.0042, 0.0574]])
    return make_model(
        name,
        "pen",
        ("Barrel", "PenBlue", [barrel, button]),
        ("Metal", "Steel", [tip, ring, clip, collar]),
        ("Grip", "Grip", [grip, *ribs]),
    )


def alarm_clock(name: str) -> Model:
    """Build a twin-bell alarm clock, 0.16 m, its dial towards +z: ten past ten."""
    lift = 0.072

    def lathed(profile: list[list[float]], rounding: float = 0.002, segments: int = 64) -> PolygonMesh:
        return lathe(fillet(profile, rounding, 3), segments).rotated("x", 90.0).translated(0.0, lift, 0.0)

    drum = lathed([[0.0, -0.026], [0.044, -0.026], [0.055, -0.016], [0.055, 0.017], [0.050, 0.0175]], 0.004)
    bezel = lathed(
        [[0.0495, 0.014], [0.0562, 0.0145], [0.0562, 0.0205], [0.0500, 0.0235], [0.0480, 0.0170], [0.0480, 0.0140]],
        0.0012,
    )
    dial = lathed([[0.0490, 0.0150], [0.0, 0.0150]], 0.0)
    marks: list[PolygonMesh] = []
    for hour in range(60):
        long = hour % 5 == 0
        size = (0.0022, 0.0075, 0.0006) if long else (0.0007, 0.0026, 0.0005)
        bar = rounded_box(size, 0.0002).translated(0.0, 0.0425 - size[1] / 2.0 + 0.002, 0.0152)
        marks.append(bar.rotated("z", -6.0 * hour).translated(0.0, lift))
    hands = [
        _hand(0.0260, 0.0034, 0.0160).rotated("z", -305.0),
        _hand(0.0370, 0.0026, 0.0168).rotated("z", -60.0),
        cylinder(0.0034, 0.0030, 0.0006, 24).rotated("x", 90.0).translated(0.0, 0.0, 0.0168),
    ]
    alarm = _hand(0.0240, 0.0014, 0.0155).rotated("z", -180.0).translated(0.0, lift)
    dome = curve([[0.030, 0.0], [0.0292, 0.008], [0.0235, 0.0180], [0.0120, 0.0240], [0.0, 0.0258]], 18)
    bell = lathe(np.concatenate([[[0.0, 0.002], [0.0285, 0.0005]], dome]), 48)
    cap = sphere(0.0042, 20).translated(0.0, 0.0275)
    post = cylinder(0.0032, 0.018, 0.0005, 16).translated(0.0, -0.006)
    bells = [
        merged([bell, cap, post]).rotated("z", -33.0 * side).translated(0.0345 * side, lift + 0.0545, 0.0)
        for side in (-1.0, 1.0)
    ]
    angle = np.linspace(-0.98, 0.98, 24)
    arch = np.stack([0.056 * np.sin(angle) * 0.62, 0.049 + 0.050 * np.cos(angle), 0.0 * angle], -1)
    handle = sweep(arch + np.array((0.0, lift, 0.0)), circle(0.0024, 12), up=(0.0, 0.0, 1.0), bevel=0.001)
    hammer = [
        sweep([[0.0, lift + 0.050, 0.0], [0.0, lift + 0.076, 0.0]], circle(0.0015, 10), up=(0.0, 0.0, 1.0), bevel=0.0),
        rounded_box((0.018, 0.0085, 0.0085), 0.003, 3).translated(0.0, lift + 0.076, 0.0),
    ]
    feet = [
        sweep(
            [[0.026 * side, lift - 0.046, 0.0], [0.041 * side, 0.004, 0.0]],
            circle(0.0042, 14),
            [1.0, 0.8],
            up=(0.0, 0.0, 1.0),
        )
        for side in (-1.0, 1.0)
    ]
    feet += [sphere(0.0062, 20).translated(0.042 * side, 0.0062, 0.0) for side in (-1.0, 1.0)]
    feet.append(sweep([[0.0, lift - 0.040, -0.022], [0.0, 0.004, -0.034]], circle(0.0036, 12), up=(1.0, 0.0, 0.0)))
    key = [
        cylinder(0.003, 0.012, 0.0005, 14).rotated("x", 90.0).translated(0.0, lift, -0.031),
        rounded_box((0.024, 0.011, 0.003), 0.0014, 2).translated(0.0, lift, -0.037),
        *(
            cylinder(0.005, 0.010, 0.001, 20).rotated("x", 90.0).translated(x, lift - 0.022, -0.029)
            for x in (-0.02, 0.02)
        ),
    ]
    return make_model(
        name,
        "alarm clock",
        ("Case", "EnamelRed", drum),
        ("Bells", "Steel", [bezel, *bells, handle, *hammer, *feet, *key]),
        ("Dial", "Paper", dial),
        ("Marks", "BlackPlastic", [*marks, *(hand.translated(0.0, lift) for hand in hands)]),
        ("AlarmHand", "RedButton", alarm),
    ).with_proxies(
        Case=cylinder(0.055, 0.040).rotated("x", 90.0).translated(0.0, lift, -0.006),
        Bells=[*bells, *hammer, *feet, *key],
        Marks=[hand.translated(0.0, lift) for hand in hands],
    )


def _hand(length: float, width: float, level: float) -> PolygonMesh:
    """Build a clock's hand that points to twelve, with a short tail."""
    outline = [
        [-width / 2.0, 0.006],
        [0.0, 0.010],
        [width / 2.0, 0.006],
        [width * 0.3, -length],
        [-width * 0.3, -length],
    ]
    return plate(outline[::-1], 0.0005, 0.0001, 1).rotated("x", 90.0).translated(0.0, 0.0, level)


def cardboard_box(name: str) -> Model:
    """Build a parcel, 0.40 × 0.26 × 0.30 m: two flaps under brown tape, with printed arrows and a glass."""
    width, height, depth = 0.40, 0.26, 0.30
    body = rounded_box((width, height - 0.004, depth), 0.004, 2, (8, 6, 8), grain=0)

    def bulge(points: Array) -> Array:
        q = points / (width / 2.0, height / 2.0, depth / 2.0)
        swell = 0.004 * np.stack(
            [(1 - q[:, 1] ** 2) * (1 - q[:, 2] ** 2), 0.0 * q[:, 0], (1 - q[:, 0] ** 2) * (1 - q[:, 1] ** 2)], -1
        ).clip(0.0)
        return np.asarray(points + np.sign(q) * swell + 0.0008 * wrinkles(points, 7, 0.2)[:, None])

    carton = [body.deformed(bulge).translated(0.0, (height - 0.004) / 2.0)]
    for side in (-1.0, 1.0):
        flap = rounded_box((width - 0.003, 0.004, depth / 2.0 - 0.003), 0.0015, 2, (6, 1, 4), grain=0)

        def lift(points: Array, side: float = side) -> Array:
            bent = points.copy()
            reach = (0.5 - side * points[:, 2] / (depth / 2.0)).clip(0.0)
            bent[:, 1] += 0.005 * reach**2 * (1.0 + side * 0.5 * points[:, 0] / width)
            return bent

        carton.append(flap.deformed(lift).translated(0.0, height - 0.001, side * depth / 4.0))
    top, x, low = height + 0.0062, width / 2.0 + 0.0018, height - 0.075
    path = curve([[-x, low, 0.0], [-x - 0.0003, height - 0.02, 0.0]], 6)
    corner = [[-x + 0.0004, height - 0.004, 0.0], [-x + 0.010, top - 0.003, 0.0], [-x + 0.05, top, 0.0]]
    half = np.concatenate([path, corner])
    line = np.concatenate([half, [[0.0, top - 0.0005, 0.0]], half[::-1] * (-1.0, 1.0, 1.0)])
    tape = sweep(line, rectangle(0.0005, 0.050, 0.0001, 1), up=(0.0, 0.0, 1.0), bevel=0.0)
    front = depth / 2.0 + 0.0030
    print_ = [_arrow().translated(x_, 0.045, front) for x_ in (0.095, 0.145)]
    print_.append(rounded_box((0.095, 0.006, 0.0008), 0.0002).translated(0.120, 0.038, front))
    label = rounded_box((0.130, 0.085, 0.0008), 0.0003).translated(-0.095, 0.125, front + 0.0007)
    lines = [
        rounded_box((span, 0.0045, 0.0004), 0.0001).translated(-0.150 + span / 2.0, y, front + 0.0013)
        for y, span in ((0.152, 0.070), (0.141, 0.100), (0.130, 0.085))
    ]
    rng = np.random.default_rng(5)
    at = -0.150
    while at < -0.045:
        bar = float(rng.choice([0.0008, 0.0016, 0.0026]))
        lines.append(rounded_box((bar, 0.022, 0.0004), 0.0001).translated(at + bar / 2.0, 0.103, front + 0.0013))
        at += bar + float(rng.choice([0.0010, 0.0018, 0.0026]))
    return make_model(
        name,
        "box",
        ("Carton", "Cardboard", carton),
        ("Tape", "Tape", tape),
        ("Print", "BlackPlastic", [*print_, *lines]),
        ("Label", "Paper", label),
    )


def _arrow() -> PolygonMesh:
    """Build a "this side up" arrow, 0.06 m."""
    head = plate([[-0.017, 0.0], [0.0, -0.022], [0.017, 0.0]], 0.0008, 0.0001, 1).rotated("x", 90.0)
    shaft = rounded_box((0.014, 0.036, 0.0008), 0.0002).translated(0.0, 0.018, 0.0004)
    return merged([head.translated(0.0, 0.036, 0.0), shaft])


def recycle_bin(name: str) -> Model:
    """Build a tapered bin, 0.32 m, with a recycling sign on it and crumpled paper inside."""
    height, wall = 0.32, 0.003
    low, high, corner = (0.185, 0.135), (0.265, 0.205), 0.035
    levels = [
        (0.0, 0.94),
        (0.004, 0.985),
        (0.012, 1.0),
        (height - 0.018, 1.0),
        (height - 0.014, 1.035),
        (height - 0.004, 1.045),
        (height, 1.03),
    ]

    def ring(y: float, gain: float, inset: float) -> Array:
        t = y / height
        size = [(a + (b - a) * t) * gain - 2.0 * inset for a, b in zip(low, high, strict=True)]
        outline = rectangle(size[0], size[1], corner * (0.8 + 0.3 * t) - inset, 6)
        return np.insert(outline * (1.0, -1.0), 1, y, axis=1)

    rings = [np.tile((0.0, 0.0, 0.0), (len(ring(0.0, 1.0, 0.0)), 1))]
    rings += [ring(y, gain, 0.0) for y, gain in levels]
    rings += [ring(max(y, 0.008), gain, wall) for y, gain in levels[::-1][:-1]]
    rings.append(np.tile((0.0, 0.008, 0.0), (len(rings[0]), 1)))
    points = np.stack(rings)
    points = np.concatenate([points, points[:, :1]], axis=1)
    u = np.linspace(0.0, 0.8, points.shape[1])[None] + 0.0 * points[..., 0]
    bin_ = grid(points, np.stack([u, points[..., 1]], -1), closed=True)
    tilt = float(np.degrees(np.arctan2((high[1] - low[1]) / 2.0, height)))
    middle = (low[1] + (high[1] - low[1]) * 0.55) / 2.0
    sign = merged([_recycling_arrow().rotated("z", 120.0 * k) for k in range(3)])
    signs = [
        sign.translated(0.0, 0.0, 0.0002).rotated("x", tilt).translated(0.0, 0.55 * height, middle).rotated("y", yaw)
        for yaw in (0.0, 180.0)
    ]
    balls = [
        _crumpled(0.048 + 0.006 * k, 20 + k).translated(x, y, z)
        for k, (x, y, z) in enumerate(((-0.055, 0.235, 0.02), (0.05, 0.228, -0.03), (0.01, 0.262, 0.035)))
    ]
    fill = [_crumpled(0.055, 30 + k).translated(x, 0.17, z) for k, (x, z) in enumerate(((-0.045, -0.02), (0.04, 0.02)))]
    return make_model(
        name,
        "recycle bin",
        ("Bin", "BinBlue", bin_),
        ("Sign", "WhitePlastic", signs),
        ("Paper", "Paper", [*balls, *fill]),
    )


def _recycling_arrow() -> PolygonMesh:
    """Build one of the three arrows of a recycling sign of about 0.12 m, in the xy plane, 0.6 mm thick."""
    width = 0.0085
    corner = np.radians(90.0)
    start = 0.038 * np.array([np.cos(corner + 0.62), np.sin(corner + 0.62)])
    bend = 0.058 * np.array([np.cos(corner), np.sin(corner)])
    end = 0.030 * np.array([np.cos(corner - 0.95), np.sin(corner - 0.95)])
    line = fillet([start, bend, end], 0.016, 6)
    tangent = np.gradient(line, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.stack([-tangent[:, 1], tangent[:, 0]], -1) * width
    points = np.stack([np.insert(line - side, 2, 0.0006, axis=1), np.insert(line + side, 2, 0.0006, axis=1)])
    band = grid(points, points[..., :2])
    along, across = tangent[-1], np.array([-tangent[-1][1], tangent[-1][0]])
    tip = np.stack([line[-1] - 1.9 * width * across, line[-1] + 2.1 * width * along, line[-1] + 1.9 * width * across])
    head = grid(
        np.insert(np.stack([np.stack([tip[0], tip[1]]), np.stack([tip[2], tip[1]])]), 2, 0.0007, axis=2),
        np.zeros((2, 2, 2)),
    )
    return merged([band, head])


def _crumpled(radius: float, seed: int) -> PolygonMesh:
    """Build a crumpled sheet of paper: flat facets between sharp creases."""
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(46, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    offsets = radius * rng.uniform(0.80, 1.0, 46)
    dents = rng.normal(size=(12, 3))
    dents *= radius * rng.uniform(1.05, 1.2, (12, 1)) / np.linalg.norm(dents, axis=1, keepdims=True)

    def folded(points: Array) -> Array:
        outside = (points @ normals.T - offsets).max(axis=1)
        nearest = np.linalg.norm(points[:, None] - dents, axis=-1).min(axis=1)
        return np.asarray(np.maximum(outside, 0.32 * radius - nearest))

    field: Field = folded
    return surface(field, [-1.1 * radius] * 3, [1.1 * radius] * 3, radius / 8.0)
