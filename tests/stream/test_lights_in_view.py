# SPDX-License-Identifier: Apache-2.0
"""Lights in view, lights that leave objects out of their shadows, and images of a few pixels, in whole frames."""

import math

import numpy as np
import pytest

import tiscene as ts
from tests.usd.helpers import write
from tests.usd.lights.test_light_linking_stages import CLOTH

RANGE = "startTimeCode = 0\n    endTimeCode = 100\n    timeCodesPerSecond = 25"
FLOOR = """
def Cube "Floor" {
    double size = 6
    double3 xformOp:translate = (0, -3, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    color3f[] primvars:displayColor = [(0.5, 0.5, 0.5)]
}
"""
LAMP = """
def Cube "Wall" {
    double size = 6
    double3 xformOp:translate = (0, 0, -5)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def SphereLight "Lamp" {
    float inputs:intensity = 10
    float inputs:radius = 0.3
    double3 xformOp:translate.timeSamples = {0: (-0.1, 1, 0), 20: (0.1, 1, 0)}
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Camera "Camera" {
    float focalLength = 50
    float horizontalAperture = 25
    float verticalAperture = 25
    double3 xformOp:translate = (0, 1, 5)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""
BALL = """
def Sphere "Ball" {
    double radius = 0.4
    double3 xformOp:translate.timeSamples = {0: (-0.5, 1, 0), 20: (0.5, 1, 0)}
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def DistantLight "Sun" (prepend apiSchemas = ["CollectionAPI:shadowLink"]) {
    float inputs:intensity = 3
    float inputs:angle = 0.5
    bool inputs:normalize = 1
    uniform bool collection:shadowLink:includeRoot = 1
    rel collection:shadowLink:excludes = </Ball>
    double xformOp:rotateX = -90
    uniform token[] xformOpOrder = ["xformOp:rotateX"]
}
def Camera "Camera" {
    double3 xformOp:translate = (0, 3, 4)
    double xformOp:rotateX = -35
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateX"]
}
"""
# Below the floor. It selects the variant of the shading kernel that other tests of links compile.
HIDDEN = CLOTH.replace("(0, 9, 0)", "(0, -9, 0)")


@pytest.fixture
def frame_of(tmp_path):
    def render(parts, index, **settings):
        with ts.Stream(write(tmp_path, FLOOR + parts, more=RANGE), **settings) as stream:
            return stream[index]

    return render


def test_lamp_in_front_of_a_wall_is_bright_where_light_is_traced_at_half_size(frame_of):
    frame = frame_of(LAMP, 10, width=96, height=64, quality="fast", buffers=("hdr",))
    assert frame.hdr[28:36, 44:52].mean() == pytest.approx(10.0, rel=0.05)


@pytest.mark.parametrize("quality", ["fast", "standard"])
def test_dynamic_object_that_a_light_leaves_out_of_its_shadows_casts_none(frame_of, quality):
    settings = {"width": 64, "height": 48, "spp": 4, "max_depth": 2, "quality": quality, "incremental": True}
    frame = frame_of(BALL + HIDDEN, 10, buffers=("hdr", "position"), **settings)
    x, y, z = np.moveaxis(frame.position, -1, 0)
    below = (np.abs(y) < 1e-3) & (np.hypot(x, z) < 0.3)
    assert below.sum() > 20
    irradiance = frame.hdr[below].mean() * math.pi / 0.5
    assert irradiance == pytest.approx(3.0, rel=0.05)


@pytest.mark.parametrize("quality", ["fast", "preview"])
def test_images_of_one_pixel_are_rendered_incrementally(frame_of, quality):
    frame = frame_of(BALL + HIDDEN, 1, width=1, height=1, quality=quality, buffers=("hdr", "denoised"))
    np.testing.assert_allclose(frame.denoised, frame.hdr, rtol=0.4)
