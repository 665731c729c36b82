# SPDX-License-Identifier: Apache-2.0
"""Kitchen appliances: refrigerator, gas range, sink, toaster. Each stands on y = 0 and faces +z."""

from __future__ import annotations

import numpy as np

from usd_scenes.author.model import Model, make_model
from usd_scenes.author.models.sanitary import rings
from usd_scenes.author.polygon_mesh import PolygonMesh, merged
from usd_scenes.author.shapes import circle, curve, cylinder, fillet, lathe, rectangle, rounded_box, sphere, sweep


def fridge(name: str) -> Model:
    """Build a refrigerator with round edges, 0.60 × 1.53 × 0.70 m: a freezer's door above, a larder's below."""
    width, depth, foot = 0.60, 0.54, 0.08
    case = rounded_box((width, 1.44, depth), 0.045, 5).translated(0.0, foot + 0.72, -0.03)
    doors = []
    for low, high in ((foot + 0.004, 1.075), (1.083, foot + 1.436)):
        door = rounded_box((width - 0.004, high - low, 0.085), 0.040, 6, (6, 6, 1))
        half = np.array([width, high - low, 0.085]) / 2.0

        def bulge(points: np.ndarray, half: np.ndarray = half) -> np.ndarray:
            """Curve the front of a door outward, as pressed steel."""
            bent = points.copy()
            rise = (1.0 - (points[:, 0] / half[0]) ** 2) * (1.0 - 0.5 * (points[:, 1] / half[1]) ** 2)
            bent[:, 2] += 0.016 * rise.clip(0.0) * (points[:, 2] > 0.0)
            return bent

        doors.append(door.deformed(bulge).translated(0.0, (low + high) / 2.0, depth / 2.0 + 0.018))
    seals = [
        rounded_box((width - 0.03, high - low - 0.02, 0.02), 0.008, 2).translated(
            0.0, (low + high) / 2.0, depth / 2.0 - 0.032
        )
        for low, high in ((foot + 0.01, 1.07), (1.09, foot + 1.43))
    ]
    chrome: list[PolygonMesh] = []
    front = depth / 2.0 + 0.072
    for y in (0.86, 1.20):
        grip = curve(
            [
                [-0.215, y, front - 0.008],
                [-0.215, y, front + 0.032],
                [-0.200, y, front + 0.042],
                [-0.02, y, front + 0.038],
            ],
            20,
        )
        chrome.append(sweep(grip, rectangle(0.022, 0.030, 0.007, 3), np.linspace(1.0, 0.72, 20), bevel=0.004))
        chrome.append(cylinder(0.021, 0.016, 0.004, 28).rotated("x", 90.0).translated(-0.215, y, front - 0.004))
    chrome.append(rounded_box((0.13, 0.020, 0.006), 0.0028, 3).translated(0.0, 1.395, front + 0.0045))
    feet = [
        cylinder(0.022, foot + 0.02, 0.004, 20).translated(x * 0.24, (foot + 0.02) / 2.0, z)
        for x in (-1, 1)
        for z in (-0.22, 0.17)
    ]
    plinth = rounded_box((width - 0.06, foot - 0.02, depth - 0.08), 0.006, 2).translated(0.0, foot / 2.0 + 0.016, -0.05)
    return make_model(
        name,
        "refrigerator",
        ("Case", "EnamelCream", case),
        ("Doors", "EnamelCream", doors),
        ("Seals", "GrayPlastic", seals),
        ("Handles", "Chrome", chrome),
        ("Feet", "BlackPlastic", [*feet, plinth]),
    )


