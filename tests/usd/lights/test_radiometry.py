# SPDX-License-Identifier: Apache-2.0
"""UsdLux's units as rendered: irradiance of a diffuse floor under each light against closed forms, to 0.5 %."""

from __future__ import annotations

import math

import numpy as np
import OpenEXR
import pytest

import tiscene as ts
from tests.usd.helpers import preview_material, write
from tests.usd.lights.test_ies import ies
from tiscene.usd.lights.light import color_of_temperature

ALBEDO = 0.5
FLOOR = """
def Mesh "Floor" (prepend apiSchemas = ["MaterialBindingAPI"]) {
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(-1000, 0, 1000), (1000, 0, 1000), (1000, 0, -1000), (-1000, 0, -1000)]
    rel material:binding = </Gray>
}
""" + preview_material("/Gray", "color3f inputs:diffuseColor = (0.5, 0.5, 0.5)", "float inputs:ior = 1")
# A light above the origin, pointing down; the stage's unit is `meters`.
DOWN = """
    double3 xformOp:translate = (%g, %g, 0)
    float xformOp:rotateX = -90
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateX"]
"""


def irradiance(folder, light: str, *, meters: float = 1.0, spp: int = 256) -> np.ndarray:
    """Return the irradiance [3] of the floor at the origin, W/m², measured from the radiance that it reflects."""
    path = write(folder, FLOOR + light, meters=meters)
    # The camera looks from the side, past the lights; its pixels cover a few millimeters.
    camera = ts.Camera(position=(0.0, 3.0, 9.0), rotation=look_at_origin(3.0, 9.0), vertical_fov=0.0002)
    stream = ts.Stream(
        path,
        width=16,
        height=16,
        buffers=("hdr",),
        camera=camera,
        spp=spp,
        max_depth=2,
        denoise=False,
        incremental=False,
    )
    return stream[0].hdr.reshape(-1, 3).astype(np.float64).mean(axis=0) * math.pi / ALBEDO


def look_at_origin(height: float, distance: float) -> tuple[float, float, float, float]:
    half = -0.5 * math.atan2(height, distance)
    return (math.cos(half), math.sin(half), 0.0, 0.0)


def light(kind: str, lines: str = "", at: tuple[float, float] = (0.0, 2.0)) -> str:
    return f'def {kind} "Light"\n{{\n{DOWN % at}\n{lines}\n}}\n'


def corner(a: float, b: float) -> float:
    """Return the view factor of a patch to a parallel a x b rectangle one unit above, over one of its corners."""
    x, y = math.hypot(1.0, a), math.hypot(1.0, b)
    return (a / x * math.atan(b / x) + b / y * math.atan(a / y)) / (2.0 * math.pi)


RECT = "float inputs:width = 2\nfloat inputs:height = 3\n"
RECT_FACTOR = 4.0 * corner(0.5, 0.75)
CASES = {
    "rect": (light("RectLight", RECT + "float inputs:intensity = 7"), math.pi * 7.0 * RECT_FACTOR),
    "rect, exposed": (light("RectLight", RECT + "float inputs:exposure = 3"), math.pi * 8.0 * RECT_FACTOR),
    "rect, normalized": (
        light("RectLight", RECT + "float inputs:intensity = 12\nbool inputs:normalize = 1"),
        math.pi * 12.0 / 6.0 * RECT_FACTOR,
    ),
    "rect over its edge": (light("RectLight", RECT, (1.0, 2.0)), math.pi * 2.0 * corner(1.0, 0.75)),
    "disk": (light("DiskLight", "float inputs:radius = 1.5"), math.pi * 2.25 / (2.25 + 4.0)),
    "disk, normalized": (
        light("DiskLight", "float inputs:radius = 1.5\nbool inputs:normalize = 1"),
        1.0 / (2.25 + 4.0),
    ),
    "sphere": (light("SphereLight", "float inputs:radius = 0.5"), math.pi * (0.5 / 2.0) ** 2),
    "sphere, normalized": (
        light("SphereLight", "float inputs:radius = 0.25\nbool inputs:normalize = 1\nfloat inputs:intensity = 40"),
        40.0 / (4.0 * 4.0),
    ),
    "sphere aside": (
        light("SphereLight", "float inputs:radius = 0.5", (2.0, 2.0)),
        math.pi * 0.25 / 8.0 / math.sqrt(2.0),
    ),
    "sphere as a point": (
        light("SphereLight", "float inputs:radius = 0.1\nbool treatAsPoint = 1\nfloat inputs:intensity = 90"),
        math.pi * 90.0 * 0.01 / 4.0,
    ),
    "sun": (
        light("DistantLight", "float inputs:angle = 20\nfloat inputs:intensity = 3"),
        3 * math.pi * math.sin(math.radians(10)) ** 2,
    ),
    "sun, normalized": (
        light("DistantLight", "float inputs:angle = 20\nfloat inputs:intensity = 3\nbool inputs:normalize = 1"),
        3.0,
    ),
    "parallel sun": (light("DistantLight", "float inputs:angle = 0\nfloat inputs:intensity = 3"), 3.0),
    "dome": (light("DomeLight", "float inputs:intensity = 2"), 2.0 * math.pi),
}


