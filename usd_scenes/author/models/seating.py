# SPDX-License-Identifier: Apache-2.0
"""Seating: chairs, sofas, armchair, pouf, pillows."""

from __future__ import annotations

import numpy as np

from usd_scenes.author.model import Model, make_model
from usd_scenes.author.models.pillows import stuffed
from usd_scenes.author.polygon_mesh import Array, PolygonMesh
from usd_scenes.author.shapes import circle, curve, cylinder, lathe, leg, rectangle, rounded_box, sphere, sweep
from usd_scenes.author.sheets import shell
from usd_scenes.author.soft import cushion, pillow, throw, wrinkles


def chair(name: str) -> Model:
    """Build a dining chair, 0.90 m: turned-out legs, a dished seat, three back slats between raked posts."""
    seat = rounded_box((0.44, 0.026, 0.42), 0.010, 3, (14, 1, 14), grain=2)

    def dish(points: Array) -> Array:
        x, z = points[:, 0] / 0.22, points[:, 2] / 0.21
        bent = points.copy()
        bent[:, 0] *= 1.0 + 0.06 * z
        bent[:, 1] -= 0.010 * (1.0 - x**2).clip(0.0) * (1.0 - z**2).clip(0.0) * (points[:, 1] > 0.0)
        return bent

    legs = [
        leg([side * 0.175, 0.432, 0.165], [side * 0.200, 0.0, 0.190], rectangle(0.036, 0.036, 0.008), 0.62)
        for side in (-1.0, 1.0)
    ]
    for side in (-1.0, 1.0):
        post = curve(
            [
                [side * 0.195, 0.0, -0.235],
                [side * 0.185, 0.42, -0.185],
                [side * 0.182, 0.66, -0.200],
                [side * 0.180, 0.895, -0.262],
            ],
            14,
        )
        legs.append(
            sweep(
                post,
                rectangle(0.030, 0.038, 0.008),
                np.interp(np.linspace(0, 1, 14), [0, 0.5, 1], [0.75, 1.0, 0.72]),
                up=(0.0, 0.0, 1.0),
            )
        )
    rails = [
        rounded_box((0.345, 0.055, 0.018), 0.004).translated(0.0, 0.398, 0.170),
        rounded_box((0.345, 0.055, 0.018), 0.004).translated(0.0, 0.398, -0.180),
        rounded_box((0.018, 0.055, 0.330), 0.004).translated(-0.176, 0.398, -0.005),
        rounded_box((0.018, 0.055, 0.330), 0.004).translated(0.176, 0.398, -0.005),
        sweep([[-0.192, 0.20, 0.178], [-0.192, 0.20, -0.205]], rectangle(0.018, 0.022, 0.006)),
        sweep([[0.192, 0.20, 0.178], [0.192, 0.20, -0.205]], rectangle(0.018, 0.022, 0.006)),
    ]
    slats = [
        _slat(height, depth, tall)
        for height, depth, tall in ((0.600, -0.196, 0.045), (0.715, -0.213, 0.050), (0.850, -0.247, 0.075))
    ]
    return make_model(
        name,
        "chair",
        ("Seat", "Chestnut", seat.deformed(dish).translated(0.0, 0.437, 0.0)),
        ("Frame", "Chestnut", [*legs, *rails]),
        ("Back", "Chestnut", slats),
    )


def _slat(height: float, depth: float, tall: float) -> PolygonMesh:
    """Build a back slat, bowed backwards between the posts and raked with them."""
    slat = rounded_box((0.366, tall, 0.016), 0.005, 2, (12, 1, 1))

    def bow(points: Array) -> Array:
        bent = points.copy()
        bent[:, 2] -= 0.026 * (1.0 - (points[:, 0] / 0.183) ** 2)
        bent[:, 1] += 0.010 * (tall > 0.06) * (1.0 - (points[:, 0] / 0.183) ** 2) * (points[:, 1] > 0.0)
        return bent

    return slat.deformed(bow).rotated("x", 10.0).translated(0.0, height, depth)