def stove(name: str) -> Model:
    """Build a gas range with an oven, 0.60 × 0.94 × 0.62 m: four burners under iron grates, five knobs."""
    width, depth, top = 0.60, 0.58, 0.90
    body = [
        rounded_box((width, 0.78, depth - 0.03), 0.004, 2).translated(0.0, 0.10 + 0.39, -0.015),
        rounded_box((width, 0.022, depth), 0.006, 3).translated(0.0, top - 0.011, 0.0),
        rounded_box((width, 0.055, 0.018), 0.005, 2).translated(0.0, top + 0.018, -depth / 2.0 + 0.009),
        rounded_box((width - 0.004, 0.105, 0.030), 0.006, 2).translated(0.0, top - 0.082, depth / 2.0 - 0.014),
    ]
    z = depth / 2.0
    door = _frame(width - 0.012, 0.515, 0.085, 0.030).translated(0.0, 0.495, z - 0.012)
    drawer = rounded_box((width - 0.012, 0.120, 0.028), 0.006, 2).translated(0.0, 0.168, z - 0.013)
    glass = rounded_box((width - 0.16, 0.36, 0.010), 0.002).translated(0.0, 0.495, z - 0.008)
    bars = [_bar_handle(width - 0.14, 0.727, z), _bar_handle(width - 0.14, 0.206, z)]
    knobs, marks = [], []
    for index, x in enumerate((-0.225, -0.135, 0.0, 0.135, 0.225)):
        y, turn = top - 0.082, (0.0, 0.0, 35.0, 0.0, -60.0)[index]
        base = lathe(fillet([[0.0, 0.0], [0.0225, 0.0], [0.0205, 0.022], [0.0, 0.023]], 0.003, 3), 36)
        grip = rounded_box((0.0085, 0.012, 0.040), 0.003, 3).translated(0.0, 0.026)
        knob = merged([base, grip]).rotated("x", 90.0).rotated("z", turn)
        knobs.append(knob.translated(x, y, z + 0.001))
        ring = lathe(fillet([[0.0, 0.0], [0.027, 0.0], [0.0265, 0.0022], [0.0, 0.0024]], 0.0006, 2), 36)
        marks.append(ring.rotated("x", 90.0).translated(x, y, z + 0.0005))
    iron, caps = [], []
    for x in (-0.145, 0.145):
        for dz, radius in ((-0.125, 0.034), (0.125, 0.044)):
            caps.append(
                lathe(
                    fillet([[0.0, 0.0], [radius + 0.012, 0.0], [radius + 0.010, 0.010], [0.0, 0.010]], 0.003, 2), 40
                ).translated(x, top, dz)
            )
            iron.append(
                lathe(
                    fillet([[0.0, 0.010], [radius, 0.010], [radius - 0.003, 0.020], [0.0, 0.0205]], 0.003, 2), 40
                ).translated(x, top, dz)
            )
            for turn in (0.0, 90.0, 180.0, 270.0):
                finger = sweep([[0.030, 0.0, 0.0], [0.122, 0.0, 0.0]], rectangle(0.009, 0.012, 0.003, 2)).rotated(
                    "y", turn
                )
                iron.append(finger.translated(x, top + 0.036, dz))
        for dz in (-0.245, 0.0, 0.245):
            iron.append(rounded_box((0.262, 0.012, 0.011), 0.003, 1).translated(x, top + 0.036, dz))
        for side in (-0.128, 0.128):
            iron.append(rounded_box((0.011, 0.012, 0.49), 0.003, 1).translated(x + side, top + 0.036, 0.0))
            iron += [
                rounded_box((0.012, 0.034, 0.012), 0.003, 1).translated(x + side, top + 0.017, dz)
                for dz in (-0.24, 0.24)
            ]
    plinth = rounded_box((width - 0.04, 0.11, depth - 0.09), 0.004).translated(0.0, 0.055, -0.02)
    return make_model(
        name,
        "stove",
        ("Body", "BrushedSteel", body),
        ("Door", "BrushedSteel", [door, drawer]),
        ("Glass", "OvenGlass", glass),
        ("Handles", "Chrome", bars),
        ("Knobs", "BlackPlastic", knobs),
        ("Rings", "Chrome", marks),
        ("Grates", "CastIron", iron),
        ("Burners", "Aluminium", caps),
        ("Plinth", "BlackPlastic", plinth),
    )


def _frame(width: float, height: float, border: float, thick: float) -> PolygonMesh:
    """Build an upright rectangular frame about the origin from four boards."""
    side = rounded_box((border, height, thick), 0.005, 2)
    rail = rounded_box((width - 2.0 * border + 0.002, border, thick), 0.005, 2)
    sides = [side.translated(x * (width - border) / 2.0) for x in (-1.0, 1.0)]
    return merged([*sides, *(rail.translated(0.0, y * (height - border) / 2.0) for y in (-1.0, 1.0))])


def _bar_handle(length: float, y: float, z: float) -> PolygonMesh:
    """Build a round bar on two posts in front of a door at `z`."""
    bar = sweep([[-length / 2.0, y, z + 0.045], [length / 2.0, y, z + 0.045]], circle(0.0095, 18), bevel=0.003)
    posts = [
        sweep([[x, y, z], [x, y, z + 0.045]], circle(0.007, 14)) for x in (-length / 2.0 + 0.035, length / 2.0 - 0.035)
    ]
    return merged([bar, *posts])


