# SPDX-License-Identifier: Apache-2.0
"""Poses of SAILenv's Agent: where it is placed, the camera track, and what is remembered of its walk."""

import numpy as np
import pytest

from tests.sailenv.conftest import SCENE
from tests.sailenv.test_agent import START, center
from tiscene.sailenv import Scenario, Vector3


def test_turning_right_moves_the_image_left_and_pitching_down_moves_it_up(make_agent):
    agent = make_agent(main_frame_active=False)
    agent.spawn_object("Sphere", (0, 1, 3), scale=(0.5, 0.5, 0.5))
    x, y = center(agent.get_frame()["object"].any(axis=-1))
    agent.set_rotation(Vector3(0, 10, 0))
    assert center(agent.get_frame()["object"].any(axis=-1))[0] < x - 3
    agent.set_rotation([10, 0, 0])
    assert center(agent.get_frame()["object"].any(axis=-1))[1] < y - 3
    assert agent.get_rotation() == Vector3(10, 0, 0)
    agent.set_rotation((0, 0, 0))
    agent.set_position(np.array([0.5, 1.0, 0.0]))
    assert center(agent.get_frame()["object"].any(axis=-1))[0] < x - 3


def test_load_scenario_keeps_the_pose_of_an_agent_and_change_scene_resets_it(make_agent):
    agent = make_agent()
    agent.set_position((0.25, 1.5, 0.125))
    agent.load_scenario(Scenario(SCENE, []))
    assert agent.get_position() == Vector3(0.25, 1.5, 0.125)
    agent.change_scene(SCENE)
    assert tuple(agent.get_position()) == pytest.approx(START)


def test_agent_follows_the_camera_track_at_constant_speed(make_agent):
    agent = make_agent(main_frame_active=False)
    agent.set_position((0, 1, 0.5))
    agent.toggle_follow()
    positions = []
    for _ in range(26):
        agent.get_frame()
        positions.append(np.array(tuple(agent.get_position())))
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    np.testing.assert_allclose(steps, 0.5 / 25, rtol=0.06)  # half a meter a second between waypoints
    assert np.ptp(steps) < 1e-4
    assert agent.get_rotation() != Vector3(0, 0, 0)
    agent.toggle_follow()
    agent.get_frame()
    np.testing.assert_array_equal(tuple(agent.get_position()), positions[-1])


def test_agents_remember_along_which_axes_they_have_walked_in_their_scene(make_agent):
    agent = make_agent(main_frame_active=False)
    camera = agent._camera
    agent.get_frame()
    walks = []
    for place in ((0, 1, 0), (0.2, 1, 0), (0.2, 1, 3), (0.2, 1, 3.1)):  # 3 m are a jump
        agent.set_position(place)
        agent.get_frame()
        walks.append(camera.walks)
    assert walks[1:] == [walks[0] | {0}, walks[0] | {0}, walks[0] | {0, 2}]
    agent.change_scene(SCENE)
    assert not camera.walks
