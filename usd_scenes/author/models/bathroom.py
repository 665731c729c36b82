# SPDX-License-Identifier: Apache-2.0
"""Bathroom furniture and accessories: window, mirror, lamps, stool, bottles, brushes, paper."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from usd_scenes.author.model import Model, make_model
from usd_scenes.author.models.bedroom import plate
from usd_scenes.author.models.building import ROOT
from usd_scenes.author.models.tableware import shell
from usd_scenes.author.polygon_mesh import Array, PolygonMesh, grid
from usd_scenes.author.shapes import (
    circle,
    curve,
    cylinder,
    fillet,
    lathe,
    leg,
    molding,
    molding_boxes,
    rectangle,
    rounded_box,
    sphere,
    sweep,
)
from usd_scenes.author.soft import cloth_back


def rail(name: str, runs: Sequence[Sequence[Sequence[float]]], height: float) -> Model:
    """Build a rounded ceramic trim on top of tiles, along runs of (x, z) with the room on the right."""
    outline = [[-ROOT, -0.002], [0.013, -0.002], [0.016, 0.012], [0.010, 0.022], [-ROOT, 0.024]]
    profile = fillet(outline, 0.004, 4)
    paths = [np.insert(np.asarray(run, dtype=np.float64), 1, height, axis=1) for run in runs]
    boxes = [box for run in runs for box in molding_boxes(run, 0.016, height - 0.002, height + 0.024)]
    trim = [molding(path, profile) for path in paths]
    return make_model(name, "tiles", ("Trim", "ZelligeTrim", trim)).with_proxies(Trim=boxes)


def frosted_window(name: str, width: float, height: float, thickness: float) -> Model:
    """Build a single timber sash with a frosted pane over a stone sill, its opening's lower middle at the origin."""
    z, frame, sash = -thickness * 0.62, 0.05, 0.055
    parts = []
    for inset, bar, depth, shift in ((0.0, frame, 0.075, 0.0), (frame, sash, 0.052, 0.018)):
        w, h = width - 2.0 * inset, height - 2.0 * inset
        for x in (-1.0, 1.0):
            parts.append(
                rounded_box((bar, h, depth), 0.004, 2).translated(x * (w - bar) / 2.0, height / 2.0, z + shift)
            )
        for y in (inset + bar / 2.0, height - inset - bar / 2.0):
            parts.append(rounded_box((w - 2.0 * bar + 0.002, bar, depth), 0.004, 2).translated(0.0, y, z + shift))
    pane = rounded_box((width - 0.19, height - 0.19, 0.006), 0.001).translated(0.0, height / 2.0, z + 0.004)
    sill = rounded_box((width + 0.10, 0.026, thickness * 0.62 + 0.055), 0.005, 3).translated(
        0.0, -0.013, -thickness * 0.31 + 0.027
    )
    handle = [
        rounded_box((0.026, 0.070, 0.008), 0.003, 2).translated(width / 2 - frame - sash / 2, height * 0.5, z + 0.048),
        sweep(
            [
                [width / 2 - frame - sash / 2, height * 0.5, z + 0.05],
                [width / 2 - frame - sash / 2, height * 0.5, z + 0.08],
            ],
            circle(0.007, 12),
        ),
        sweep(
            [
                [width / 2 - frame - sash / 2, height * 0.5 + 0.01, z + 0.082],
                [width / 2 - frame - sash / 2, height * 0.5 - 0.11, z + 0.082],
            ],
            circle(0.0075, 12),
            up=(0.0, 0.0, 1.0),
            bevel=0.004,
        ),
    ]
    return make_model(
        name,
        "window",
        ("Timber", "TrimPaint", parts),
        ("Pane", "FrostedPane", pane),
        ("Sill", "CounterStone", sill),
        ("Handle", "Chrome", handle),
    )


