# SPDX-License-Identifier: Apache-2.0
"""UsdGeomCameras whose lenses have time samples: pictures, labels and flow of every frame, and layers with them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pxr import Usd, UsdGeom

import tiscene as ts
from tests.usd.helpers import read, read_with_warning, write
from tiscene.sailenv.scene_profile import SceneProfile
from tiscene.scene.camera import Camera
from tiscene.usd.core.stage import open_stage
from tiscene.usd.read.stage_reader import read_stage

WIDTH, HEIGHT = 64, 48
RANGE = "startTimeCode = 1\n    endTimeCode = 9\n    timeCodesPerSecond = 4"
FPS = 4
BODY = """
def Camera "Zoom" {
    %s
    float horizontalAperture = 32
    float verticalAperture.timeSamples = { 1: 24, 9: 30 }
    float focalLength.timeSamples = { 1: 24, 4: 40, 9: 30 }
    float horizontalApertureOffset.timeSamples = { 1: 0, 6: 5 }
    float verticalApertureOffset.timeSamples = { 3: -2, 9: 1 }
    float focusDistance.timeSamples = { 1: 3, 9: 7 }
    float2 clippingRange.timeSamples = { 1: (0.1, 100), 9: (0.5, 50) }
    float exposure.timeSamples = { 1: 0, 9: 2 }
    double3 xformOp:translate%s
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Cube "Still" {
    double size = 1
    float3 xformOp:rotateXYZ = (20, 30, 10)
    double3 xformOp:translate = (-0.8, 0, -1)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]
}
def Cube "Mover" (kind = "component") {
    double size = 1
    double3 xformOp:translate.timeSamples = { 1: (0.8, 0, 0), 9: (0.6, 0.4, -0.5) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def DomeLight "Sky" {}
"""
EYE = """
def Camera "Eye" {
    float horizontalAperture = 32
    float verticalAperture = 24
    %s
}
def Plane "Lamp" (prepend apiSchemas = ["MeshLightAPI"]) {
    uniform token axis = "Z"
    double width = 2
    double length = 2
    double3 xformOp:translate = %s
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""
STANDS, WALKS = " = (0, 0.2, 5)", ".timeSamples = { 1: (0, 0.2, 5), 9: (0.4, 0, 4) }"
LABELS = ("instance", "position", "scene_flow", "forward_flow", "backward_flow", "depth")


def stage_with(folder, projection="", place=STANDS):
    return write(folder, BODY % (projection, place), more=RANGE)


def stream_of(path, **options):
    return ts.Stream(path, width=WIDTH, height=HEIGHT, fps=FPS, **{"buffers": LABELS, **options})


def projected(path, code, points):
    """Project world points [..., 3] to pixels by OpenUSD's own frustum of the camera at a time code."""
    stage = Usd.Stage.Open(str(path))
    lens = UsdGeom.Camera(stage.GetPrimAtPath("/Zoom")).GetCamera(min(max(code, 1), 9))
    width, height = lens.horizontalAperture, lens.verticalAperture
    lens.horizontalAperture, lens.verticalAperture = max(width, height * 4 / 3), max(height, width * 3 / 4)  # to 4:3
    matrix = np.array(lens.frustum.ComputeViewMatrix() * lens.frustum.ComputeProjectionMatrix())
    seen = np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1) @ matrix
    return (seen[..., :2] / seen[..., 3:] * (0.5, -0.5) + 0.5) * (WIDTH, HEIGHT) - 0.5


def pixel_centers():
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    return np.stack([x, y], axis=-1)


@pytest.mark.parametrize("place", [STANDS, WALKS], ids=["stands", "walks"])
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_every_frame_and_both_flows_are_those_of_openusd_camera(tmp_path, projection, place):
    path = stage_with(tmp_path, f'token projection = "{projection}"', place)
    if projection == "orthographic":  # tenths of a unit
        text = path.read_text().replace("Aperture = 32", "Aperture = 64")
        path.write_text(text.replace("1: 24, 9: 30", "1: 48, 9: 60"))
    with stream_of(path) as stream:
        names = {row.name: row.id for row in stream[0].objects}
        for frame in (stream[index] for index in (0, 2, 4, 8, 11)):
            code, now = frame.index + 1, pixel_centers()
            hit = frame.instance > 0
            assert hit.mean() > 0.05
            position = frame.position.astype(float)
            np.testing.assert_allclose(projected(path, code, position)[hit], now[hit], atol=1e-3)
            after = projected(path, code + 1, position + frame.scene_flow)
            np.testing.assert_allclose(frame.forward_flow[hit], (after - now)[hit], atol=2e-3)
            still = frame.instance == names["Still"]
            before = projected(path, max(code - 1, 1), position)
            np.testing.assert_allclose(frame.backward_flow[still], (before - now)[still], atol=2e-3)
        assert np.abs(stream[2].forward_flow[stream[2].instance == names["Still"]]).max() > 0.3
        assert (stream[11].forward_flow == 0.0).all(), "the lens is held after its last sample"


def test_values_follow_their_samples(tmp_path):
    with stream_of(stage_with(tmp_path)) as stream:
        cameras = [stream[index].camera.camera for index in range(9)]
    third = cameras[3]  # time code 4
    assert math.tan(0.5 * third.vertical_fov) == pytest.approx(0.5 * (24 + 6 * 3 / 8) / 40)
    assert third.aperture_offset == pytest.approx((3 / 40, -1.5 / 40))
    assert third.focus_distance == pytest.approx(4.5)
    assert third.exposure == pytest.approx(0.75)
    assert (cameras[8].near, cameras[8].far) == pytest.approx((0.5, 50.0))
    assert third.lens is None


def test_frames_do_not_depend_on_earlier_frames_nor_on_the_process_that_renders_them(tmp_path):
    path = stage_with(tmp_path, "float fStop = 2", WALKS)
    options = {"quality": "fast", "base_spp": 4, "buffers": ("hdr", "rgb", *LABELS)}
    with stream_of(path, **options) as stream:
        frames = [stream[index] for index in (0, 3, 9)]
    with stream_of(path, **options) as fresh:
        for frame in reversed(frames):
            for name in options["buffers"]:
                np.testing.assert_array_equal(fresh[frame.index][name], frame[name], err_msg=name)


def test_a_focus_pull_blurs_what_it_leaves(tmp_path):
    """A lamp's edge is sharp at the distance in focus, whatever the frames before were focused on."""
    lens = "float focalLength = 60\nfloat fStop = 4\nfloat focusDistance.timeSamples = { 0: 4, 8: 12 }"
    path = write(tmp_path, EYE % (lens, "(-1, 0, -4)"), more="timeCodesPerSecond = 4")
    with stream_of(path, buffers=("hdr",), spp=16, base_spp=16, quality="fast") as stream:
        blurred = [
            ((stream[index].hdr[HEIGHT // 2, :, 0] > 0.02) & (stream[index].hdr[HEIGHT // 2, :, 0] < 0.98)).sum()
            for index in (0, 4, 8)
        ]
    assert blurred[0] <= 1 < 5 < blurred[1] < blurred[2]


def test_labels_of_a_pinhole_do_not_see_a_focus_pull_and_light_is_shared(tmp_path):
    lines = "float focusDistance.timeSamples = { 1: 3, 9: 7 }\n    float exposure.timeSamples = { 1: 0, 9: 2 }"
    path = write(tmp_path, f'def Camera "Eye"\n{{\n    {lines}\n}}\ndef DomeLight "Sky" {{}}', more=RANGE)
    with stream_of(path, quality="standard", incremental=True) as stream:
        view = stream._renderer.view(stream.world.state(4), 0, LABELS, WIDTH, HEIGHT)
    assert view.is_still
    assert view.previous != view.next


def test_exposure_follows_its_samples(tmp_path):
    path = write(
        tmp_path,
        'def Camera "Eye"\n{\n    float exposure.timeSamples = { 1: -4, 9: 0 }\n}\ndef DomeLight "Sky" {}\n'
        'def Camera "Other" {}',
        more=RANGE,
    )
    with stream_of(path, buffers=("rgb",), camera=["Eye", "Other"]) as stream:
        values = [[int(each.rgb[5, 5, 0]) for each in stream[index].views.values()] for index in (0, 4, 8)]
    for main, other in values:
        assert main == other, "a camera without an exposure has that of the main camera"
    assert values[0][0] < values[1][0] < values[2][0]


def test_a_shutter_sees_the_lens_at_its_own_times(tmp_path):
    """A zoom blurs away from the axis; with a shutter at one time it does not."""
    partial = []
    for close in (0, 1):
        lens = f"float focalLength.timeSamples = {{ 0: 24, 8: 48 }}\ndouble shutter:close = {close}"
        path = write(tmp_path, EYE % (lens, "(0, 0, -5)"), more="timeCodesPerSecond = 4")
        with stream_of(path, buffers=("hdr",), spp=64) as stream:
            row = stream[4].hdr[HEIGHT // 2, :, 0]
            partial.append(((row > 0.02) & (row < 0.98)).sum())
    assert partial[0] <= 2 < partial[1]


def test_scenario_and_baked_motion_have_the_lens(tmp_path):
    path = stage_with(tmp_path, "", WALKS)
    with stream_of(path) as stream:
        expected = [stream[index].camera.camera for index in (0, 3, 8)]
        stream.scenario.save(tmp_path / "saved.usda")
        stream.scenario.save(tmp_path / "saved.json")
        stream.to_usd(tmp_path / "baked.usda", 9)
    for name in ("saved.usda", "saved.json", "baked.usda"):
        with stream_of(tmp_path / name) as stream:
            found = [stream[index].camera.camera for index in (0, 3, 8)]
        for one, other in zip(found, expected, strict=True):
            assert one.position == pytest.approx(other.position), name
            K = [each.intrinsics(WIDTH, HEIGHT) for each in (one, other)]
            np.testing.assert_allclose(K[0], K[1], rtol=1e-5, err_msg=name)
            assert (one.exposure, one.focus_distance) == pytest.approx((other.exposure, other.focus_distance))


def test_a_still_camera_that_zooms_is_baked(tmp_path):
    with stream_of(stage_with(tmp_path)) as stream:
        expected = [stream[index].camera.K for index in (0, 3, 8)]
        stream.to_usd(tmp_path / "baked.usda", 9)
    with stream_of(tmp_path / "baked.usda") as stream:
        np.testing.assert_allclose([stream[index].camera.K for index in (0, 3, 8)], expected, rtol=1e-5)


def test_agents_of_sailenv_keep_their_lens(tmp_path):
    path = stage_with(tmp_path, "", WALKS)
    profile = SceneProfile.of(ts.Scenario.load(path), read_stage(path), 25.0)
    assert profile.start.lens is None
    assert profile.start.vertical_fov == Camera.vertical_fov
    assert profile.track_pose(50)[0] == pytest.approx((0.4, 0.0, 4.0))


def test_overrides_and_still_streams_replace_the_animated_lens(tmp_path):
    path = stage_with(tmp_path)
    scenario = ts.Scenario(str(path), overrides=[ts.CameraOverride("/Zoom", vertical_fov=0.5)])
    with stream_of(scenario) as stream:
        assert {stream[index].camera.camera.vertical_fov for index in (0, 4, 8)} == {0.5}
        assert stream[8].camera.camera.focus_distance == 7.0
    with stream_of(path, time_code=4.0) as stream:
        found = [stream[index].camera.camera for index in (0, 4)]
    assert found[0] == found[1]
    assert found[0].focus_distance == pytest.approx(4.5)


def test_constant_samples_are_no_animation(tmp_path):
    body = 'def Camera "Eye"\n{\n    float focalLength.timeSamples = { 1: 30, 9: 30 }\n}'
    assert read(tmp_path, body, more=RANGE).cameras[0].lens is None


def test_samples_that_are_no_lens_are_named_and_passed_over(tmp_path):
    body = 'def Camera "Eye"\n{\n    float focalLength.timeSamples = { 0: 30, 1: -5, 2: 50 }\n}'
    text = "a camera's lens is not valid at some time samples; those before and after them are used: </Eye>"
    eye = read_with_warning(tmp_path, body, text).cameras[0]
    assert eye.lens.times == pytest.approx((0.0, 2 / 24))


def test_projection_that_varies_is_named(tmp_path):
    body = 'def Camera "Eye"\n{\n    token projection.timeSamples = { 0: "perspective", 9: "orthographic" }\n}'
    eye = read_with_warning(tmp_path, body, "projection of a camera has time samples, and is drawn as it is")
    assert eye.cameras[0].orthographic_height is None


def test_samples_before_the_range_of_the_stage_do_not_play(tmp_path):
    body = 'def Camera "Eye"\n{\n    float focusDistance.timeSamples = { -9: 1, 11: 3 }\n}'
    eye = read(tmp_path, body, more=RANGE).cameras[0]
    assert eye.focus_distance == pytest.approx(2.0)
    assert eye.lens.times == (0.0, 2.5)
    assert eye.lens.focus_distance == pytest.approx((2.0, 3.0))


def test_splines_are_followed(tmp_path):
    body = """def Camera "Eye" {
    float focalLength.spline = {
        bezier,
        1: 20; post curve (2, 0),
        9: 60; pre (2, 0),
    }
}"""
    path = write(tmp_path, body, more=RANGE)
    stage = open_stage(path)
    attribute = stage.GetAttributeAtPath("/Eye.focalLength")
    lens = read_stage(path).cameras[0].lens
    aperture = 15.2908
    for second, angle in zip(lens.times, lens.vertical_fov, strict=True):
        assert 0.5 * aperture / math.tan(0.5 * angle) == pytest.approx(attribute.Get(1 + 4 * second), rel=1e-5)
    assert len(lens.times) == 6 * 8 + 1  # six steps a time code of a quarter of a second


def test_a_lens_of_a_damaged_scenario_layer_is_refused(tmp_path):
    stage_with(tmp_path)
    scenario = ts.Scenario(str(tmp_path / "stage.usda"), camera=Camera(lens=ts.LensKeyframes((0,), near=(0.2,))))
    scenario.save(tmp_path / "saved.usda")
    text = (tmp_path / "saved.usda").read_text()
    assert '"times"' in text
    (tmp_path / "saved.usda").write_text(text.replace('"times"', "times"))
    with pytest.raises(ts.TisceneError, match="tiscene:camera:lens is not JSON"):
        ts.Scenario.load(tmp_path / "saved.usda")
