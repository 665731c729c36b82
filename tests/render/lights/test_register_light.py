# SPDX-License-Identifier: Apache-2.0
"""A kind of light from outside the package, in one file: a triangle that emits from one side.

The scene is rendered in a process of its own, since kinds must be registered before kernels are compiled. It compiles
all kernels that sample lights, for which it takes a minute.
"""

import json
import math
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import taichi as ti

from tiscene.device.kernel_types import Template, vec2, vec3
from tiscene.errors import ArgumentError
from tiscene.render.lights.light_kernels import LIGHT_KERNELS, register_light, unregister_light
from tiscene.render.lights.light_sample import axis, color, no_sample
from tiscene.scene.description import Color, Light
from tiscene.scene.lights.light_kinds import (
    BUILT_IN_KINDS,
    LIGHT_KINDS,
    LightKind,
    LightShape,
    UsdLightInputs,
    close_registry,
)
from tiscene.scene.lights.light_table import SIZE

RADIANCE, WIDTH, HEIGHT, ALTITUDE = 3.0, 0.8, 0.5, 0.9
LAYER = f"""#usda 1.0
( metersPerUnit = 1
  upAxis = "Z" )
def Xform "World" {{
    double3 xformOp:translate = (0, 0, {ALTITUDE})
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def TriangleLight "lamp" (prepend apiSchemas = ["LightAPI"]) {{
        float inputs:intensity = {RADIANCE}
        float inputs:width = {WIDTH}
        float inputs:height = {HEIGHT}
    }}
}}
"""


@dataclass(frozen=True, eq=False)
class TriangleLight(Light):
    """A right triangle with legs from the light's origin along +x (`width`, m) and +y (`height`); emits towards -z."""

    radiance: Color
    width: float
    height: float


def triangle_shape(light: TriangleLight, luminance: float) -> LightShape:
    area = 0.5 * light.width * light.height
    extent = (light.width, light.height, 0.0)
    size = (light.width, light.height)
    return LightShape(size, area * luminance, True, area / (2.0 * math.pi), box=extent)


def read_triangle(prim: UsdLightInputs) -> TriangleLight:
    width, height = (
        prim.value(name, 1.0) * scale * prim.meters_per_unit
        for name, scale in zip(("width", "height"), prim.scale[:2], strict=True)
    )
    return TriangleLight(prim.name, prim.prim_path, prim.world_from_light, prim.emission, width, height)


@ti.func
def sample(lights: Template, textures: Template, row: ti.i32, origin: vec3, u: vec2):
    values = ti.static(lights.values)
    result = no_sample()
    root = ti.sqrt(u.x)
    x, y = values[row, SIZE] * root * (1.0 - u.y), values[row, SIZE + 1] * root * u.y
    offset = axis(values, row, 3) + axis(values, row, 0) * x + axis(values, row, 1) * y - origin
    distance = offset.norm()
    if axis(values, row, 2).dot(offset) > 0.0:
        result.direction = offset / distance
        result.distance = distance
        result.pdf = pdf(lights, row, origin, result.direction, distance)
        result.radiance = color(values, row)
    return result


@ti.func
def pdf(lights: Template, row: ti.i32, origin: vec3, direction: vec3, distance: ti.f32) -> ti.f32:
    values = ti.static(lights.values)
    cosine = ti.max(axis(values, row, 2).dot(direction), 1e-9)
    return 2.0 * distance * distance / (cosine * values[row, SIZE] * values[row, SIZE + 1])


@ti.func
def intersect(lights: Template, row: ti.i32, origin: vec3, direction: vec3) -> ti.f32:
    values = ti.static(lights.values)
    result = ti.math.inf
    offset = axis(values, row, 3) - origin
    cosine = axis(values, row, 2).dot(direction)
    distance = axis(values, row, 2).dot(offset) / cosine
    if cosine > 0.0 and distance > 0.0:
        q = direction * distance - offset
        x, y = axis(values, row, 0).dot(q) / values[row, SIZE], axis(values, row, 1).dot(q) / values[row, SIZE + 1]
        if x >= 0.0 and y >= 0.0 and x + y <= 1.0:
            result = distance
    return result


@ti.func
def emitted(lights: Template, textures: Template, row: ti.i32, origin: vec3, direction: vec3, distance: ti.f32) -> vec3:
    return color(lights.values, row)


TRIANGLE = LightKind("triangle", TriangleLight, shape=triangle_shape, usd={"TriangleLight": read_triangle})
KERNELS = {"sample": sample, "pdf": pdf, "intersect": intersect, "emitted": emitted}


def polygon_irradiance(corners: np.ndarray, point: np.ndarray, normal: np.ndarray) -> float:
    """Return Lambert's irradiance from a polygon of radiance 1 whose plane the normal faces."""
    to_corner = corners - point
    to_corner /= np.linalg.norm(to_corner, axis=1, keepdims=True)
    total = 0.0
    for a, b in zip(to_corner, np.roll(to_corner, -1, axis=0), strict=True):
        edge = np.cross(a, b)
        total += math.acos(float(a @ b)) * float(edge @ normal) / float(np.linalg.norm(edge))
    return 0.5 * abs(total)