def globe_lamp(name: str, radius: float = 0.10) -> Model:
    """Build an opal globe close below the ceiling at y = 0, its middle at -0.21; the room has its light."""
    rose = lathe(fillet([[0.0, -0.028], [0.055, -0.028], [0.06, 0.0], [0.0, 0.0]], 0.005, 3), 40)
    stem = cylinder(0.010, 0.09, 0.002, 20).translated(0.0, -0.07, 0.0)
    cup = lathe(fillet([[0.0, -0.125], [0.040, -0.125], [0.034, -0.098], [0.0, -0.098]], 0.004, 2), 36)
    return make_model(
        name,
        "ceiling lamp",
        ("Globe", "OpalGlobe", sphere(radius, 48).translated(0.0, -0.21, 0.0)),
        ("Fitting", "Brass", [rose, stem, cup]),
    )


def round_mirror(name: str, radius: float) -> Model:
    """Build a round mirror in a thin brass rim, facing +z from the wall at z = 0."""
    outline = circle(radius, 96)
    rim = sweep(np.insert(outline * 1.01, 2, 0.013, axis=1), rectangle(0.012, 0.026, 0.004), up=(0, 0, 1), closed=True)
    whole = make_model(name, "mirror", ("Rim", "Brass", rim), ("Glass", "MirrorSilver", plate(outline, 0.018)))
    return whole.with_proxies(Rim=cylinder(radius * 1.02, 0.014).rotated("x", 90.0).translated(0.0, 0.0, 0.007))


def stool(name: str) -> Model:
    """Build a round oak stool, 0.45 m, its three legs splayed."""
    top = lathe(
        fillet([[0.0, 0.418], [0.150, 0.418], [0.165, 0.430], [0.165, 0.446], [0.155, 0.450], [0.0, 0.446]], 0.006, 3),
        56,
    )
    section = circle(0.017, 16)
    legs = [
        leg([0.09 * np.sin(a), 0.425, 0.09 * np.cos(a)], [0.155 * np.sin(a), 0.0, 0.155 * np.cos(a)], section, 0.7)
        for a in np.arange(3) * 2.0 * np.pi / 3.0 + 0.4
    ]
    return make_model(name, "stool", ("Seat", "Oak", top), ("Legs", "Oak", legs))


def bottle(name: str, material: str, height: float) -> Model:
    """Build a bottle of shampoo with a cap and a paper label."""
    r = 0.19 * height + 0.003
    body = lathe(
        fillet(
            [
                [0.0, 0.0],
                [r, 0.0],
                [r, 0.72 * height],
                [0.42 * r, 0.82 * height],
                [0.40 * r, 0.86 * height],
                [0.0, 0.86 * height],
            ],
            0.006,
            4,
        ),
        40,
    )
    cap = lathe(
        fillet([[0.0, 0.86 * height], [0.5 * r, 0.86 * height], [0.5 * r, height], [0.0, height]], 0.003, 3), 32
    )
    angle = np.linspace(-1.2, 1.2, 17)
    wrap = np.zeros((2, 17, 3))
    wrap[..., 0], wrap[..., 2] = (r + 0.0004) * np.sin(angle), (r + 0.0004) * np.cos(angle)
    wrap[:, :, 1] = np.array([[0.16], [0.58]]) * height
    label = grid(wrap, wrap[..., :2])
    return make_model(name, "bottle", ("Body", material, body), ("Cap", "BlackPlastic", cap), ("Label", "Paper", label))


def soap_dispenser(name: str) -> Model:
    """Build a ribbed ceramic pump bottle, 0.18 m; its spout points along +z."""
    body = lathe(
        curve(
            [[0.0, 0.0], [0.034, 0.0], [0.037, 0.006], [0.037, 0.10], [0.030, 0.118], [0.014, 0.124], [0.014, 0.130]],
            40,
        ),
        56,
    )
    pump = [
        lathe(
            fillet(
                [[0.0, 0.128], [0.017, 0.128], [0.017, 0.142], [0.006, 0.146], [0.006, 0.166], [0.0, 0.166]], 0.002, 2
            ),
            28,
        ),
        lathe(fillet([[0.0, 0.164], [0.015, 0.164], [0.015, 0.176], [0.0, 0.178]], 0.003, 2), 28),
        sweep(
            curve([[0.0, 0.171, 0.0], [0.0, 0.172, 0.030], [0.0, 0.163, 0.048]], 10), circle(0.0045, 12), up=(1, 0, 0)
        ),
    ]
    return make_model(name, "soap dispenser", ("Body", "Stoneware", body), ("Pump", "Brass", pump))


