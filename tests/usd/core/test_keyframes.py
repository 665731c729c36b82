# SPDX-License-Identifier: Apache-2.0
"""Time samples of objects as keyframes: start time, mirrored transforms, invalid samples."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

import tiscene as ts
from dynamics.rotation import matrix_from_quaternion
from tests.usd.helpers import problems_of, write
from tiscene.errors import StageError, StageWarning
from tiscene.scenario.scenario import Scenario
from tiscene.usd.read.stage_reader import read_stage

THING = """
def Xform "%s" (kind = "component") {
    %s
    %s
    def Cube "Body" {}
}
"""
MOVED = """double3 xformOp:translate.timeSamples = { %s }
    uniform token[] xformOpOrder = ["xformOp:translate"]"""
TURNED = """float xformOp:rotateY.timeSamples = { 0: 0, 20: 200 }
    double3 xformOp:scale = (-1, 1, 2)
    uniform token[] xformOpOrder = ["xformOp:rotateY", "xformOp:scale"]"""


def moved(name: str, operations: str, inside: str = "") -> str:
    return THING % (name, operations, inside)


def turned(seconds: float) -> np.ndarray:
    """Return the 3x3 matrix that TURNED gives at a time: 20 degrees a frame, 10 frames a second."""
    angle = np.radians(100.0 * seconds)
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    return turn @ np.diag([-1, 1, 2])


def placed(path: Path, seconds: float) -> np.ndarray:
    """Return the world matrix of the only mesh at a time of a stream."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        stream = ts.Stream(path, width=8, height=6, fps=20.0, buffers=("instance",))
    return stream.world.state(round(20 * seconds)).placement.world_from_object[1, 0]


@pytest.mark.parametrize("inside", [False, True])
def test_mirrored_prim_rotates_as_animated(tmp_path, inside):
    """As an object, by keyframes, and as a part of an object, by a track; between samples too."""
    wheel = f'def Xform "Wheel"\n{{\n{TURNED}\n def Cube "Rim" {{}}\n}}'
    body = moved("Mill", "", wheel).replace('def Cube "Body" {}', "") if inside else moved("Mill", TURNED)
    path = write(tmp_path, body, more="startTimeCode = 0\nendTimeCode = 20\ntimeCodesPerSecond = 10")
    for seconds in (0.0, 0.35, 1.0, 1.75, 2.0):
        np.testing.assert_allclose(placed(path, seconds)[:, :3], turned(seconds), atol=1e-6)


def test_reported_rotation_of_a_mirrored_object_follows_its_animation(tmp_path):
    path = write(tmp_path, moved("Mill", TURNED), more="startTimeCode = 0\nendTimeCode = 20\ntimeCodesPerSecond = 10")
    stream = ts.Stream(path, width=8, height=6, fps=10.0, buffers=("instance",))
    first, then = (matrix_from_quaternion(stream.world.state(frame).objects[0].rotation) for frame in (0, 5))
    np.testing.assert_allclose(then @ first.T, turned(0.5) @ np.linalg.inv(turned(0.0)), atol=1e-9)


def test_stage_without_range_starts_at_its_first_sample(tmp_path):
    lamp = """
def SphereLight "Lamp" {
    float inputs:intensity.timeSamples = { 8: 1, 18: 3 }
}
"""
    early, late = MOVED % "3: (0, 0, 0), 13: (1, 0, 0)", MOVED % "8: (0, 0, 0), 13: (1, 0, 0)"
    part = f'def Xform "Lid"\n{{\n{late}\n def Cube "Top" {{}}\n}}'
    body = moved("Early", early) + moved("Late", late) + moved("Box", "", part) + lamp
    path = write(tmp_path, body, more="timeCodesPerSecond = 10")
    scenario = Scenario.load(path)
    times = {each.id: each.dynamic.times for each in scenario.objects}
    assert times == {"Early": (0.0, 1.0), "Late": (0.5, 1.0)}
    assert scenario.lights[0].times == (0.5, 1.5)
    (track,) = read_stage(path).tracks
    assert (track.times[0], track.times[-1]) == (0.5, 1.0)


@pytest.mark.parametrize("read", [Scenario.load, read_stage])
@pytest.mark.parametrize(
    ("more", "expected"),
    [
        ("timeCodesPerSecond = 0", "timeCodesPerSecond is 0"),
        ("timeCodesPerSecond = -24", "timeCodesPerSecond is -24"),
        ("startTimeCode = nan\nendTimeCode = 1", "startTimeCode is nan"),
    ],
)
def test_invalid_time_metadata_raises_stage_error(tmp_path, read, more, expected):
    path = write(tmp_path, moved("A", MOVED % "0: (0, 0, 0), 10: (1, 0, 0)"), more=more)
    with pytest.raises(StageError, match=f"</> stage: {expected}"):
        read(path)


FLAT = """double3 xformOp:translate.timeSamples = { 0: (0, 0, 0), 10: (1, 0, 0) }
    double3 xformOp:scale = (0, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]"""


@pytest.mark.parametrize(
    ("operations", "text"),
    [(FLAT, "singular.*at time code 0"), (MOVED % "0: (0, 0, 0), 10: (nan, 0, 0)", "not finite at time code 10")],
)
def test_object_without_a_pose_at_some_sample_is_reported_and_static(tmp_path, operations, text):
    with pytest.warns(StageWarning, match=f"{text}.*stands still: </A>"):
        assert Scenario.load(write(tmp_path, moved("A", operations))).objects == ()


def test_samples_far_apart_are_not_densified(tmp_path):
    turns = """float xformOp:rotateY.timeSamples = { 0: 0, 1e12: 90 }
    uniform token[] xformOpOrder = ["xformOp:rotateY"]"""
    lamp = 'def SphereLight "Lamp"\n{\nfloat inputs:exposure.timeSamples = { 0: 0, 1e12: 1 }\n}\n'
    scenario = Scenario.load(write(tmp_path, moved("A", turns) + lamp, more="timeCodesPerSecond = 10"))
    assert scenario.objects[0].dynamic.times == scenario.lights[0].times == (0.0, 1e11)


def test_non_finite_sample_of_a_transform_is_a_problem(tmp_path):
    body = moved("A", "", f'def Xform "B"\n{{\n{MOVED % "0: (0, 0, 0), 10: (nan, 0, 0)"}\n def Cube "C" {{}}\n}}')
    assert "not finite" in problems_of(tmp_path, body)[0]
