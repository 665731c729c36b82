# SPDX-License-Identifier: Apache-2.0
"""UsdGeomCamera: lenses in tenths of a scene unit, poses, exposure."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest

import tiscene as ts
from tests.usd.helpers import problems_of, read, read_with_warning, write
from tiscene.errors import CameraNotFound
from tiscene.usd.read.stage_reader import read_stage


def camera(lines: str = "") -> str:
    return f'def Camera "Eye"\n{{\n{lines}\n}}'


def only(description):
    (result,) = description.cameras
    return result


def test_default_camera(tmp_path):
    eye = only(read(tmp_path, camera()))
    assert eye.name == "Eye"
    assert eye.vertical_fov == pytest.approx(2.0 * math.atan(15.2908 / 100.0))
    assert eye.lens_radius == 0.0
    assert eye.exposure is None
    assert (eye.near, eye.far) == (0.1, 1000.0)
    assert eye.position == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("width", "framed"),
    [(40.0, 1.0), (5.0, 5.0)],
    ids=["a ground much wider than all else is not", "a floor is"],
)
def test_a_stage_without_a_camera_is_framed(tmp_path, width, framed):
    body = f"""
def Cube "Robot" {{
    double size = 1
}}
def Plane "Ground" {{
    double width = {width}
    double length = {width}
    uniform token axis = "Y"
}}"""
    half = 0.5 * framed
    assert read(tmp_path, body).camera() == ts.Camera.framing((-half, -0.5, -half), (half, 0.5, half))


def test_a_name_of_a_camera_on_a_stage_without_cameras_is_refused_with_advice(tmp_path):
    with pytest.raises(CameraNotFound, match=r"no camera 'Main' in scene 'stage'. It has none: give no name, or a"):
        read(tmp_path, 'def Cube "Box" {}').camera("Main")


def test_a_stage_of_grounds_alone_is_framed_whole(tmp_path):
    body = 'def Plane "Ground"\n{\n    uniform token axis = "Y"\n}'
    assert read(tmp_path, body).camera() == ts.Camera.framing((-1.0, 0.0, -1.0), (1.0, 0.0, 1.0))


def test_objects_that_a_scenario_moves_are_framed_as_if_they_stood(tmp_path):
    body = """