def run(folder: Path) -> None:
    """Read the layer with the kind registered, render a white floor below the light; prints figures as JSON."""
    from tests.render.path_scenes import described, matte, quad, render
    from tiscene.scene.camera import Camera
    from tiscene.usd.read.stage_reader import read_stage

    register_light(TRIANGLE, **KERNELS)
    (light,) = read_stage(folder / "scene.usda").lights
    a = 2.0
    floor = quad((-a, -a, 0.0), (a, -a, 0.0), (a, a, 0.0), (-a, a, 0.0))
    scene = described([floor], [matte("white", (1.0, 1.0, 1.0))], [light])
    result = {"light": type(light).__name__, "size": (light.width, light.height), "radiance": light.radiance}
    for position in ((0.2, 0.1), (-0.7, 0.4)):
        # A narrow view from beside the light, of one point of the floor; a path of two segments sees direct light.
        camera = Camera.look_at((*position, 0.3), (*position, 0.0), up=(0.0, 1.0, 0.0), vertical_fov=1e-3)
        for mis in (True, False):
            image = render(scene, camera, (16, 16), spp=256, max_depth=2, mis=mis)
            result[f"{position} mis={mis}"] = float(image.hdr[..., 1].mean())
    above = Camera.look_at((WIDTH / 4, HEIGHT / 4, 0.3), (WIDTH / 4, HEIGHT / 4, ALTITUDE), vertical_fov=1e-3)
    result["visible"] = render(scene, above, (2, 2), spp=1).hdr[0, 0].tolist()
    unregister_light("triangle")
    result["kinds"] = len(LIGHT_KINDS)
    print(json.dumps(result))


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> dict[str, object]:
    folder = tmp_path_factory.mktemp("registered")
    (folder / "scene.usda").write_text(LAYER)
    code = f"from pathlib import Path; from {__name__} import run; run(Path({str(folder)!r}))"
    made = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert made.returncode == 0, made.stderr
    answer: dict[str, object] = json.loads(made.stdout.splitlines()[-1])
    return answer


@pytest.mark.slow
def test_registered_light_is_read_from_usd(rendered: dict[str, object]) -> None:
    assert rendered["light"] == "TriangleLight"
    assert rendered["size"] == pytest.approx([WIDTH, HEIGHT])
    assert rendered["radiance"] == pytest.approx([RADIANCE] * 3)


@pytest.mark.slow
@pytest.mark.parametrize("position", [(0.2, 0.1), (-0.7, 0.4)])
@pytest.mark.parametrize("mis", [True, False])
def test_registered_light_gives_closed_form_irradiance(
    rendered: dict[str, object], position: tuple[float, float], mis: bool
) -> None:
    corners = np.array([[0.0, 0.0, ALTITUDE], [WIDTH, 0.0, ALTITUDE], [0.0, HEIGHT, ALTITUDE]])
    irradiance = RADIANCE * polygon_irradiance(corners, np.array([*position, 0.0]), np.array([0.0, 0.0, 1.0]))
    assert rendered[f"{position} mis={mis}"] == pytest.approx(irradiance / math.pi, rel=5e-3)


@pytest.mark.slow
def test_camera_sees_registered_light(rendered: dict[str, object]) -> None:
    assert rendered["visible"] == pytest.approx([RADIANCE] * 3)


@pytest.mark.slow
def test_unregister_removes_kind(rendered: dict[str, object]) -> None:
    assert rendered["kinds"] == BUILT_IN_KINDS == len(LIGHT_KINDS)


def test_usd_documentation_lists_all_kinds() -> None:
    page = (Path(__file__).parents[3] / "docs/usd.md").read_text(encoding="utf-8")
    (row,) = (line for line in page.splitlines() if line.startswith("| Lights |"))
    for kind in LIGHT_KINDS:
        if kind.light is not None:
            assert kind.light.__name__.removesuffix("Light") in row


def test_register_refuses_taken_names_and_incomplete_entries() -> None:
    with pytest.raises(ArgumentError, match="'disk' is registered already"):
        register_light(LightKind("disk", TriangleLight, shape=triangle_shape), **KERNELS)
    with pytest.raises(ArgumentError, match="'flat': a registered kind needs light=, shape= and group=AREA"):
        register_light(LightKind("flat", TriangleLight), **KERNELS)
    with pytest.raises(ArgumentError, match="'rect' is not the one registered last"):
        unregister_light("rect")


def test_register_refuses_kinds_after_a_scene_was_rendered() -> None:
    close_registry()
    known = len(LIGHT_KERNELS)
    with pytest.raises(ArgumentError, match="register it before the first scene is rendered"):
        register_light(TRIANGLE, **KERNELS)
    assert len(LIGHT_KERNELS) == known
