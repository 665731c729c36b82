# SPDX-License-Identifier: Apache-2.0
"""Pottery: vessels turned on a wheel, with their spouts and handles. Each stands on y = 0 about x = z = 0."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from usd_scenes.author.model import Model, make_model
from usd_scenes.author.polygon_mesh import Array, PolygonMesh
from usd_scenes.author.shapes import circle, curve, fillet, lathe, rectangle, sweep


def offset(profile: ArrayLike, distance: float) -> Array:
    """Return a profile offset to its left: the inside of a vessel."""
    outer = np.asarray(profile, dtype=np.float64)
    tangent = np.gradient(outer, axis=0)
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=-1)
    return np.asarray(outer + distance * normal / np.linalg.norm(normal, axis=-1, keepdims=True))


def shell(outside: ArrayLike, thickness: float, segments: int = 56) -> PolygonMesh:
    """Build a vessel with a round lip: its outside profile from the foot's center to the rim, (radius, height)."""
    outer = np.asarray(outside, dtype=np.float64)
    inner = offset(outer, thickness)
    # Points on the axis, but for rounding, are left out: whether they are kept must not depend on the processor.
    inner = inner[(inner[:, 0] > 1e-9) & (inner[:, 1] > outer[0, 1] + 0.5 * thickness)]
    inner = np.concatenate([[[0.0, inner[0, 1]]], inner])
    middle, half = (outer[-1] + inner[-1]) / 2.0, (outer[-1] - inner[-1]) / 2.0
    along = np.array([-half[1], half[0]])
    if along @ (outer[-1] - outer[-2]) < 0.0:
        along = -along
    lip = [middle + np.cos(a) * half + np.sin(a) * along for a in np.linspace(0.0, np.pi, 7)[1:-1]]
    return lathe(np.concatenate([outer, lip, inner[::-1]]), segments)


def dish(name: str) -> Model:
    """Build a dinner plate, 0.27 m, with a blue band on its rim."""
    corners = [[0.0, 0.003], [0.070, 0.003], [0.074, 0.0], [0.080, 0.0], [0.084, 0.006], [0.096, 0.012], [0.134, 0.024]]
    profile = dense(fillet(corners, 0.006, 3))
    glaze = offset(profile, 0.0048)
    radii = np.linspace(0.1315, 0.119, 4)
    band = lathe(np.stack([radii, np.interp(radii, glaze[-8:, 0], glaze[-8:, 1])], axis=-1), 72)
    return make_model(name, "dish", ("Plate", "Porcelain", shell(profile, 0.0045, 72)), ("Band", "BlueGlaze", band))


def bowl(name: str, material: str = "Stoneware", radius: float = 0.14) -> Model:
    """Build a wide bowl on a foot."""
    r = radius
    profile = curve(
        [
            [0.0, 0.006],
            [0.32 * r, 0.006],
            [0.36 * r, 0.0],
            [0.42 * r, 0.002],
            [0.62 * r, 0.10 * r],
            [0.88 * r, 0.32 * r],
            [r, 0.62 * r],
        ],
        30,
    )
    return make_model(name, "bowl", ("Bowl", material, shell(profile, 0.006)))


def cup(name: str) -> Model:
    """Build a mug, 0.095 m, with a handle."""
    profile = fillet([[0.0, 0.004], [0.030, 0.004], [0.033, 0.0], [0.040, 0.004], [0.042, 0.095]], 0.006, 4)
    loop = curve(
        [[0.040, 0.078, 0.0], [0.060, 0.081, 0.0], [0.072, 0.062, 0.0], [0.066, 0.038, 0.0], [0.040, 0.022, 0.0]], 24
    )
    handle = sweep(loop, rectangle(0.012, 0.008, 0.0038, 3), up=(0.0, 0.0, 1.0))
    return make_model(name, "cup", ("Cup", "BlueGlaze", [shell(dense(profile), 0.0035, 48), handle]))


def dense(profile: Array, step: float = 0.008) -> Array:
    """Return a profile with points at most `step` apart, so that offsetting keeps its shape."""
    pieces = []
    for a, b in pairwise(profile):
        count = max(1, int(np.linalg.norm(b - a) / step))
        pieces.append(a + (b - a) * np.arange(count)[:, None] / count)
    return np.concatenate([*pieces, profile[-1:]])


def ewer(name: str) -> Model:
    """Build a glazed jug with spout, lid and handle, 0.26 m: SAILenv's "ewer"."""
    outline = curve(
        [
            [0.0, 0.006],
            [0.050, 0.004],
            [0.058, 0.0],
            [0.072, 0.018],
            [0.098, 0.075],
            [0.096, 0.120],
            [0.066, 0.168],
            [0.052, 0.200],
            [0.058, 0.222],
        ],
        44,
    )
    lid = lathe(
        curve(
            [
                [0.056, 0.221],
                [0.054, 0.229],
                [0.034, 0.240],
                [0.010, 0.246],
                [0.009, 0.254],
                [0.016, 0.264],
                [0.010, 0.274],
                [0.0, 0.276],
            ],
            32,
        ),
        48,
    )
    spout_line = curve(
        [[0.080, 0.070, 0.0], [0.120, 0.092, 0.0], [0.142, 0.142, 0.0], [0.152, 0.192, 0.0], [0.172, 0.214, 0.0]], 26
    )
    spout = sweep(spout_line, circle(0.022, 20), np.linspace(1.15, 0.50, 26), up=(0.0, 0.0, 1.0), bevel=0.003)
    handle_line = curve(
        [[-0.050, 0.204, 0.0], [-0.095, 0.222, 0.0], [-0.135, 0.190, 0.0], [-0.138, 0.130, 0.0], [-0.088, 0.070, 0.0]],
        30,
    )
    handle = sweep(handle_line, rectangle(0.020, 0.013, 0.006, 3), up=(0.0, 0.0, 1.0))
    return make_model(
        name,
        "ewer",
        ("Body", "CreamGlaze", [shell(outline, 0.004), spout, handle]),
        ("Lid", "CreamGlaze", lid),
    )


def vase(name: str, material: str = "Terracotta") -> Model:
    """Build a vase, open at the top."""
    profile = curve(
        [
            [0.0, 0.004],
            [0.045, 0.003],
            [0.052, 0.0],
            [0.075, 0.05],
            [0.088, 0.12],
            [0.060, 0.20],
            [0.034, 0.245],
            [0.044, 0.285],
        ],
        40,
    )
    return make_model(name, "vase", ("Vase", material, shell(profile, 0.005)))