def soap_dish(name: str) -> Model:
    """Build a small dish with a used bar of soap."""
    dish = shell(
        curve([[0.0, 0.003], [0.040, 0.002], [0.045, 0.0], [0.050, 0.004], [0.062, 0.012], [0.066, 0.019]], 24),
        0.004,
        48,
    ).scaled(1.0, 1.0, 0.78)
    bar = rounded_box((0.082, 0.026, 0.054), 0.011, 5, (10, 2, 8))

    def wear(points: Array) -> Array:
        worn = points.copy()
        worn[:, 1] *= 1.0 - 110.0 * points[:, 0] ** 2 * np.clip(points[:, 1] / 0.013, 0.0, 1.0)
        return worn

    worn = bar.deformed(wear)
    return make_model(
        name, "soap", ("Dish", "Ceramic", dish), ("Soap", "Soap", worn.rotated("y", 12.0).translated(0.0, 0.0195, 0.0))
    )


def brush_cup(name: str) -> Model:
    """Build a tumbler with two toothbrushes and a tube."""
    cup = shell(
        np.array(fillet([[0.0, 0.004], [0.030, 0.004], [0.033, 0.0], [0.036, 0.006], [0.037, 0.100]], 0.003, 3)),
        0.003,
        40,
    )
    brushes: dict[str, list[PolygonMesh]] = {}
    bristles: list[PolygonMesh] = []
    for material, turn, lean in (("BrushTeal", 25.0, 11.0), ("BrushCoral", 170.0, 12.0)):
        line = curve([[0.0, 0.0, 0.0], [0.0, 0.09, 0.0], [0.0, 0.14, 0.001], [0.0, 0.19, 0.0]], 24)
        widths = np.interp(np.linspace(0, 1, 24), [0.0, 0.45, 0.70, 0.80, 0.86, 1.0], [1.0, 1.15, 0.55, 0.6, 1.1, 1.05])
        handle = sweep(line, rectangle(0.0105, 0.0055, 0.0026, 3), widths, up=(0.0, 0.0, 1.0))
        head = rounded_box((0.0095, 0.026, 0.010), 0.001).translated(0.0, 0.176, 0.0075)
        for mesh, target in ((handle, brushes.setdefault(material, [])), (head, bristles)):
            target.append(mesh.translated(0.0, 0.006, -0.014).rotated("x", lean).rotated("y", turn))
    return make_model(
        name,
        "toothbrush",
        ("Cup", "SandGlaze", cup),
        *((material, material, meshes) for material, meshes in brushes.items()),
        ("Bristles", "WhitePlastic", bristles),
    )


