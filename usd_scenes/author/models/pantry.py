# SPDX-License-Identifier: Apache-2.0
"""What stands on a worktop: pans, boards, jars, bottles, bread, fruit. Each stands on y = 0."""

from __future__ import annotations

import numpy as np

from usd_scenes.author.model import Model, make_model
from usd_scenes.author.models import small
from usd_scenes.author.models.tableware import bowl, dense, shell
from usd_scenes.author.polygon_mesh import Array, PolygonMesh, grid, merged
from usd_scenes.author.shapes import circle, curve, cylinder, fillet, lathe, rectangle, rounded_box, sphere, sweep
from usd_scenes.author.sheets import plate
from usd_scenes.author.soft import wrinkles


def pan(name: str) -> Model:
    """Build a frying pan of 0.28 m, its handle towards +x."""
    profile = fillet([[0.0, 0.0], [0.100, 0.0], [0.128, 0.018], [0.140, 0.045]], [0.0, 0.012, 0.020, 0.0], 5)
    body = shell(dense(profile), 0.0035, 80)
    line = curve(
        [[0.128, 0.030, 0.0], [0.160, 0.040, 0.0], [0.210, 0.058, 0.0], [0.270, 0.066, 0.0], [0.325, 0.062, 0.0]], 30
    )
    at = np.linspace(0.0, 1.0, 30)
    shank = sweep(line[:13], rectangle(0.018, 0.007, 0.003, 3), np.linspace(1.25, 0.85, 13), bevel=0.001)
    grip = sweep(
        line[10:],
        rectangle(0.026, 0.017, 0.0075, 4),
        np.interp(at[10:], [0.33, 0.5, 0.85, 1.0], [0.75, 0.95, 1.10, 0.85]),
        bevel=0.005,
    )
    plate_ = rounded_box((0.004, 0.026, 0.052), 0.0018, 2).rotated("z", -24.0).translated(0.133, 0.027)
    rivets = [sphere(0.0042, 14).translated(0.131, 0.028, z) for z in (-0.017, 0.017)]
    return make_model(
        name,
        "pan",
        ("Body", "CastIron", body),
        ("Shank", "BrushedSteel", [shank, plate_, *rivets]),
        ("Grip", "BlackPlastic", grip),
    )


def cutting_board(name: str) -> Model:
    """Build a cutting board with a round handle, 0.24 × 0.44 × 0.022 m, standing in the xy plane."""
    body = fillet([[-0.12, 0.0], [0.12, 0.0], [0.12, 0.30], [-0.12, 0.30]], 0.028, 6, closed=True)
    slab = plate(body * (1.0, 1.0), 0.022, 0.004)
    line = curve([[0.0, 0.285], [0.0, 0.33], [0.0, 0.40]], 14)
    neck = sweep(
        np.insert(line, 2, 0.0, axis=1),
        rectangle(0.052, 0.0215, 0.005, 3),
        np.stack([np.interp(np.linspace(0.0, 1.0, 14), [0.0, 0.5, 1.0], [1.5, 0.8, 0.9]), np.ones(14)], axis=-1),
        up=(0.0, 0.0, 1.0),
        bevel=0.003,
    )
    angle = np.linspace(0.0, 2.0 * np.pi, 41)[:-1]
    ring = np.stack([0.026 * np.cos(angle), 0.412 + 0.026 * np.sin(angle), 0.0 * angle], axis=-1)
    eye = sweep(ring, rectangle(0.020, 0.0218, 0.006, 3), up=(0.0, 0.0, 1.0), closed=True)
    board = slab.rotated("x", -90.0).translated(0.0, 0.0, 0.011)
    low = merged([board]).bounds[0]
    board = board.translated(0.0, -low[1])
    return make_model(name, "cutting board", ("Board", "Oak", [board, neck.with_uv(0.3, 0.2), eye.with_uv(0.4, 0.2)]))


