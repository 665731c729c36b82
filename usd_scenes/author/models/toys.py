# SPDX-License-Identifier: Apache-2.0
"""Toys: a teddy bear."""

from __future__ import annotations

import numpy as np

from usd_scenes.author.implicit import Field, ellipsoid, limb, surface, union
from usd_scenes.author.model import Model, make_model
from usd_scenes.author.polygon_mesh import Array, PolygonMesh, rotation
from usd_scenes.author.shapes import circle, curve, sphere, sweep
from usd_scenes.author.soft import wrinkles

HEAD, BODY = (0.0, 0.262, 0.008), (0.0, 0.112, 0.0)


def teddy_bear(name: str) -> Model:
    """Build a plush bear that sits, 0.36 m: stuffed pieces sewn together, lighter muzzle, ears and soles, a bow."""
    pieces: list[Field] = [ellipsoid(BODY, (0.086, 0.108, 0.078)), ellipsoid(HEAD, (0.083, 0.074, 0.073))]
    for side in (-1.0, 1.0):
        pieces.append(ellipsoid((0.064 * side, 0.330, -0.004), (0.034, 0.034, 0.017), rotation("z", -25.0 * side)))
        pieces.append(limb((0.070 * side, 0.178, 0.012), (0.128 * side, 0.092, 0.052), 0.033, 0.037))
        pieces.append(limb((0.055 * side, 0.046, 0.030), (0.098 * side, 0.043, 0.128), 0.045, 0.043))
        pieces.append(ellipsoid((0.104 * side, 0.058, 0.150), (0.039, 0.054, 0.026), rotation("x", -8.0)))
    body = _plush(union(pieces, 0.014), [-0.19, -0.03, -0.10], [0.19, 0.38, 0.21], 0.0066, 1)
    muzzle = _plush(
        ellipsoid((0.0, 0.242, 0.070), (0.040, 0.031, 0.030)), [-0.06, 0.2, 0.03], [0.06, 0.3, 0.13], 0.0050, 2
    )
    tan = [muzzle]
    for side in (-1.0, 1.0):
        sole = ellipsoid((0.106 * side, 0.058, 0.172), (0.031, 0.044, 0.0140), rotation("x", -8.0))
        tan.append(
            _plush(
                sole,
                np.array((0.106 * side, 0.058, 0.175)) - 0.06,
                np.array((0.106 * side, 0.058, 0.175)) + 0.06,
                0.0058,
                3,
            )
        )
        ear = ellipsoid((0.064 * side, 0.330, 0.009), (0.023, 0.023, 0.0100), rotation("z", -25.0 * side))
        tan.append(
            _plush(
                ear,
                np.array((0.064 * side, 0.330, 0.009)) - 0.04,
                np.array((0.064 * side, 0.330, 0.009)) + 0.04,
                0.0052,
                4,
            )
        )
    eyes = [
        sphere(0.0098, 20).scaled(1.0, 1.0, 0.8).rotated("y", 22.0 * side).translated(0.031 * side, 0.282, 0.0765)
        for side in (-1.0, 1.0)
    ]
    nose = sphere(0.0150, 24).scaled(1.15, 0.8, 0.7).translated(0.0, 0.258, 0.0985)
    mouth = [
        sweep(
            curve(
                [
                    [0.0, 0.246, 0.1010],
                    [0.0, 0.236, 0.1012],
                    [0.008 * side, 0.229, 0.0995],
                    [0.017 * side, 0.231, 0.0955],
                ],
                12,
            ),
            circle(0.0013, 8),
        )
        for side in (-1.0, 1.0)
    ]
    return make_model(
        name,
        "teddy bear",
        ("Body", "PlushBrown", body),
        ("Muzzle", "PlushTan", tan),
        ("Eyes", "BlackGloss", [*eyes, nose, *mouth]),
        ("Bow", "RibbonRed", _bow()),
    ).with_proxies(
        Body=_balls(), Muzzle=sphere(0.030, 24).scaled(1.3, 1.0, 1.0).translated(0.0, 0.242, 0.070), Bow=_bow()[:4]
    )


def _balls() -> list[PolygonMesh]:
    """Build ellipsoids of the bear's body parts, as proxies."""
    balls = [sphere(1.0, 24).scaled(0.086, 0.108, 0.078).translated(*BODY), sphere(0.078, 24).translated(*HEAD)]
    for side in (-1.0, 1.0):
        balls.append(sphere(0.032, 24).translated(0.064 * side, 0.330, -0.004))
        balls.append(
            sphere(1.0, 24).scaled(0.045, 0.075, 0.045).rotated("z", 32.0 * side).translated(0.100 * side, 0.138, 0.03)
        )
        balls.append(
            sphere(1.0, 24).scaled(0.045, 0.045, 0.095).rotated("y", 22.0 * side).translated(0.085 * side, 0.045, 0.090)
        )
    return balls


def _plush(field: Field, low: Array | list[float], high: Array | list[float], step: float, seed: int) -> PolygonMesh:
    """Polygonize a field with random bulges, as plush over stuffing."""

    def stuffed(points: Array) -> Array:
        slow, pile = wrinkles(points, seed, 0.07, 1), wrinkles(points, seed + 9, 0.013, 1)
        return np.asarray(field(points) - 0.0012 * slow - 0.0003 * pile)

    return surface(stuffed, low, high, step)


def _bow() -> list[PolygonMesh]:
    """Build a ribbon's bow under the chin: two loops, a knot, two ends, and the band round the neck."""
    parts: list[PolygonMesh] = []
    ribbon = np.array([[0.0009, 0.013], [-0.0009, 0.013], [-0.0009, -0.013], [0.0009, -0.013]])[::-1]
    at = np.array((0.0, 0.192, 0.084))
    for side in (-1.0, 1.0):
        loop = curve(
            [
                [0.002 * side, 0.0, 0.0],
                [0.024 * side, 0.012, 0.010],
                [0.047 * side, 0.010, 0.008],
                [0.049 * side, -0.004, 0.002],
                [0.026 * side, -0.008, -0.001],
                [0.003 * side, 0.0, -0.001],
            ],
            22,
        )
        swell = np.interp(np.linspace(0.0, 1.0, 22), [0.0, 0.45, 0.6, 1.0], [0.4, 1.15, 1.15, 0.4])
        parts.append(sweep(loop + at, ribbon, np.stack([np.ones(22), swell], -1), up=(0.0, 0.0, 1.0), bevel=0.0005))
        end = curve([[0.003 * side, -0.002, 0.001], [0.018 * side, -0.022, 0.008], [0.027 * side, -0.050, 0.002]], 12)
        parts.append(
            sweep(
                end + at,
                ribbon,
                np.stack([np.ones(12), np.linspace(0.45, 0.9, 12)], -1),
                up=(0.0, 0.0, 1.0),
                bevel=0.0005,
            )
        )
    parts.append(sphere(0.0095, 20).scaled(0.9, 1.1, 0.8).translated(*(at + np.array((0.0, 0.0, 0.003)))))
    parts = [part.translated(*-at).scaled(1.45, 1.45, 1.3).translated(*at) for part in parts]
    angle = np.arange(48) * (2.0 * np.pi / 48)
    neck = np.stack([0.066 * np.sin(angle), 0.200 - 0.004 * np.cos(angle), 0.004 + 0.069 * np.cos(angle)], -1)
    parts.append(
        sweep(neck, np.array([[0.0045, -0.011], [0.0045, 0.011], [-0.0045, 0.011], [-0.0045, -0.011]]), closed=True)
    )
    return parts
