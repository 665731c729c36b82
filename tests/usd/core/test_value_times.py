# SPDX-License-Identifier: Apache-2.0
"""Value blocks and splines of attributes play as `Usd.Attribute.Get` has them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pxr import Usd, UsdGeom

import tiscene as ts
from tests.usd.helpers import write
from tiscene.usd.core.value_times import value_times
from tiscene.usd.read.stage_reader import read_stage

BLOCKED = """.timeSamples = {
        0: %s,
        10: None,
        20: %s,
        30: %s,
    }"""
CURVE = """.spline = {
        bezier,
        0: %g; pre (5, 0); post curve (5, 0),
        20: %g; pre (5, 0); post held,
        25: %g & %g; post linear,
        30: %g; post linear,
    }"""
RANGE = "startTimeCode = 0\n    endTimeCode = 40\n    timeCodesPerSecond = 24"
STAGE = """
def Cube "Body" (prepend apiSchemas = ["MaterialBindingAPI"]) {
    %s
    uniform token[] xformOpOrder = ["%s"]
    double size = 2
    rel material:binding = </Paint>
}
def Camera "Camera" {
    double3 xformOp:translate = (0, 0, 50)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def SphereLight "Lamp" {
    float inputs:intensity%s
    float inputs:radius%s
}
def Material "Paint" {
    token outputs:surface.connect = </Paint/Surface.outputs:surface>
    def Shader "Surface" {
        uniform token info:id = "UsdPreviewSurface"
        float inputs:roughness%s
        token outputs:surface
    }
}
"""


def blocked(*values: object) -> str:
    return BLOCKED % values


def curve(scale: float) -> str:
    return CURVE % tuple(scale * each for each in (1.0, 4.0, 3.0, 2.0, 1.0))


BODIES = {
    "blocks": STAGE
    % (
        "double3 xformOp:translate" + blocked((1, 0, 0), (5, 0, 0), (7, 0, 0)),
        "xformOp:translate",
        *(blocked(1, 5, 7), blocked(0.1, 0.2, 0.4), blocked(0.1, 0.2, 0.4)),
    ),
    "splines": STAGE
    % ("double xformOp:translateX" + curve(1.0), "xformOp:translateX", *(curve(1.0), curve(0.1), curve(0.1))),
}


@pytest.mark.parametrize("name", BODIES)
def test_objects_lights_and_materials_play_as_usd_reads_them(tmp_path, name):
    path = write(tmp_path, BODIES[name], more=RANGE)
    stage = Usd.Stage.Open(str(path))
    scene = ts.Stream(path, width=16, height=16, buffers=("instance", "roughness"), fps=24.0)

    def value(prim: str, attribute: str, time: float, default: float) -> float:
        found = stage.GetPrimAtPath(prim).GetAttribute(attribute).Get(time)
        return default if found is None else found  # a blocked value is that of the schema

    for frame in (0, 4, 9, 10, 13, 19, 20, 22, 24, 25, 27, 30, 36):
        world = UsdGeom.Xformable(stage.GetPrimAtPath("/Body")).ComputeLocalToWorldTransform(frame)
        image = scene[frame]
        np.testing.assert_allclose(image.objects[0].position, world.ExtractTranslation(), atol=1e-6)
        roughness = image.roughness[image.instance > 0]
        assert roughness.size
        np.testing.assert_allclose(roughness, value("/Paint/Surface", "inputs:roughness", frame, 0.5), atol=1e-6)
        (lamp,) = scene.world.state(frame).lights
        assert lamp.radius == pytest.approx(value("/Lamp", "inputs:radius", frame, 0.5), abs=1e-6)
        assert lamp.radiance[0] == pytest.approx(value("/Lamp", "inputs:intensity", frame, 1.0), abs=1e-6)


@pytest.mark.parametrize("samples", [curve(1.0), blocked(1, 5, 7)], ids=["spline", "blocks"])
def test_animated_size_deforms_its_gprim(tmp_path, samples):
    path = write(tmp_path, 'def Cube "Body"\n{\n    double size' + samples + "\n}", more=RANGE)
    stage = Usd.Stage.Open(str(path))
    size = stage.GetPrimAtPath("/Body").GetAttribute("size")
    times = [1.0 * frame for frame in range(31)]
    (deformation,) = [each.deformation for each in read_stage(path).meshes if each.deformation is not None]
    extent = [float(np.ptp(deformation.at(time / 24.0)[0][:, 0])) for time in times]
    expected = [2.0 if size.Get(time) is None else size.Get(time) for time in times]  # 2 is the schema's
    np.testing.assert_allclose(extent, expected, rtol=1e-5)


def test_camera_with_a_blocked_sample_has_the_lens_of_the_schema(tmp_path):
    body = 'def Camera "Camera"\n{\n    float focalLength.timeSamples = {\n        0: None,\n    }\n'
    body += "    float2 clippingRange.timeSamples = {\n        0: None,\n    }\n}\n"
    (camera,) = read_stage(write(tmp_path, body + 'def Cube "Body" {}', more=RANGE)).cameras
    assert camera.vertical_fov == pytest.approx(2.0 * math.atan(15.2908 / 100.0))
    assert (camera.near, camera.far) == pytest.approx((1.0, 1e6))


def test_values_between_value_times_are_linear(tmp_path):
    """Just before a jump, the value before the jump is held."""
    body = 'def Scope "S"\n{\n    double blocked' + blocked(1, 5, 7) + "\n    double curve" + curve(1.0) + "\n}"
    stage = Usd.Stage.Open(str(write(tmp_path, body, more=RANGE)))
    prim = stage.GetPrimAtPath("/S")
    times = value_times(prim.GetAttribute("blocked"))
    assert times == pytest.approx([0, 10, 10, 20, 20, 30], abs=1e-6)
    assert len(set(times)) == 6
    attribute = prim.GetAttribute("curve")
    times = value_times(attribute)
    assert len([time for time in times if 24.9 < time < 25.0]) == 1
    held = list(np.arange(20.0, 40.0, 0.1))
    np.testing.assert_allclose(
        np.interp(held, times, [attribute.Get(t) for t in times]), [attribute.Get(t) for t in held]
    )


TURNING = """
def Xform "Wheel" (kind = "component") {
    float xformOp:rotateZ.timeSamples = { 0: 0, %(end)g: 360 }
    uniform token[] xformOpOrder = ["xformOp:rotateZ"]
    def Cube "Weight" {
        double3 xformOp:translate = (0, 2, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
}
def Xform "Machine" (kind = "component") {
    def Cube "Body" {
        double3 xformOp:translate = (8, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def Cube "Crank" {
        float xformOp:rotateZ.timeSamples = { 0: 0, %(end)g: -720 }
        double3 xformOp:translate = (0, 5, 0)
        uniform token[] xformOpOrder = ["xformOp:rotateZ", "xformOp:translate"]
    }
}
def BasisCurves "Hand" {
    uniform token type = "linear"
    int[] curveVertexCounts = [2]
    float[] widths = [2]
    point3f[] points.timeSamples = { 0: [(-8, 0, 0), (-5, 0, 0)], %(end)g: [(-8, 0, 0), (-8, 3, 0)] }
}
def Camera "Camera" {
    double3 xformOp:translate = (0, 0, 30)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    float focalLength.timeSamples = { 0: 15, %(end)g: 20 }
    float horizontalAperture.timeSamples = { 0: 20, %(end)g: 16 }
}
"""


def test_stage_whose_time_codes_are_seconds_plays_as_one_of_frames(tmp_path):
    """A second is one time code or 24: what turns goes around, and does not take the shortest way."""
    seen = []
    for rate in (24, 1):
        folder = tmp_path / f"{rate}"
        folder.mkdir()
        more = f"startTimeCode = 0\n    endTimeCode = {rate}\n    timeCodesPerSecond = {rate}"
        path = write(folder, TURNING % {"end": rate}, more=more)
        seen.append(ts.Stream(path, width=64, height=48, fps=48, buffers=("instance", "position", "forward_flow")))
    for k in (0, 7, 24, 41):
        frames, seconds = (stream[k] for stream in seen)
        assert len(np.unique(frames.instance)) == 4
        np.testing.assert_array_equal(seconds.instance, frames.instance)
        np.testing.assert_allclose(seconds.position, frames.position, atol=1e-4)
        np.testing.assert_allclose(seconds.forward_flow, frames.forward_flow, atol=1e-3)