@pytest.mark.parametrize("name", CASES)
def test_irradiance_matches_closed_form(tmp_path, name):
    body, expected = CASES[name]
    np.testing.assert_allclose(irradiance(tmp_path, body), expected, rtol=5e-3)


def test_rect_and_disk_emit_nothing_backward(tmp_path):
    up = "\n    float xformOp:rotateX = 90\n"
    for kind in ("RectLight", "DiskLight"):
        assert not irradiance(tmp_path, light(kind).replace("\n    float xformOp:rotateX = -90\n", up), spp=4).any()


def test_stage_unit_changes_only_normalized_lights(tmp_path):
    """With sizes in centimeters, radiance is unchanged, and `normalize` divides by square stage units."""
    body = light("RectLight", "float inputs:width = 200\nfloat inputs:height = 300", (0.0, 200.0))
    np.testing.assert_allclose(irradiance(tmp_path, body, meters=0.01), math.pi * RECT_FACTOR, rtol=5e-3)
    normalized = body.replace(
        "float inputs:width", "float inputs:intensity = 60000\nbool inputs:normalize = 1\nfloat inputs:width"
    )
    np.testing.assert_allclose(irradiance(tmp_path, normalized, meters=0.01), math.pi * RECT_FACTOR, rtol=5e-3)


def test_color_and_color_temperature_multiply(tmp_path):
    lines = "color3f inputs:color = (1, 0.5, 0.25)\nbool inputs:enableColorTemperature = 1\n"
    lines += "float inputs:colorTemperature = 3200"
    expected = math.pi * RECT_FACTOR * color_of_temperature(3200.0) * (1.0, 0.5, 0.25)
    np.testing.assert_allclose(irradiance(tmp_path, light("RectLight", RECT + lines)), expected, rtol=5e-3)


def save(path, pixels: np.ndarray) -> None:
    with OpenEXR.File({"type": OpenEXR.scanlineimage}, {"RGB": pixels.astype(np.float32)}) as file:
        file.write(str(path))


def test_textured_rect_is_upright_seen_from_front(tmp_path):
    """Seen from below with the light's +y up, red is on the left (+x of the light) and blue at the bottom."""
    pixels = np.zeros((2, 2, 3))
    pixels[:, 0, 0] = 1.0
    pixels[1, :, 2] = 1.0
    save(tmp_path / "t.exr", np.repeat(np.repeat(pixels, 64, axis=0), 64, axis=1))
    lines = "float inputs:width = 4\nfloat inputs:height = 4\nasset inputs:texture:file = @t.exr@"
    for x in (1.0, -1.0):
        got = irradiance(tmp_path, light("RectLight", lines, (-x, 1.0)), spp=1024)
        near, far = half_factors(x)
        assert got[0] == pytest.approx(math.pi * (near if x > 0.0 else far), rel=1e-2)
        assert got[2] == pytest.approx(math.pi * (near + far) / 2.0, rel=1e-2)


def half_factors(x: float) -> tuple[float, float]:
    """Return the view factors of the halves of a 4 x 4 rectangle one unit above, at `abs(x)` from its middle."""
    x = abs(x)
    outer, inner = 2.0 * corner(2.0 - x, 2.0), 2.0 * corner(x, 2.0)
    return outer + inner, 2.0 * corner(2.0 + x, 2.0) - inner