def brush(name: str) -> Model:
    """Build an oval hairbrush of oak, 0.22 m along x, lying on its back with the bristles up."""
    angle = np.arange(40) * (2.0 * np.pi / 40)
    pad = lathe(fillet([[0.0, 0.0], [0.034, 0.0], [0.037, 0.008], [0.033, 0.016], [0.0, 0.017]], 0.004, 3), 48)
    pad = pad.scaled(1.55, 1.0, 1.0).translated(0.055, 0.0, 0.0)
    handle = sweep(
        curve([[0.005, 0.008, 0.0], [-0.04, 0.009, 0.0], [-0.085, 0.010, 0.0], [-0.115, 0.008, 0.0]], 20),
        rectangle(0.020, 0.013, 0.006, 3),
        np.interp(np.linspace(0, 1, 20), [0, 0.35, 0.8, 1.0], [1.1, 0.72, 1.15, 0.9]),
    )
    bristles = []
    for ring, count in ((0.2, 5), (0.5, 11), (0.8, 17)):
        for a in angle[:: max(1, 40 // count)][:count]:
            x, z = 0.055 + 0.050 * ring * np.cos(a), 0.028 * ring * np.sin(a)
            bristles.append(sweep([[x, 0.016, z], [x, 0.030, z]], circle(0.0008, 5), up=(0, 0, 1), bevel=0.0))
    return make_model(name, "brush", ("Wood", "Oak", [pad, handle]), ("Bristles", "BlackPlastic", bristles))


def waste_bin(name: str) -> Model:
    """Build a pedal bin, 0.28 m, of brushed steel."""
    body = lathe(fillet([[0.0, 0.008], [0.098, 0.008], [0.100, 0.24], [0.0, 0.24]], 0.006, 3), 56)
    lid = lathe(fillet([[0.0, 0.240], [0.103, 0.240], [0.103, 0.256], [0.06, 0.272], [0.0, 0.276]], 0.006, 4), 56)
    foot = lathe(fillet([[0.0, 0.0], [0.102, 0.0], [0.102, 0.016], [0.0, 0.016]], 0.004, 2), 56)
    pedal = rounded_box((0.05, 0.008, 0.05), 0.003, 2).translated(0.0, 0.018, 0.115)
    return make_model(name, "bin", ("Body", "BrushedSteel", [body, lid]), ("Foot", "BlackPlastic", [foot, pedal]))


def paper_holder(name: str) -> Model:
    """Build a brass hook with a roll of paper on the wall at z = 0; the roll's axis is along x at z = 0.075."""
    plate_ = cylinder(0.024, 0.008, 0.002, 32).rotated("x", 90.0).translated(-0.075, 0.0, 0.004)
    arm = sweep(
        curve(
            [[-0.075, 0.0, 0.005], [-0.075, 0.0, 0.055], [-0.065, 0.0, 0.075], [0.0, 0.0, 0.075], [0.062, 0.0, 0.075]],
            30,
        ),
        circle(0.006, 14),
    )
    spiral = np.linspace(0.0, 1.0, 64)
    roll = lathe(fillet([[0.020, -0.05], [0.054, -0.05], [0.054, 0.05], [0.020, 0.05], [0.020, -0.05]], 0.002, 2), 64)
    roll = roll.rotated("z", 90.0).translated(0.0, -0.014, 0.075)
    hang = np.stack([0.0 * spiral, -0.014 - 0.16 * spiral, 0.075 + 0.054 - 0.008 * np.sin(2.6 * spiral)], axis=-1)
    sheet = np.stack([hang - np.array([0.05, 0.0, 0.0]), hang + np.array([0.05, 0.0, 0.0])], axis=1)[::-1]
    front = grid(sheet, sheet[..., :2])
    return make_model(
        name,
        "toilet paper",
        ("Holder", "Brass", [plate_, arm]),
        ("Paper", "ToiletPaper", [roll, front, cloth_back(front, 0.0005)]),
    )


def toilet_brush(name: str) -> Model:
    """Build a brush in a ceramic pot, 0.40 m."""
    pot = shell(
        np.array(fillet([[0.0, 0.004], [0.042, 0.004], [0.046, 0.0], [0.048, 0.006], [0.046, 0.125]], 0.003, 3)),
        0.004,
        44,
    )
    stick = sweep([[0.0, 0.05, 0.0], [0.0, 0.385, 0.0]], circle(0.006, 14), up=(0, 0, 1))
    knob = sphere(0.013, 24).translated(0.0, 0.392, 0.0)
    return make_model(name, "toilet brush", ("Pot", "Ceramic", pot), ("Handle", "Chrome", [stick, knob]))


def hook(name: str) -> Model:
    """Build a brass wall hook facing +z from the wall at z = 0."""
    plate_ = cylinder(0.018, 0.006, 0.002, 28).rotated("x", 90.0).translated(0.0, 0.0, 0.003)
    arm = sweep(
        curve([[0.0, 0.0, 0.004], [0.0, -0.004, 0.028], [0.0, 0.016, 0.045]], 12), circle(0.006, 12), up=(1, 0, 0)
    )
    return make_model(name, "hook", ("Brass", "Brass", [plate_, arm, sphere(0.009, 16).translated(0.0, 0.018, 0.045)]))
