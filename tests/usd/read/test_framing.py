# SPDX-License-Identifier: Apache-2.0
"""Framing of cameras: OpenUSD's conform policies, and what RenderSettings say about camera and resolution."""

from __future__ import annotations

import math
import re
import warnings

import numpy as np
import pytest

import tiscene as ts
from tests.usd.helpers import read, read_with_warning, write
from tiscene.errors import ArgumentError, StageWarning
from tiscene.scene.camera import Camera
from tiscene.usd.read.stage_reader import read_stage

WIDE = """def Camera "Wide" {
    float horizontalAperture = 40
    float verticalAperture = 20
    float focalLength = 10
    double3 xformOp:translate = (0, 0, 5)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Camera "Ortho" {
    token projection = "orthographic"
    float horizontalAperture = 40
    float verticalAperture = 20
}
def Cube "C" {}
"""
SETTINGS = """def RenderSettings "Settings" {
    %s
}
"""


def tangent(camera: Camera) -> float:
    return math.tan(0.5 * camera.vertical_fov)


@pytest.mark.parametrize(
    ("policy", "square", "wider"),
    [  # half the height over the distance: the aperture is 4 wide, 2 high at a distance of 1; images are 1:1 and 4:1
        ("expandAperture", 2.0, 1.0),
        ("cropAperture", 1.0, 0.5),
        ("adjustApertureHeight", 2.0, 0.5),
        ("adjustApertureWidth", 1.0, 1.0),
    ],
)
def test_policy_decides_the_height_of_the_view(tmp_path, policy, square, wider):
    settings = SETTINGS % f'uniform token aspectRatioConformPolicy = "{policy}"'
    description = read(tmp_path, WIDE + settings, more='renderSettingsPrimPath = "/Settings"')
    camera, orthographic = description.cameras
    assert tangent(camera.framed(2.0)) == pytest.approx(1.0)
    assert tangent(camera.framed(1.0)) == pytest.approx(square)
    assert tangent(camera.framed(4.0)) == pytest.approx(wider)
    assert orthographic.framed(1.0).orthographic_height == pytest.approx(2.0 * square)  # tenths of a meter
    assert camera.framed(1.0).aspect is None


def test_default_policy_expands_the_aperture(tmp_path):
    camera = read(tmp_path, WIDE).cameras[0]
    assert tangent(camera.framed(1.0)) == pytest.approx(2.0)
    assert camera.framed(2.0).vertical_fov == camera.vertical_fov


def test_image_shows_the_whole_aperture(tmp_path):
    """The aperture's width spans 4 at a distance of 1, so 20 at the cube's center: 2 m of them are the cube's."""
    path = write(tmp_path, WIDE)
    with ts.Stream(path, width=20, height=20, buffers=("instance",), camera="Wide") as stream:
        seen = stream[0].instance > 0
        assert stream[0].camera.K[0, 0] == pytest.approx(5.0)  # 20 px over 4
    assert seen.any(axis=0).sum() == seen.any(axis=1).sum() == 2  # its front at 4 m: 2 of 16 m, 2.5 px


def test_camera_and_resolution_of_render_settings_are_the_defaults(tmp_path):
    settings = SETTINGS % "rel camera = </Ortho>\nuniform int2 resolution = (30, 20)"
    path = write(tmp_path, WIDE + settings, more='renderSettingsPrimPath = "/Settings"')
    assert read_stage(path).camera().name == "Ortho"
    options = {"buffers": ("depth",)}
    with ts.Stream(path, **options) as stream:
        assert stream[0].depth.shape == (20, 30)
        assert stream.world.camera.name == "Ortho"
    for size, shape in (({"width": 15}, (10, 15)), ({"height": 10}, (10, 15)), ({"width": 8, "height": 9}, (9, 8))):
        with ts.Stream(path, **size, **options) as stream:
            assert stream[0].depth.shape == shape
    with ts.Stream(path, camera="Wide", **options) as stream:
        assert stream.world.camera.name == "Wide"