def Cube "Car" {
    double3 xformOp:translate.timeSamples = {1: (9, 0, 1), 24: (12, 0, 1)}
    uniform token[] xformOpOrder = ["xformOp:translate"]
}"""
    framed = ts.Camera.framing((8.0, -1.0, 0.0), (10.0, 1.0, 2.0))
    path = write(tmp_path, body)
    assert read_stage(path).camera() == read_stage(path, extract=["/Car"]).camera() == framed


@pytest.mark.parametrize("meters", [1.0, 0.01])
def test_lens_is_in_tenths_of_a_scene_unit(tmp_path, meters):
    """A 50 mm lens at f/2 on a 24 mm high sensor, focused at 3 m."""
    per_unit = 1.0 / meters
    lines = f"""
    float focalLength = {0.05 * per_unit * 10}
    float verticalAperture = {0.024 * per_unit * 10}
    float fStop = 2
    float focusDistance = {3 * per_unit}
    float2 clippingRange = ({0.5 * per_unit}, {20 * per_unit})
    """
    eye = only(read(tmp_path, camera(lines), meters=meters))
    assert eye.vertical_fov == pytest.approx(2.0 * math.atan(0.24 / 1.0 * 1.0), rel=1e-6)
    assert eye.lens_radius == pytest.approx(0.0125)  # 50 mm / 2 is 25 mm across
    assert eye.focus_distance == pytest.approx(3.0)
    assert (eye.near, eye.far) == pytest.approx((0.5, 20.0))


def test_depth_of_field_needs_a_focus_distance(tmp_path):
    assert only(read(tmp_path, camera("float fStop = 2"))).lens_radius == 0.0


def test_camera_pose_has_no_scale(tmp_path):
    lines = """
    double3 xformOp:translate = (1, 2, 3)
    float xformOp:rotateY = 90
    float3 xformOp:scale = (2, 2, 2)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateY", "xformOp:scale"]
    """
    eye = only(read(tmp_path, camera(lines), meters=0.01))
    assert eye.position == pytest.approx((0.01, 0.02, 0.03))
    np.testing.assert_allclose(eye.axes() @ (0, 0, -1), (-1, 0, 0), atol=1e-9)  # it looks along -x
    np.testing.assert_allclose(eye.axes() @ (0, 1, 0), (0, 1, 0), atol=1e-9)


MIRRORS = [("(-1, 1, 1)", -1, 1), ("(1, -1, 1)", -1, -1), ("(1, 1, -1)", 1, 1)]


@pytest.mark.parametrize(("scale", "ahead", "up"), MIRRORS)
def test_mirrored_camera_keeps_its_direction_and_up(tmp_path, scale, ahead, up):
    """Its image cannot be mirrored, which is reported; its direction and up vector are kept."""
    lines = f"""
    float xformOp:rotateY = 90
    float3 xformOp:scale = {scale}
    uniform token[] xformOpOrder = ["xformOp:rotateY", "xformOp:scale"]
    """
    eye = only(read_with_warning(tmp_path, camera(lines), "the image of a mirrored camera is not mirrored: </Eye>"))
    np.testing.assert_allclose(eye.axes() @ (0, 0, -1), (ahead, 0, 0), atol=1e-9)
    np.testing.assert_allclose(eye.axes() @ (0, 1, 0), (0, up, 0), atol=1e-9)


EXPOSURES = [
    ("float exposure = 2", 2.0),
    ("float exposure:iso = 400", 2.0),
    ("float exposure:time = 0.25", -2.0),
    ("float exposure:fStop = 4", -4.0),
    ("float exposure:responsivity = 8", 3.0),
    ("float exposure = 1\nfloat exposure:iso = 200\nfloat exposure:time = 0.5\nfloat exposure:fStop = 2", -1.0),
]


@pytest.mark.parametrize(("lines", "stops"), EXPOSURES)
def test_exposure(tmp_path, lines, stops):
    assert only(read(tmp_path, camera(lines))).exposure == pytest.approx(stops)


def test_orthographic_height_is_the_aperture(tmp_path):
    """The aperture is in tenths of a scene unit; focal length and lens are not used."""
    lines = """token projection = "orthographic"
    float verticalAperture = 300
    float focalLength = 0
    float fStop = 2
    float focusDistance = 5"""
    eye = only(read(tmp_path, camera(lines), meters=0.01))
    assert eye.orthographic_height == pytest.approx(0.3)
    assert eye.lens_radius == 0.0


def test_orthographic_camera_survives_a_file(tmp_path):
    write(tmp_path, 'def Cube "C" {}', meters=0.01, name="scene.usda")
    eye = ts.Camera((1, 2, 3), orthographic_height=1.7, name="Plan")
    for name in ("run.usda", "run.json"):
        ts.Scenario(str(tmp_path / "scene.usda"), camera=eye).save(tmp_path / name)
        assert ts.Scenario.load(tmp_path / name).camera == eye


OMITTED = [
    ("float4[] clippingPlanes = [(0, 0, 1, 5)]", "clippingPlanes of a camera cut nothing: </Eye>", 1),
    ("float2 clippingRange = (5, 1)", "clippingRange of 5 to 1 m is not used: </Eye>", 1),
    ('token projection = "spherical"', "projection 'spherical' is not known; 'perspective' is used: </Eye>", 1),
    ('custom token cameraProjectionType = "fisheyeSpherical"', "cameraProjectionType 'fisheyeSpherical' is drawn", 1),
    ('custom token omni:lensdistortion:model = "ftheta"', "model 'ftheta' is drawn without distortion: </Eye>", 1),
]


@pytest.mark.parametrize(("lines", "expected", "count"), OMITTED)
def test_unsupported_camera_attributes_are_reported(tmp_path, lines, expected, count):
    assert len(read_with_warning(tmp_path, camera(lines), expected).cameras) == count


def test_back_plates_are_named(tmp_path):
    body = camera("asset backPlate:far:image = @a.png@").replace('"Eye"', '"Eye" (apiSchemas = ["BackPlateAPI:far"])')
    read_with_warning(tmp_path, body, "back plates of a camera are not drawn: </Eye>")


WRONG = [
    ("float focalLength = 0", "camera: verticalAperture 15.29"),
    ("float verticalAperture = nan", "camera: verticalAperture nan"),
    ("float exposure:time = 0", "camera: its exposure attributes scale the image by 0.0"),
    ("float exposure:fStop = 0", "camera: its exposure attributes scale the image by nan"),
    ("float exposure = 2000", "camera: its exposure attributes scale the image by nan"),
    (
        'float3 xformOp:scale = (0, 1, 1)\nuniform token[] xformOpOrder = ["xformOp:scale"]',
        "camera: its transform is singular or not finite",
    ),
    (
        'double3 xformOp:translate = (inf, inf, inf)\nuniform token[] xformOpOrder = ["xformOp:translate"]',
        "camera: its transform is singular or not finite",
    ),
]


@pytest.mark.parametrize(("lines", "expected"), WRONG)
def test_invalid_cameras_are_problems(tmp_path, lines, expected):
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        (problem,) = problems_of(tmp_path, camera(lines))
    assert problem.startswith(f"</Eye> {expected}")


CAMERAS = """
def Xform "A" {
    def Camera "Main" {
        double3 xformOp:translate = (0, 0, 5)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
}
def Xform "B" {
    def Camera "Main" {
        double3 xformOp:translate = (0, 0, 6)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def Camera "Walks" {
        double3 xformOp:translate.timeSamples = { 0: (0, 0, 7), 24: (0, 0, 9) }
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def Cube "Box" {}
}
"""
PLACES = {"/A/Main": 5, "Main": 5, "/B/Main": 6, "B/Main": 6, "/B/Walks": 8, "Walks": 8}


def at_second_12(scenario):
    """Return where the cameras of a scenario are after half a second, along z."""
    world = ts.Stream(scenario, width=8, height=6, buffers=("depth",), fps=24).world
    return [world.camera_at(12, each.name).position[2] for each in world.cameras]


@pytest.mark.parametrize("name", PLACES)
def test_cameras_are_found_by_name_and_by_prim_path(tmp_path, name):
    stage = str(write(tmp_path, CAMERAS))
    assert at_second_12(ts.Scenario.load(stage, camera=name)) == [pytest.approx(PLACES[name])]
    stream = ts.Stream(stage, camera=name, width=8, height=6, buffers=("depth",))
    stream.world.move_camera((0, 0, 20), camera=name)
    assert stream.world.camera_at(0, name).position == (0, 0, 20)
    again = ts.Stream(stream.scenario, width=8, height=6, buffers=("depth",))
    assert again.world.camera_at(0).position == (0, 0, 20)


@pytest.mark.parametrize("name", ["/B/Main", "B/Main", "/A/Main", "Main"])
def test_cameras_that_share_a_name_survive_layers(tmp_path, name):
    """The layer named the first camera of that name, and baked motion left the second one out."""
    stage = str(write(tmp_path, CAMERAS))
    scenario = ts.Scenario(stage, camera=(name, "Walks"))
    scenario.save(tmp_path / "run.usda")
    assert at_second_12(ts.Scenario.load(tmp_path / "run.usda"))[0] == PLACES[name]
    ts.Stream(scenario, width=8, height=6, buffers=("depth",)).to_usd(tmp_path / "motion.usda", 2)
    assert at_second_12(ts.Scenario.load(tmp_path / "motion.usda"))[0] == PLACES[name]


def test_unknown_camera_names_those_that_there_are(tmp_path):
    with pytest.raises(CameraNotFound, match=r"Did you mean 'B/Main'|There are: B/Main, Main, Walks"):
        ts.Stream(write(tmp_path, CAMERAS), camera="/C/Eye")