def storage_jar(name: str, height: float = 0.17, radius: float = 0.055) -> Model:
    """Build a stoneware canister with a wooden lid."""
    r, h = radius, height
    profile = fillet(
        [[0.0, 0.004], [0.86 * r, 0.004], [0.90 * r, 0.0], [r, 0.010], [r, h - 0.030], [0.97 * r, h - 0.022]], 0.006, 4
    )
    body = shell(dense(profile), 0.004)
    lid = lathe(
        fillet(
            [
                [0.0, h - 0.028],
                [0.90 * r, h - 0.028],
                [0.90 * r, h - 0.020],
                [1.04 * r, h - 0.020],
                [1.04 * r, h - 0.006],
                [0.0, h - 0.004],
            ],
            0.003,
            3,
        ),
        56,
    )
    knob = lathe(
        curve(
            [
                [0.0, h - 0.006],
                [0.008, h - 0.004],
                [0.011, h + 0.006],
                [0.015, h + 0.014],
                [0.010, h + 0.022],
                [0.0, h + 0.024],
            ],
            20,
        ),
        32,
    )
    band = lathe([[r + 0.0004, 0.62 * h], [r + 0.0004, 0.68 * h]], 64)
    return make_model(
        name, "jar", ("Body", "Porcelain", body), ("Band", "BlueGlaze", band), ("Lid", "Oak", [lid, knob])
    )


def bottle(name: str) -> Model:
    """Build a bottle of olive oil, 0.30 m, with a cork and a paper label."""
    outline = fillet(
        [
            [0.0, 0.006],
            [0.030, 0.004],
            [0.034, 0.0],
            [0.037, 0.004],
            [0.037, 0.175],
            [0.0145, 0.228],
            [0.0135, 0.268],
            [0.0165, 0.268],
            [0.0165, 0.282],
            [0.0, 0.282],
        ],
        [0.0, 0.003, 0.003, 0.006, 0.030, 0.030, 0.001, 0.002, 0.002, 0.0],
        5,
    )
    body = lathe(outline, 56)
    cork = lathe(fillet([[0.0, 0.280], [0.0105, 0.280], [0.0115, 0.300], [0.0, 0.301]], 0.0015, 2), 28)
    angle = np.linspace(-2.0, 2.0, 33)
    label = _wrap(0.0374, angle, 0.055, 0.140)
    stripe = _wrap(0.0376, angle, 0.112, 0.120)
    mark = _wrap(0.0376, np.linspace(-0.55, 0.55, 13), 0.072, 0.086)
    return make_model(
        name,
        "bottle",
        ("Glass", "GreenBottle", body),
        ("Cork", "Cork", cork),
        ("Label", "Paper", label),
        ("Print", "EnamelRed", [stripe, mark]),
    )


def _wrap(radius: float, angle: Array, low: float, high: float) -> PolygonMesh:
    """Build a paper on a cylinder about y, facing outward, from angle to angle about +z."""
    sheet = np.zeros((2, len(angle), 3))
    sheet[..., 0], sheet[..., 2] = radius * np.sin(angle), radius * np.cos(angle)
    sheet[0, :, 1], sheet[1, :, 1] = low, high
    return grid(sheet, sheet[..., :2])


def bread(name: str) -> Model:
    """Build a farmhouse loaf, 0.27 × 0.11 × 0.15 m, with three cuts across."""
    ball = sphere(1.0, 96)

    def bake(points: Array) -> Array:
        """Shape a unit sphere into a loaf: flat below, cut and burst open above."""
        q = points / np.maximum(np.linalg.norm(points, axis=1, keepdims=True), 1e-9)
        full = np.sign(q) * np.abs(q) ** np.array([0.82, 0.80, 0.90])
        loaf = full * np.array([0.135, 0.078, 0.074])
        loaf[:, 1] = np.where(loaf[:, 1] < -0.030, -0.030 + 0.06 * (loaf[:, 1] + 0.030), loaf[:, 1])
        up = np.clip(q[:, 1], 0.0, 1.0)
        for center in (-0.062, 0.0, 0.062):
            distance = loaf[:, 0] - center - 0.45 * loaf[:, 2]
            across = np.exp(-((loaf[:, 2] / 0.055) ** 4))
            loaf[:, 1] += (
                up**0.5
                * across
                * (
                    -0.010 * np.exp(-((distance / 0.006) ** 2))
                    + 0.005 * np.exp(-(((np.abs(distance) - 0.014) / 0.007) ** 2))
                )
            )
        loaf += q * (0.0016 * wrinkles(loaf, 611, 0.05))[:, None]
        return np.asarray(loaf)

    crust = ball.deformed(bake)
    crust = PolygonMesh(crust.points, crust.normals, crust.points[:, [0, 2]] * 1.0 + 0.2, crust.counts, crust.indices)
    return make_model(name, "bread", ("Crust", "Crust", crust.translated(0.0, -float(crust.points[:, 1].min()))))