def test_the_only_render_settings_and_their_product_count_without_metadata(tmp_path):
    product = 'def RenderProduct "P"\n{\nrel camera = </Ortho>\n}\n'
    settings = SETTINGS % "rel camera = </Wide>\nrel products = </P>\nuniform int2 resolution = (30, 20)"
    description = read(tmp_path, WIDE + product + settings)
    assert description.camera().name == "Ortho"
    assert description.resolution == (30, 20)
    assert read(tmp_path, WIDE).resolution is None


@pytest.mark.parametrize(
    ("line", "lens_radius", "shutter"),
    [
        ("", 0.1, (-0.25, 0.5)),
        ("uniform bool disableDepthOfField = 1", 0.0, (-0.25, 0.5)),
        ("uniform bool disableMotionBlur = 1", 0.1, (0.0, 0.0)),
        ("uniform bool instantaneousShutter = 1", 0.1, (0.0, 0.0)),
        ("uniform bool disableMotionBlur = 0\nrel products = </P>", 0.1, (0.0, 0.0)),
    ],
)
def test_settings_switch_depth_of_field_and_motion_blur_off(tmp_path, line, lens_radius, shutter):
    lens = "float fStop = 5\nfloat focusDistance = 5\ndouble shutter:open = -0.25\ndouble shutter:close = 0.5"
    product = 'def RenderProduct "P"\n{\nuniform bool disableMotionBlur = 1\n}\n'
    camera, _ = read(
        tmp_path, WIDE.replace("float focal", f"{lens}\nfloat focal", 1) + product + SETTINGS % line
    ).cameras
    assert camera.lens_radius == pytest.approx(lens_radius)
    assert (camera.shutter_open, camera.shutter_close) == shutter


@pytest.mark.parametrize(
    ("line", "text"),
    [
        ("rel camera = </Nowhere>", "the camera of the RenderSettings does not exist"),
        ("uniform int2 resolution = (0, 20)", r"the resolution \(0, 20\)"),
        ("uniform float pixelAspectRatio = 2", "pixelAspectRatio is not applied"),
        ('uniform token[] includedPurposes = ["default", "proxy"]', "includedPurposes is not applied"),
        ("uniform float4 dataWindowNDC = (0, 0, 0.5, 1)", "dataWindowNDC is not applied"),
        (
            'uniform token aspectRatioConformPolicy = "adjustPixelAspectRatio"',
            "'adjustPixelAspectRatio' is not applied",
        ),
    ],
)
def test_settings_that_are_not_applied_are_named(tmp_path, line, text):
    description = read_with_warning(tmp_path, WIDE + SETTINGS % line, text)
    assert description.camera().name == "Wide"


@pytest.mark.parametrize("value", ["0", "1e+38", "nan"])
def test_horizontal_aperture_that_makes_no_image_is_named(tmp_path, value):
    body = WIDE.replace("horizontalAperture = 40", f"horizontalAperture = {value}", 1)
    description = read_with_warning(tmp_path, body, re.escape(f"horizontalAperture of {value} is not used"))
    assert description.cameras[0].aspect is None


def test_shape_of_a_camera_must_be_valid():
    with pytest.raises(ArgumentError, match="aspect=0"):
        Camera(aspect=0)
    with pytest.raises(ArgumentError, match="conform='fit': must be one of expandAperture"):
        Camera(conform="fit")


def test_moving_camera_keeps_its_aperture_in_a_written_scenario(tmp_path):
    moving = WIDE.replace(
        "double3 xformOp:translate = (0, 0, 5)",
        "double3 xformOp:translate.timeSamples = { 0: (0, 0, 5), 9: (0, 0, 4) }",
    )
    path = write(tmp_path, moving, more="startTimeCode = 0\nendTimeCode = 9")
    with warnings.catch_warnings():
        warnings.simplefilter("error", StageWarning)
        scenario = ts.Scenario.load(path)
    assert scenario.camera.aspect == 2.0
    for name in ("scenario.json", "scenario.usda"):
        scenario.save(tmp_path / name)
        loaded = ts.Scenario.load(tmp_path / name)
        assert (loaded.camera.aspect, loaded.camera.conform) == (2.0, "expandAperture")
    with ts.Stream(scenario, width=8, height=8, buffers=("depth",)) as stream:
        assert np.isclose(stream[0].camera.K[0, 0], 2.0)  # 8 px over 4
