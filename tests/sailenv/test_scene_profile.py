# SPDX-License-Identifier: Apache-2.0
"""Start cameras and camera tracks of scenes."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from tests.world.small_stage import UNIT_CUBE
from tiscene.sailenv.scene_profile import SceneProfile, start_camera
from tiscene.scenario.scenario import Scenario
from tiscene.scene.camera import Camera
from tiscene.scene.description import Instance, SceneDescription, SceneObject

DOWN = Camera.look_at((0.0, 3.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), focus_distance=3.0)


def stage(*cameras: Camera, up_axis: str = "Y") -> SceneDescription:
    cube = (UNIT_CUBE,), (Instance(0, 0, np.eye(4)),), (SceneObject("Box", "/Box"),)
    meshes, instances, objects = cube
    return SceneDescription("s", meshes, instances=instances, objects=objects, cameras=cameras, up_axis=up_axis)


def test_start_camera_is_the_one_named_agent_or_the_first():
    first, own = Camera(name="First"), Camera(name="Agent")
    assert start_camera(stage(first, own)) is own
    assert start_camera(stage(first)) is first


@pytest.mark.parametrize(("up_axis", "up"), [("Y", (0, 1, 0)), ("Z", (0, 0, 1))])
def test_start_camera_of_a_stage_without_cameras_is_upright(up_axis, up):
    start = start_camera(stage(up_axis=up_axis))
    assert start.axes()[:, 1] @ up > 0.8
    assert abs(start.axes()[:, 0] @ up) < 1e-9


@pytest.mark.parametrize("camera", [DOWN, Camera((0.0, 1.0, 3.0), focus_distance=3.0)])
def test_track_of_a_single_camera_keeps_its_point_of_focus_without_jumps(camera):
    profile = SceneProfile.of(Scenario("object_view"), stage(camera), 10.0)
    target = camera.position - 3.0 * camera.axes()[:, 2]
    views = [camera.with_pose(*profile.track_pose(k)) for k in range(60)]
    np.testing.assert_allclose(views[0].position, camera.position, atol=1e-9)
    for here, there in itertools.pairwise(views):
        towards = target - np.array(here.position)
        assert -here.axes()[:, 2] @ towards / np.linalg.norm(towards) > 0.999
        assert np.trace(here.axes().T @ there.axes()) > 2.99