def sink(name: str) -> Model:
    """Build a farmhouse sink of fireclay, 0.60 × 0.25 × 0.47 m, its apron at +z."""
    w, d, h, wall = 0.30, 0.235, 0.25, 0.024
    basin = rings(
        [
            (0.0, 0.0, 0.0, 12.0, 0.0),
            (w - 0.02, d - 0.02, 0.0, 12.0, 0.0),
            (w - 0.003, d - 0.003, 0.010, 14.0, 0.0),
            (w, d, 0.030, 16.0, 0.0),
            (w, d, h - 0.014, 16.0, 0.0),
            (w - 0.004, d - 0.004, h - 0.003, 15.0, 0.0),
            (w - 0.012, d - 0.012, h, 14.0, 0.0),
            (w - wall + 0.004, d - wall + 0.004, h - 0.004, 12.0, 0.0),
            (w - wall, d - wall, h - 0.016, 12.0, 0.0),
            (w - wall - 0.006, d - wall - 0.006, 0.075, 10.0, 0.0),
            (w - wall - 0.030, d - wall - 0.030, 0.040, 8.0, 0.0),
            (0.10, 0.08, 0.030, 3.0, 0.0),
            (0.0, 0.0, 0.027, 2.0, 0.0),
        ],
        segments=128,
        smooth=1,
    )
    waste = lathe(
        fillet([[0.0, 0.029], [0.018, 0.029], [0.026, 0.032], [0.042, 0.034], [0.045, 0.030], [0.0, 0.020]], 0.002, 2),
        40,
    )
    return make_model(name, "sink", ("Basin", "Ceramic", basin), ("Waste", "Chrome", waste))


def toaster(name: str) -> Model:
    """Build a toaster for two slices, 0.32 × 0.20 × 0.19 m, with its lever and dial at +x."""
    body = rounded_box((0.285, 0.165, 0.175), 0.048, 7).translated(0.0, 0.105)
    band = rounded_box((0.289, 0.018, 0.179), 0.0088, 3).translated(0.0, 0.030)
    plate = rounded_box((0.215, 0.006, 0.100), 0.0028, 2).translated(0.0, 0.1865)
    slots = [rounded_box((0.165, 0.004, 0.024), 0.0015).translated(0.0, 0.1885, z) for z in (-0.024, 0.024)]
    rails = [
        sweep([[-0.082, 0.1905, z], [0.082, 0.1905, z]], circle(0.0016, 8)) for z in (-0.034, -0.014, 0.014, 0.034)
    ]
    lever = rounded_box((0.026, 0.016, 0.046), 0.006, 3).translated(0.152, 0.140)
    track = rounded_box((0.004, 0.085, 0.010), 0.0015).translated(0.1415, 0.112)
    dial = lathe(fillet([[0.0, 0.0], [0.017, 0.0], [0.0155, 0.012], [0.0, 0.013]], 0.002, 3), 32).rotated("z", -90.0)
    feet = [cylinder(0.013, 0.024, 0.003, 20).translated(x, 0.012, z) for x in (-0.10, 0.10) for z in (-0.055, 0.055)]
    return make_model(
        name,
        "toaster",
        ("Body", "EnamelMint", body),
        ("Trim", "Chrome", [band, plate, *rails, dial.translated(0.1415, 0.058, 0.0)]),
        ("Slots", "BlackPlastic", [*slots, track]),
        ("Lever", "BlackPlastic", [lever, *feet]),
    )


def kettle(name: str) -> Model:
    """Build a stove kettle, 0.27 × 0.24 × 0.20 m, its spout towards +x and its handle above."""
    outline = curve(
        [[0.0, 0.0], [0.092, 0.0], [0.100, 0.008], [0.098, 0.050], [0.084, 0.100], [0.058, 0.128], [0.047, 0.134]], 40
    )
    body = lathe(outline, 72)
    lid = lathe(curve([[0.049, 0.133], [0.046, 0.140], [0.028, 0.150], [0.0, 0.153]], 20), 56)
    rim = lathe(fillet([[0.046, 0.131], [0.0525, 0.131], [0.0525, 0.136], [0.046, 0.137]], 0.0015, 2), 56)
    knob = merged([cylinder(0.005, 0.014, 0.001, 16).translated(0.0, 0.158), sphere(0.0125, 28).translated(0.0, 0.173)])
    spout_line = curve([[0.070, 0.070, 0.0], [0.108, 0.092, 0.0], [0.134, 0.122, 0.0], [0.158, 0.134, 0.0]], 24)
    spout = sweep(spout_line, circle(0.019, 24), np.linspace(1.15, 0.52, 24), up=(0.0, 0.0, 1.0), bevel=0.003)
    arch = curve(
        [
            [0.076, 0.112, 0.0],
            [0.096, 0.165, 0.0],
            [0.070, 0.222, 0.0],
            [0.0, 0.240, 0.0],
            [-0.070, 0.222, 0.0],
            [-0.096, 0.165, 0.0],
            [-0.076, 0.112, 0.0],
        ],
        48,
    )
    wire = sweep(arch, circle(0.0042, 14), up=(0.0, 0.0, 1.0), bevel=0.001)
    grip = sweep(
        arch[15:33],
        rectangle(0.024, 0.018, 0.0085, 4),
        np.sin(np.linspace(0.6, np.pi - 0.6, 18)),
        up=(0.0, 0.0, 1.0),
        bevel=0.004,
    )
    return make_model(
        name,
        "kettle",
        ("Body", "EnamelRed", [body, lid, spout]),
        ("Trim", "Chrome", [rim, wire]),
        ("Grip", "BlackPlastic", [grip, knob]),
    )