def test_textured_dome_irradiance(tmp_path):
    """The upper hemisphere has a color for each half; +x is a quarter of the width from the image's left."""
    height, width = 180, 360
    pixels = np.zeros((height, width, 3))
    down = (np.arange(height) + 0.5) / height * 180.0
    pixels[down < 30.0, :, 1] = 1.0
    pixels[: height // 2, : width // 2, 0] = 1.0  # left half: +x
    pixels[height // 2 :] = 50.0  # below the floor
    save(tmp_path / "sky.exr", pixels)
    sky = 'def DomeLight "Sky"\n{\nasset inputs:texture:file = @sky.exr@\n%s}\n'
    got = irradiance(tmp_path, sky % "", spp=1024)
    assert got[1] == pytest.approx(math.pi * math.sin(math.radians(30.0)) ** 2, rel=1e-2)
    assert got[0] == pytest.approx(math.pi / 2.0, rel=2e-2)  # half of the sky; its edges are blurred by a pixel
    assert got[2] == pytest.approx(0.0, abs=0.15)


def shaped(kind: str, lines: str, at: tuple[float, float] = (0.0, 2.0)) -> str:
    return light(kind, lines, at).replace(
        f'def {kind} "Light"', f'def {kind} "Light" (prepend apiSchemas = ["ShapingAPI"])'
    )


def cylinder_irradiance(radius: float, length: float, height: float) -> float:
    """Return the irradiance below the middle of a horizontal tube of radiance 1, by numerical integration."""
    around = (np.arange(2000) + 0.5) / 2000 * 2.0 * math.pi
    along = ((np.arange(2000) + 0.5) / 2000 - 0.5) * length
    normal = np.stack([np.zeros_like(around), np.cos(around), np.sin(around)], axis=-1)
    point = np.zeros((len(around), len(along), 3))
    point[..., 0] = along
    point[..., 1:] = (normal[:, 1:] * radius)[:, None] + (height, 0.0)
    squared = (point**2).sum(axis=-1)
    seen = np.maximum(-np.einsum("anx,ax->an", point, normal), 0.0)
    return float((point[..., 1] * seen / squared**2).sum() * radius * (2.0 * math.pi / 2000) * (length / 2000))


def smoothstep(low: float, high: float, value: float) -> float:
    t = min(max((value - low) / (high - low), 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


AT_45 = math.pi * 0.01 / 8.0 / math.sqrt(2.0)  # irradiance of a sphere of radius 0.1, 2 aside and 2 above
SMALL = "float inputs:radius = 0.1\n"
SHAPED = {
    "tube": (
        light("CylinderLight", "float inputs:radius = 0.2\nfloat inputs:length = 3"),
        cylinder_irradiance(0.2, 3.0, 2.0),
    ),
    "tube, normalized": (
        light("CylinderLight", "float inputs:radius = 0.2\nfloat inputs:length = 3\nbool inputs:normalize = 1"),
        cylinder_irradiance(0.2, 3.0, 2.0) / (2.0 * math.pi * 0.2 * 3.0),
    ),
    "within its cone": (shaped("SphereLight", SMALL + "float inputs:shaping:cone:angle = 60", (2.0, 2.0)), AT_45),
    "outside its cone": (shaped("SphereLight", SMALL + "float inputs:shaping:cone:angle = 30", (2.0, 2.0)), 0.0),
    "in the soft edge of its cone": (
        shaped(
            "SphereLight",
            "float inputs:radius = 0.002\nfloat inputs:shaping:cone:angle = 60\n"
            "float inputs:shaping:cone:softness = 0.5",
            (2.0, 2.0),
        ),
        AT_45 * (0.002 / 0.1) ** 2 * (1.0 - smoothstep(30.0, 60.0, 45.0)),
    ),
    "focused disk": (
        shaped("DiskLight", "float inputs:radius = 0.01\nfloat inputs:shaping:focus = 3", (2.0, 2.0)),
        math.pi * 0.01**2 * 0.5 / 8.0 * math.sqrt(0.5) ** 3,
    ),
    "multiplied": (light("RectLight", RECT + "float inputs:diffuse = 0.25"), 0.25 * math.pi * RECT_FACTOR),
    "of gloss alone": (light("RectLight", RECT + "float inputs:diffuse = 0\nfloat inputs:specular = 5"), 0.0),
}


@pytest.mark.parametrize("name", SHAPED)
def test_irradiance_of_shaped_light_matches_closed_form(tmp_path, name):
    body, expected = SHAPED[name]
    np.testing.assert_allclose(irradiance(tmp_path, body), expected, rtol=5e-3, atol=1e-9)


def test_focus_tint_colors_light_off_axis(tmp_path):
    lines = "float inputs:radius = 0.01\nfloat inputs:shaping:focus = 3\ncolor3f inputs:shaping:focusTint = (1, 0.5, 0)"
    factor = math.sqrt(0.5) ** 3
    color = np.array([1.0, 0.5, 0.0])
    expected = math.pi * 0.01**2 * 0.5 / 8.0 * (color + (1.0 - color) * factor)
    np.testing.assert_allclose(irradiance(tmp_path, shaped("DiskLight", lines, (2.0, 2.0))), expected, rtol=5e-3)


def test_ies_profile_scales_intensity_by_angle(tmp_path):
    """Intensity 10 straight down and 2 at 90 degrees: 6 at 45 degrees, in every direction."""
    (tmp_path / "lamp.ies").write_bytes(ies([0, 90], [0], [[10, 2]]))
    lines = "float inputs:radius = 0.01\nasset inputs:shaping:ies:file = @lamp.ies@"
    for x in (2.0, -2.0):
        got = irradiance(tmp_path, shaped("SphereLight", lines, (x, 2.0)))
        np.testing.assert_allclose(got, 6.0 * AT_45 / 100.0, rtol=5e-3)


def test_light_with_shadows_disabled_passes_through_objects(tmp_path):
    """A plate between the light and the floor casts no shadow."""
    plate = 'def Cube "Plate"\n{\ndouble size = 1\ndouble3 xformOp:translate = (0, 1, 0)\n'
    plate += "float3 xformOp:scale = (9, 0.01, 1.2)\n"
    plate += 'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]\n}\n'
    lamp = light("SphereLight", SMALL)
    assert irradiance(tmp_path, plate + lamp)[0] == 0.0
    through = lamp.replace('"Light"', '"Light" (prepend apiSchemas = ["ShadowAPI"])').replace(
        "{", "{\nbool inputs:shadow:enable = 0", 1
    )
    np.testing.assert_allclose(irradiance(tmp_path, plate + through), math.pi * 0.01 / 4.0, rtol=5e-3)