def shell_chair(name: str) -> Model:
    """Build a chair of one molded shell, 0.82 m, on four splayed dowels braced with wire."""
    rows = [  # height, depth, half width, rise of the sides
        (0.425, 0.225, 0.195, 0.000),
        (0.446, 0.200, 0.205, 0.006),
        (0.445, 0.120, 0.222, 0.026),
        (0.430, 0.020, 0.232, 0.046),
        (0.425, -0.080, 0.232, 0.062),
        (0.448, -0.152, 0.228, 0.078),
        (0.510, -0.196, 0.224, 0.074),
        (0.600, -0.218, 0.215, 0.056),
        (0.700, -0.238, 0.202, 0.042),
        (0.775, -0.256, 0.178, 0.032),
        (0.815, -0.268, 0.135, 0.022),
    ]
    line = curve(rows, 44)
    s = np.linspace(-1.0, 1.0, 29)
    tangent = np.gradient(line[:, :2], axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    rise, forward = -tangent[:, 1], tangent[:, 0]  # towards the sitter
    lift = line[:, 3:] * np.abs(s)[None] ** 2.4
    points = np.zeros((44, 29, 3))
    points[..., 0] = line[:, 2:3] * np.sin(s * 1.25)[None] / np.sin(1.25)
    points[..., 1] = line[:, :1] + lift * rise[:, None]
    points[..., 2] = line[:, 1:2] + lift * forward[:, None]
    seat = shell(points, points[..., :2], 0.006)
    legs, feet = [], []
    for x in (-1.0, 1.0):
        for z, back in ((1.0, 0.165), (-1.0, -0.195)):
            foot = [0.225 * x, 0.006, back + 0.045 * z]
            legs.append(leg([0.135 * x, 0.405, 0.12 * z - 0.02], foot, circle(0.0145, 16), 0.68))
            feet.append(cylinder(0.0105, 0.010, 0.002, 16).translated(foot[0], 0.005, foot[2]))
    wires = []
    for z in (0.11, -0.13):
        wires.append(sweep([[-0.150, 0.398, z], [0.150, 0.398, z]], circle(0.005, 10)))
        wires.append(sweep([[-0.158, 0.330, 1.25 * z], [0.0, 0.392, z]], circle(0.0035, 8)))
        wires.append(sweep([[0.158, 0.330, 1.25 * z], [0.0, 0.392, z]], circle(0.0035, 8)))
    for x in (-0.140, 0.140):
        wires.append(sweep([[x, 0.398, 0.12], [x, 0.398, -0.14]], circle(0.005, 10)))
        wires.append(cylinder(0.018, 0.026, 0.003, 20).translated(0.75 * x, 0.412, 0.06))
        wires.append(cylinder(0.018, 0.030, 0.003, 20).translated(0.75 * x, 0.412, -0.09))
    return make_model(
        name,
        "chair",
        ("Shell", "ShellWhite", seat),
        ("Legs", "Oak", legs),
        ("Braces", "BlackMetal", [*wires, *feet]),
    ).with_proxies(
        Shell=[
            rounded_box((0.45, 0.03, 0.44)).translated(0.0, 0.435, 0.02),
            rounded_box((0.42, 0.38, 0.03)).rotated("x", -9.0).translated(0.0, 0.62, -0.225),
        ]
    )


def settee(name: str) -> Model:
    """Build a two-seat sofa, 1.78 m, with a pillow in either corner."""
    base = sofa(name, 1.78, 2)
    pillows = [
        stuffed(0.46, 0.13, 71 + index, 0.026)
        .rotated("x", -20.0)
        .rotated("y", -15.0 * side)
        .translated(0.50 * side, 0.715, 0.075)
        for index, side in enumerate((-1.0, 1.0))
    ]
    return make_model(
        name, "sofa", *((p.name, p.material, p.mesh) for p in base.parts), ("Pillows", "Mustard", pillows)
    )


def sofa(name: str, width: float = 2.30, seats: int = 3) -> Model:
    """Build a sofa, 0.95 m deep: loose seat and back cushions between upholstered arms, on walnut legs."""
    arm, depth, seat_height = 0.19, 0.95, 0.43
    inner = width - 2.0 * arm
    body = [_upholstered((width - 0.02, 0.20, depth - 0.04), 1).translated(0.0, 0.235, 0.0)]
    body += [
        _upholstered((arm, 0.47, depth), 2 + side).translated((width - arm) / 2.0 * side, 0.370, 0.0)
        for side in (-1, 1)
    ]
    body.append(
        _upholstered((inner + 0.02, 0.60, 0.20), 5).rotated("x", -6.0).translated(0.0, 0.47, -depth / 2.0 + 0.115)
    )
    share, middle = inner / seats, (seats - 1) / 2.0
    cushions = [
        cushion(share - 0.008, 0.15, 0.70, 10 + i, 0.022, pitch=0.06).translated(
            (i - middle) * share, seat_height - 0.015, 0.115
        )
        for i in range(seats)
    ]
    backs = [
        cushion(share - 0.014, 0.17, 0.46, 20 + i, 0.040, 0.05, 0.06)
        .rotated("x", 90.0)
        .rotated("x", -13.0 + 1.5 * (i - middle))
        .translated((i - middle) * share, 0.685, -0.185)
        for i in range(seats)
    ]
    legs = [
        cylinder(0.022, 0.14, 0.004, 20).translated(x * (width / 2.0 - 0.10), 0.07, z * (depth / 2.0 - 0.09))
        for x in (-1.0, 1.0)
        for z in (-1.0, 1.0)
    ]
    return make_model(
        name,
        "sofa",
        ("Body", "SofaWool", body),
        ("Seats", "SofaWool", cushions),
        ("Backs", "SofaWool", backs),
        ("Legs", "Walnut", legs),
    )


def _upholstered(size: tuple[float, float, float], seed: int) -> PolygonMesh:
    """Build a padded box about the origin."""
    divisions = tuple(max(2, round(length / 0.09)) for length in size)
    box = rounded_box(size, 0.032, 3, divisions)  # type: ignore[arg-type]

    def pad(points: Array) -> Array:
        q = 2.0 * points / np.array(size)
        fullness = 0.007 * (1.0 - np.abs(q) ** 4).clip(0.0)
        others = np.stack(
            [fullness[:, 1] * fullness[:, 2], fullness[:, 0] * fullness[:, 2], fullness[:, 0] * fullness[:, 1]], axis=-1
        )
        return np.asarray(points + np.sign(q) * others / 0.007 + 0.0015 * wrinkles(points, seed, 0.35)[:, None])

    return box.deformed(pad)


def armchair(name: str) -> Model:
    """Build a lounge chair in leather: a walnut frame with bent arms, one deep cushion each for seat and back."""
    frame = []
    for side in (-1.0, 1.0):
        x = 0.345 * side
        leg_front = [[x, 0.0, 0.36], [x, 0.30, 0.335], [x, 0.55, 0.315]]
        leg_back = [[x, 0.0, -0.40], [x, 0.28, -0.345], [x, 0.55, -0.325]]
        frame += [
            sweep(curve(leg, 10), rectangle(0.034, 0.046, 0.009), [0.66] + [0.9] * 4 + [1.0] * 5, up=(0.0, 0.0, 1.0))
            for leg in (leg_front, leg_back)
        ]
        arm_line = curve([[x, 0.560, 0.385], [x, 0.578, 0.20], [x, 0.568, -0.15], [x, 0.545, -0.40]], 16)
        frame.append(
            sweep(
                arm_line, rectangle(0.075, 0.026, 0.010), np.interp(np.linspace(0, 1, 16), [0, 0.3, 1], [0.9, 1.0, 0.7])
            )
        )
        frame.append(sweep([[x, 0.285, 0.335], [x, 0.215, -0.345]], rectangle(0.026, 0.055, 0.006)))
    frame += [
        rounded_box((0.66, 0.055, 0.026), 0.006).translated(0.0, y, z) for y, z in ((0.285, 0.325), (0.225, -0.335))
    ]
    tilt = -22.0
    for height in (0.06, 0.27, 0.47):
        frame.append(
            rounded_box((0.66, 0.050, 0.020), 0.005)
            .translated(0.0, height, -0.075)
            .rotated("x", tilt)
            .translated(0.0, 0.335, -0.285)
        )
    for side in (-1.0, 1.0):
        post = sweep(
            [[0.318 * side, -0.12, -0.075], [0.318 * side, 0.50, -0.075]],
            rectangle(0.030, 0.034, 0.007),
            up=(0.0, 0.0, 1.0),
        )
        frame.append(post.rotated("x", tilt).translated(0.0, 0.335, -0.285))
    seat = cushion(0.62, 0.13, 0.66, 31, 0.022, 0.045).rotated("x", -5.5).translated(0.0, 0.345, 0.025)
    back = cushion(0.62, 0.13, 0.56, 32, 0.026, 0.045).rotated("x", 90.0 + tilt).translated(0.0, 0.64, -0.300)
    return make_model(
        name, "armchair", ("Frame", "Walnut", frame), ("Seat", "Leather", seat), ("Back", "Leather", back)
    )


def scatter_pillow(name: str, material: str, size: float, seed: int) -> Model:
    """Build a square pillow standing upright."""
    return make_model(
        name,
        "pillow",
        ("Cover", material, pillow(size, size, 0.15, seed, piping=0.004).translated(0.0, size / 2.0, 0.0)),
    )


def folded_throw(name: str) -> Model:
    """Build a throw over a sofa's arm: its ridge at y = 0."""
    return make_model(name, "blanket", ("Wool", "ThrowWool", throw(0.42, 0.9, 0.108, 0.27, 7)))


def pouf(name: str) -> Model:
    """Build a round upholstered pouf, 0.39 m: six panels in piping, dimpled at a button."""
    outline = [
        [0.0, 0.0],
        [0.19, 0.0],
        [0.243, 0.010],
        [0.262, 0.06],
        [0.268, 0.19],
        [0.262, 0.32],
        [0.243, 0.370],
        [0.19, 0.386],
        [0.09, 0.390],
        [0.03, 0.378],
        [0.0, 0.372],
    ]
    body = lathe(curve(outline, 44), 132)

    def upholster(points: Array) -> Array:
        angle = np.arctan2(points[:, 0], points[:, 2])
        radius = np.hypot(points[:, 0], points[:, 2])
        seam = np.exp(-((np.sin(3.0 * angle) / 0.10) ** 2)) * np.clip(radius / 0.15, 0.0, 1.0)
        bent = points * (1.0 - 0.012 * seam)[:, None]
        return np.asarray(bent + 0.002 * wrinkles(points, 44, 0.16)[:, None] * (points[:, 1:2] > 0.004))

    turn = np.arange(72) * (2.0 * np.pi / 72)
    ring = np.stack([0.249 * np.sin(turn), np.zeros(72), 0.249 * np.cos(turn)], axis=-1)
    piping = [sweep(ring + np.array([0.0, y, 0.0]), circle(0.0055, 8), closed=True) for y in (0.016, 0.366)]
    button = sphere(0.020, 24).scaled(1.0, 0.45, 1.0).translated(0.0, 0.376, 0.0)
    return make_model(name, "pouf", ("Cover", "ThrowWool", [body.deformed(upholster), *piping, button]))