def fruit_bowl(name: str) -> Model:
    """Build a bowl, 0.28 m across, of apples, lemons and two bananas."""
    parts: dict[str, list[PolygonMesh]] = {}
    dish = bowl("Bowl", "Stoneware", 0.14).parts[0].mesh
    apples = ((-0.055, 0.030, 0.030), (0.030, 0.028, 0.062), (0.060, 0.030, -0.018), (0.004, 0.076, 0.006))
    lemons = ((-0.010, 0.030, -0.062), (-0.078, 0.044, -0.040), (0.068, 0.062, 0.040))
    for index, at in enumerate(apples):
        for part in (
            small.fruit("Fruit", "Apple", index + 1).rotated("x", 17.0 * index - 20.0).rotated("y", 80.0 * index).parts
        ):
            parts.setdefault(part.material, []).append(part.mesh.translated(*at))
    for index, at in enumerate(lemons):
        lemon = small.fruit("Fruit", "Lemon", index + 1).rotated("y", 70.0 * index)
        parts.setdefault("Lemon", []).append(lemon.parts[0].mesh.translated(*at))
    for index, turn in enumerate((0.0, 16.0)):
        bend = curve(
            [[0.0, 0.0, 0.0], [0.055, -0.022, 0.0], [0.110, -0.018, 0.0], [0.158, 0.012, 0.0], [0.172, 0.034, 0.0]], 30
        )
        girth = np.interp(
            np.linspace(0.0, 1.0, 30), [0.0, 0.06, 0.30, 0.75, 0.92, 1.0], [0.35, 0.62, 1.0, 0.98, 0.45, 0.32]
        )
        banana = sweep(bend, circle(0.0185, 10), girth, up=(0.0, 0.0, 1.0), bevel=0.002).rotated("x", 62.0)
        parts.setdefault("Banana", []).append(
            banana.rotated("y", 24.0 + turn).translated(-0.070, 0.098 + 0.006 * index, -0.035 - 0.012 * index)
        )
    return make_model(
        name,
        "fruit bowl",
        ("Bowl", "Stoneware", dish),
        ("Apples", "Apple", parts["Apple"]),
        ("Stalks", "Bark", parts["Bark"]),
        ("Lemons", "Lemon", parts["Lemon"]),
        ("Bananas", "Banana", parts["Banana"]),
    )


def glass(name: str) -> Model:
    """Build a tumbler, 0.09 m."""
    profile = fillet([[0.0, 0.0], [0.030, 0.0], [0.036, 0.092]], [0.0, 0.004, 0.0], 4)
    return make_model(name, "glass", ("Glass", "ClearGlass", shell(dense(profile), 0.002, 48)))


def utensils(name: str) -> Model:
    """Build a stoneware crock, 0.15 m, with wooden spoons, a spatula and a whisk, 0.33 m high."""
    crock = shell(
        curve(
            [
                [0.0, 0.004],
                [0.046, 0.003],
                [0.050, 0.0],
                [0.056, 0.010],
                [0.058, 0.080],
                [0.054, 0.145],
                [0.058, 0.152],
            ],
            36,
        ),
        0.005,
    )
    wood, steel = [], []
    for turn, lean, width in ((20.0, 9.0, 1.0), (140.0, 11.0, 1.25), (255.0, 8.0, 0.85)):
        stick = sweep([[0.0, 0.02, 0.0], [0.0, 0.26, 0.0]], circle(0.0058, 14), up=(0.0, 0.0, 1.0))
        head = sphere(1.0, 28).scaled(0.024 * width, 0.036, 0.0065).translated(0.0, 0.288)
        wood.append(merged([stick, head]).translated(0.0, 0.0, -0.028).rotated("x", lean).rotated("y", turn))
    for turn in np.arange(5) * 36.0:
        loop = curve(
            [
                [0.0, 0.17, 0.0],
                [0.018, 0.21, 0.0],
                [0.028, 0.265, 0.0],
                [0.0, 0.315, 0.0],
                [-0.028, 0.265, 0.0],
                [-0.018, 0.21, 0.0],
                [0.0, 0.17, 0.0],
            ],
            40,
        )
        steel.append(sweep(loop, circle(0.0010, 6), up=(0.0, 0.0, 1.0), bevel=0.0).rotated("y", float(turn)))
    steel.append(cylinder(0.007, 0.16, 0.002, 16).translated(0.0, 0.10))
    whisk = merged(steel).translated(0.0, 0.0, -0.020).rotated("x", 7.0).rotated("y", 200.0)
    return make_model(name, "pot", ("Crock", "SandGlaze", crock), ("Wood", "PineWood", wood), ("Whisk", "Steel", whisk))
