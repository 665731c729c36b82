# SPDX-License-Identifier: Apache-2.0
"""LensKeyframes: interpolation, what they replace of a camera, validation, files."""

import math
from dataclasses import replace

import pytest

import tiscene as ts
from tiscene.errors import ArgumentError, ScenarioError
from tiscene.scenario.edits import SetFrustumWalls

WIDE, LONG = 2.0 * math.atan(0.5), 2.0 * math.atan(0.25)  # focal lengths of one and two apertures
ZOOM = ts.LensKeyframes((1.0, 3.0), vertical_fov=(WIDE, LONG), focus_distance=(2.0, 4.0))


def test_values_are_linear_and_fields_of_view_are_so_in_the_focal_length():
    assert ZOOM.at(0.0) == ZOOM.at(1.0) == {"vertical_fov": WIDE, "focus_distance": 2.0}
    assert ZOOM.at(3.0) == ZOOM.at(99.0) == {"vertical_fov": LONG, "focus_distance": 4.0}
    found = ZOOM.at(1.5)
    assert found["focus_distance"] == 2.5
    assert 0.5 / math.tan(0.5 * found["vertical_fov"]) == pytest.approx(1.25)
    shifted = ts.LensKeyframes([0, 2], aperture_offset=[(0, 0), (0.5, -1)])
    assert shifted.at(0.5) == {"aperture_offset": (0.125, -0.25)}


def test_a_camera_at_a_time_has_that_lens_and_its_own_other_values():
    camera = ts.Camera((1.0, 2.0, 3.0), lens_radius=0.01, lens=ZOOM)
    assert camera.at(2.0) == replace(camera, lens=None, **ZOOM.at(2.0))
    assert camera.at(2.0).lens_radius == 0.01
    fixed = ts.Camera()
    assert fixed.at(2.0) is fixed


def test_fixed_values_do_not_vary():
    camera = ts.Camera(lens=ZOOM).fixed(vertical_fov=0.5)
    assert camera.at(2.0).vertical_fov == 0.5
    assert camera.at(2.0).focus_distance == 3.0
    assert camera.fixed(focus_distance=1.0).lens is None
    assert camera.fixed(near=0.2).lens == camera.lens


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"times": (0, 1)}, "times: give values at these times"),
        ({"times": (), "exposure": ()}, "must begin at 0 or later and increase"),
        ({"times": (-1, 1), "exposure": (0, 1)}, "must begin at 0 or later and increase"),
        ({"times": (1, 1), "exposure": (0, 1)}, "must begin at 0 or later and increase"),
        ({"times": (0, 1), "exposure": (1,)}, "exposure: 1 value for 2 times; give one for each"),
        ({"times": (0, 1), "vertical_fov": (1, 4)}, r"vertical_fov\[1\]=4: must lie between 0 and pi"),
        ({"times": (0, 1), "focus_distance": (1, 0)}, r"focus_distance\[1\]=0: must be"),
        ({"times": (0, 1), "lens_radius": (0, -1)}, r"lens_radius\[1\]=-1: must"),
        ({"times": (0, 1), "aperture_offset": (0, 1)}, r"aperture_offset\[0\]=0: must be"),
        ({"times": (0, 1), "near": 2.0}, "near=2.0: must be a sequence"),
    ],
)
def test_invalid_keyframes_are_refused(arguments, message):
    with pytest.raises(ArgumentError, match=message):
        ts.LensKeyframes(**arguments)


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        ({"lens": 3}, "camera 'Camera': lens=3: must be LensKeyframes or None"),
        (
            {"lens": ts.LensKeyframes((0, 1), near=(1, 5)), "far": 4.0},
            "camera 'Camera': near=5.0: must be 0 < near < far, far=4.0, of its lens at 1 s",
        ),
        ({"lens": ts.LensKeyframes((0, 1), orthographic_height=(1, 5))}, "the camera is a perspective one; give it an"),
    ],
)
def test_keyframes_that_do_not_fit_their_camera_are_refused(camera, message):
    with pytest.raises(ArgumentError, match=message):
        ts.Camera(**camera)


def test_keyframes_survive_a_file_and_errors_name_their_place(tmp_path):
    scenario = ts.Scenario("room_02", camera=ts.Camera(lens=replace(ZOOM, aperture_offset=((0, 0), (1 / 3, 0)))))
    scenario.save(tmp_path / "run.json")
    assert ts.Scenario.load(tmp_path / "run.json") == scenario
    content = scenario.to_json()
    content["camera"]["lens"]["times"] = [3, 1]
    with pytest.raises(ScenarioError, match=r"^camera\.lens\.times="):
        ts.Scenario.from_json(content)


def test_walls_of_another_camera_take_a_lens_that_stands_still():
    with pytest.raises(ScenarioError, match="without keyframes of its lens"):
        SetFrustumWalls(0, None, ts.Camera(lens=ZOOM), 1.0)
