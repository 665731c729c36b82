# SPDX-License-Identifier: Apache-2.0
"""Small objects: books, pictures, fruit, remote control, laptop, balls, ornaments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from usd_scenes.author.model import Model, make_model
from usd_scenes.author.polygon_mesh import Array, PolygonMesh, grid, merged
from usd_scenes.author.shapes import (
    circle,
    curve,
    cylinder,
    fillet,
    lathe,
    molding,
    rectangle,
    rounded_box,
    sphere,
    sweep,
)


def candle(name: str, height: float = 0.14, radius: float = 0.036) -> Model:
    """Build a pillar candle with a wick."""
    wax = lathe(
        fillet(
            [[0.0, 0.0], [radius, 0.0], [radius, height], [radius * 0.7, height - 0.006], [0.0, height - 0.008]],
            0.005,
            3,
        ),
        36,
    )
    wick = sweep(
        curve([[0.0, height - 0.01, 0.0], [0.001, height + 0.004, 0.0], [0.004, height + 0.011, 0.001]], 6),
        circle(0.0012, 6),
        up=(0, 0, 1),
        bevel=0.0,
    )
    return make_model(name, "candle", ("Wax", "Candle", wax), ("Wick", "BlackPlastic", wick))


def book(name: str, spine: int, width: float, height: float, thick: float) -> Model:
    """Build a hardback on its back cover, its spine towards -x, its height along z; `spine` is 0..15 of the texture.

    The boards take their color from the spine's column of the sheet, at a place above its print.
    """
    board = 0.0025
    u0, u1 = spine / 16.0 + 0.004, (spine + 1) / 16.0 - 0.004
    boards = []
    for y in (board / 2.0, thick - board / 2.0):
        box = rounded_box((width, board, height), 0.0009).translated(0.0, y, 0.0)
        u = u0 + (box.points[:, 0] / width + 0.5) * (u1 - u0)
        boards.append(replace(box, uv=np.stack([u, 0.96 + 0.02 * box.points[:, 2] / height], axis=-1)))
    angle = np.linspace(-0.95, 0.95, 9)
    bulge = 0.006 * (np.cos(angle) - np.cos(0.95)) / (1.0 - np.cos(0.95))
    points, uv = np.zeros((2, 9, 3)), np.zeros((2, 9, 2))
    points[..., 0] = -width / 2.0 - bulge
    points[..., 1] = thick / 2.0 * (1.0 + np.sin(angle) / np.sin(0.95))
    points[:, :, 2] = np.array([[height], [-height]]) / 2.0
    uv[..., 0], uv[0, :, 1], uv[1, :, 1] = np.linspace(u1, u0, 9), 0.997, 0.003
    back = grid(points, uv)
    block = rounded_box((width - 0.006, thick - 2.0 * board, height - 0.008), 0.001, grain=2)
    pages = block.translated(-0.002, thick / 2.0, 0.0)
    return make_model(name, "book", ("Cover", "Spines", [*boards, back]), ("Pages", "Pages", pages))


def remote(name: str) -> Model:
    """Build a remote control, 0.17 m, with keys in rows."""
    body = rounded_box((0.045, 0.018, 0.170), 0.007, 3).translated(0.0, 0.009, 0.0)
    keys = [
        rounded_box((0.008, 0.003, 0.006), 0.0012).translated((i - 1) * 0.012, 0.0185, -0.02 + j * 0.0125)
        for i in range(3)
        for j in range(7)
    ]
    ring = lathe(fillet([[0.008, 0.0], [0.015, 0.0], [0.015, 0.002], [0.008, 0.002]], 0.0008, 2), 24).translated(
        0.0, 0.018, -0.045
    )
    power = cylinder(0.0045, 0.003, 0.001, 16).translated(-0.012, 0.0185, -0.072)
    return make_model(
        name,
        "remote control",
        ("Body", "BlackPlastic", body),
        ("Keys", "GrayPlastic", [*keys, ring]),
        ("Power", "RedButton", power),
    )


def fruit(name: str, material: str, seed: int) -> Model:
    """Build a lemon or an apple."""
    if material == "Lemon":
        profile = [
            [0.0, 0.0],
            [0.006, 0.002],
            [0.010, 0.008],
            [0.024, 0.022],
            [0.028, 0.042],
            [0.022, 0.062],
            [0.009, 0.076],
            [0.005, 0.083],
            [0.0, 0.085],
        ]
        body = (
            lathe(curve(profile, 30), 28)
            .translated(0.0, -0.042)
            .rotated("z", 82.0)
            .rotated("y", 47.0 * seed)
            .translated(0.0, 0.028)
        )
        return make_model(name, "lemon", ("Fruit", material, body))
    profile = [
        [0.0, 0.006],
        [0.012, 0.001],
        [0.028, 0.008],
        [0.039, 0.035],
        [0.036, 0.058],
        [0.020, 0.072],
        [0.006, 0.066],
        [0.0, 0.061],
    ]
    stalk = sweep(
        curve([[0.0, 0.06, 0.0], [0.001, 0.075, 0.0], [0.006, 0.086, 0.002]], 6),
        circle(0.0014, 6),
        up=(0, 0, 1),
        bevel=0.0,
    )
    return make_model(name, "apple", ("Fruit", material, lathe(curve(profile, 30), 32)), ("Stalk", "Bark", stalk))


def picture(name: str, material: str, width: float, height: float, frame: str = "Oak", mat: float = 0.0) -> Model:
    """Build a framed picture facing +z, its back on z = 0; `mat` is the width of a paper border, m."""
    face = 0.022
    profile = fillet([[0.0, 0.0], [0.0, 0.030], [-face, 0.026], [-face, 0.006]], 0.0025, 2)
    corners = np.array([[-1, -1], [-1, 1], [1, 1], [1, -1]]) * (width / 2.0 + face, height / 2.0 + face)
    path = np.concatenate([corners, np.zeros((4, 1))], axis=1)
    border = molding(path[::-1], profile, up=(0.0, 0.0, 1.0), closed=True)
    parts: list[tuple[str, str, PolygonMesh | Sequence[PolygonMesh]]] = [("Frame", frame, border)]
    w, h = width / 2.0 + 0.004, height / 2.0 + 0.004
    if mat > 0.0:
        parts.append(("Mat", "Paper", _quad(w, h, 0.010)))
        w, h = width / 2.0 - mat, height / 2.0 - mat
    parts.append(("Picture", material, _quad(w, h, 0.012, unit=True)))
    across, upright = rounded_box((width + 2.0 * face, face, 0.030)), rounded_box((face, height, 0.030))
    sides = [across.translated(0.0, side * (height + face) / 2.0, 0.015) for side in (-1.0, 1.0)]
    sides += [upright.translated(side * (width + face) / 2.0, 0.0, 0.015) for side in (-1.0, 1.0)]
    return make_model(name, "painting", *parts).with_proxies(Frame=sides)


def hanging_picture(name: str) -> Model:
    """Build a framed landscape of 0.72 × 0.48 m, with its canvas, stretcher and wire behind."""
    front = picture(name, "Landscape", 0.72, 0.48, "Oak")
    canvas = rounded_box((0.735, 0.495, 0.004), 0.001).translated(0.0, 0.0, 0.008)
    bars = [rounded_box((0.735, 0.040, 0.014), 0.002).translated(0.0, 0.2275 * side, 0.004) for side in (-1.0, 1.0)]
    bars += [rounded_box((0.040, 0.415, 0.014), 0.002).translated(0.3475 * side, 0.0, 0.004) for side in (-1.0, 1.0)]
    wire = sweep(
        curve([[-0.34, 0.09, -0.004], [-0.1, 0.125, -0.005], [0.1, 0.125, -0.005], [0.34, 0.09, -0.004]], 16),
        circle(0.0012, 6),
    )
    back = make_model(
        name, "painting", ("Canvas", "Linen", canvas), ("Stretcher", "PineWood", bars), ("Wire", "Steel", wire)
    )
    return replace(front, parts=front.parts + back.parts)


def _quad(half_width: float, half_height: float, z: float, unit: bool = False) -> PolygonMesh:
    """Build a rectangle at z, facing +z; uv is in 0..1 if `unit`, else in meters."""
    points = np.array(
        [
            [[-half_width, -half_height, z], [half_width, -half_height, z]],
            [[-half_width, half_height, z], [half_width, half_height, z]],
        ]
    )
    uv = np.array([[[0.0, 0.0], [1.0, 0.0]], [[0.0, 1.0], [1.0, 1.0]]])
    return grid(points, uv if unit else points[..., :2])


def laptop(name: str) -> Model:
    """Build a laptop, 0.33 m wide, open to 108°: keyboard, trackpad and a bright screen."""
    base = rounded_box((0.33, 0.014, 0.228), 0.006, 2).translated(0.0, 0.007, 0.0)
    well = rounded_box((0.286, 0.002, 0.108), 0.001).translated(0.0, 0.0135, -0.038)
    keys = []
    for row, counts in enumerate((14, 14, 13, 12, 11)):
        pitch = 0.276 / counts
        for column in range(counts):
            x = -0.138 + (column + 0.5) * pitch
            keys.append(_key(pitch - 0.0030, 0.0160).translated(x, 0.0145, -0.080 + row * 0.0190))
    for x, width in ((-0.112, 0.049), (-0.0715, 0.026), (0.0, 0.110), (0.0715, 0.026), (0.112, 0.049)):
        keys.append(_key(width, 0.0160).translated(x, 0.0145, 0.0150))
    pad = rounded_box((0.110, 0.001, 0.062), 0.0005).translated(0.0, 0.0142, 0.066)
    lid = rounded_box((0.33, 0.222, 0.006), 0.0028, 2).translated(0.0, 0.111, 0.0)
    bezel = rounded_box((0.318, 0.210, 0.001), 0.0005).translated(0.0, 0.112, 0.0030)
    display = _quad(0.152, 0.095, 0.0038, unit=True).translated(0.0, 0.113, 0.0)
    hinge = sweep([[-0.12, 0.013, -0.112], [0.12, 0.013, -0.112]], circle(0.005, 12))

    def open_lid(mesh: PolygonMesh) -> PolygonMesh:
        return mesh.rotated("x", -18.0).translated(0.0, 0.013, -0.112)

    return make_model(
        name,
        "laptop",
        ("Case", "Aluminium", [base, open_lid(lid)]),
        ("Keyboard", "Keys", [*keys, hinge]),
        ("Bezel", "ScreenOff", [well, open_lid(bezel)]),
        ("Trackpad", "Steel", pad),
        ("Display", "LaptopScreen", open_lid(display)),
    )


def _key(width: float, depth: float) -> PolygonMesh:
    """Build a key cap: a low frustum."""
    bottom = np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]]) * (width / 2.0, depth / 2.0)
    rings = [np.insert(bottom * s, 1, y, axis=1) for s, y in ((1.0, 0.0), (1.0, 0.0012), (0.93, 0.0018))]
    rings.append(np.tile((0.0, 0.0018, 0.0), (4, 1)))
    points = np.concatenate([np.stack(rings), np.stack(rings)[:, :1]], axis=1)
    return grid(points, points[..., [0, 2]])


def beach_ball(name: str, radius: float = 0.13) -> Model:
    """Build a ball of six colored gores and two caps."""
    materials = ("BallRed", "BallWhite", "BallBlue", "BallWhite", "BallYellow", "BallWhite")
    parts: dict[str, list[PolygonMesh]] = {}
    latitude = np.linspace(-1.37, 1.37, 25)[:, None]
    for gore, material in enumerate(materials):
        angle = (gore + np.linspace(0.0, 1.0, 11)[None]) * np.pi / 3.0
        seam = 1.0 - 0.008 * np.exp(-(((np.linspace(-1.0, 1.0, 11)[None] ** 2 - 1.0) / 0.12) ** 2))
        points = radius * np.stack(
            np.broadcast_arrays(
                seam * np.cos(latitude) * np.sin(angle),
                seam * np.sin(latitude),
                seam * np.cos(latitude) * np.cos(angle),
            ),
            -1,
        )
        parts.setdefault(material, []).append(grid(points, points[..., :2]))
    for sign in (-1.0, 1.0):
        angle = np.linspace(1.37, np.pi / 2.0, 6)
        arc = radius * np.stack([np.cos(angle).clip(0.0), np.sin(angle)], -1)
        cap = lathe(arc if sign > 0 else (arc * (1.0, -1.0))[::-1], 60)
        parts["BallWhite"].append(cap)
    return make_model(
        name, "ball", *((material.removeprefix("Ball"), material, meshes) for material, meshes in parts.items())
    )


def tennis_racket(name: str) -> Model:
    """Build a racket, 0.685 m, lying in the xy plane with its head up: frame, throat, 16 × 19 strings, wrapped grip."""
    angle = np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)
    a, b = 0.124, 0.165
    head = np.stack([a * np.sin(angle), b * np.cos(angle) * (1.0 + 0.04 * np.cos(angle)), 0.0 * angle], -1)
    section = rectangle(0.013, 0.023, 0.005, 3)
    frame = [sweep(head, section, up=(0.0, 0.0, 1.0), closed=True)]
    for side in (-1.0, 1.0):
        strut = curve(
            [
                [side * 0.074, -0.124, 0.0],
                [side * 0.045, -0.190, 0.0],
                [side * 0.015, -0.270, 0.0],
                [side * 0.012, -0.335, 0.0],
            ],
            20,
        )
        frame.append(sweep(strut, rectangle(0.014, 0.022, 0.005, 3), up=(0.0, 0.0, 1.0)))
    accents = [
        sweep(
            head[(np.arange(-9, 10)) % 72] * (1.004, 1.004, 1.0),
            rectangle(0.0135, 0.0245, 0.005, 3),
            up=(0.0, 0.0, 1.0),
        )
    ]
    strings = []
    for i in range(16):
        x = (i - 7.5) * 0.0142
        y = b * np.sqrt(1.0 - (x / a) ** 2)
        strings.append(
            sweep([[x, -y * 0.955, 0.0008], [x, y * 1.03, 0.0008]], circle(0.0011, 6), up=(0.0, 0.0, 1.0), bevel=0.0)
        )
    for j in range(19):
        y = (j - 9.0) * 0.0168
        x = a * np.sqrt(max(0.0, 1.0 - (y / (b * 1.03)) ** 2))
        strings.append(sweep([[-x, y, -0.0008], [x, y, -0.0008]], circle(0.0011, 6), up=(0.0, 0.0, 1.0), bevel=0.0))
    octagon = rectangle(0.033, 0.029, 0.009, 1)
    turns = np.linspace(-0.335, -0.508, 66)
    ridge = 1.0 + 0.035 * np.where(np.arange(66) % 4 < 2, 1.0, -0.4)
    grip = sweep(np.stack([0 * turns, turns, 0 * turns], -1), octagon, ridge, up=(0.0, 0.0, 1.0))
    butt = sweep([[0.0, -0.506, 0.0], [0.0, -0.520, 0.0]], octagon * 1.14, up=(0.0, 0.0, 1.0), bevel=0.004)
    return make_model(
        name,
        "tennis racket",
        ("Frame", "RacketFrame", frame),
        ("Accent", "RacketWhite", accents),
        ("Strings", "RacketString", strings),
        ("Grip", "Grip", [grip, butt]),
    ).with_proxies(
        Frame=[*_arcs(head, section), *frame[1:]],
        Accent=rounded_box((0.10, 0.014, 0.0245)).translated(0.0, b * 1.035, 0.0),
        Strings=rounded_box((1.5 * a, 1.5 * b, 0.003)),
    )


def _arcs(ring: Array, section: Array, count: int = 12) -> list[PolygonMesh]:
    """Build a closed sweep as separate pieces, for fitting primitives."""
    knots = ring[:: len(ring) // count]
    return [sweep([p, q], section, up=(0.0, 0.0, 1.0)) for p, q in zip(knots, np.roll(knots, -1, axis=0), strict=True)]


def ornament(name: str) -> Model:
    """Build a brass sphere."""
    return make_model(name, "ornament", ("Sphere", "Brass", merged([sphere(0.055, 40).translated(0.0, 0.055)])))


def sculpture(name: str) -> Model:
    """Build an abstract figure in pale stone on a black plinth: a twisted, waisted loop, 0.36 m."""
    angle = np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)
    ring = np.stack([0.075 * np.sin(angle), 0.205 - 0.125 * np.cos(angle), 0.022 * np.sin(2.0 * angle)], axis=-1)
    girth = 1.0 + 0.35 * np.cos(angle) + 0.12 * np.sin(3.0 * angle)
    loop = sweep(ring, rectangle(0.046, 0.030, 0.0149, 5), girth, up=(0.0, 0.0, 1.0), closed=True)
    plinth = rounded_box((0.13, 0.05, 0.11), 0.003, 2).translated(0.0, 0.025, 0.0)
    figure = make_model(name, "statue", ("Figure", "PaleStone", loop), ("Plinth", "BlackMetal", plinth))
    return figure.with_proxies(Figure=_arcs(ring, rectangle(0.046, 0.030, 0.0149, 5), 8))


def set_top_box(name: str) -> Model:
    """Build a small black box with a light."""
    body = rounded_box((0.24, 0.040, 0.16), 0.005, 2).translated(0.0, 0.020, 0.0)
    lamp = sphere(0.002, 12).translated(0.09, 0.020, 0.080)
    return make_model(name, "media box", ("Body", "BlackPlastic", body), ("Light", "RedButton", lamp))
