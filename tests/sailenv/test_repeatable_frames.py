# SPDX-License-Identifier: Apache-2.0
"""Agents' frames depend on the world, the frame and the agent's camera alone: no flicker, late agents, frame index."""

import numpy as np
import pytest

from tests.sailenv.conftest import SCENE, VIEWS, path
from tiscene.sailenv import AllTogetherTimings, Object, Scenario


def moving_cube():
    cube = Object("a", "Cube", (0, 0, 0), (0, 0, 0), path((-0.5, 1, 3), (0.5, 1, 3)))
    return Scenario(SCENE, [cube], AllTogetherTimings(0.0))


def test_frames_of_a_still_agent_are_equal_bytes_at_default_settings(make_agent):
    agent = make_agent(spp=None)
    agent.spawn_object("Sphere", (0.3, 1.2, 2.5))
    agent.spawn_object("Cube", (-0.8, 0.8, 3.5), (10, 20, 0))
    first, *others = (agent.get_frame() for _ in range(30))
    for each in others:
        assert each["main"].tobytes() == first["main"].tobytes()


def test_frames_are_equal_bytes_again_after_an_edit_and_after_a_move(make_agent):
    agent = make_agent(spp=None)
    cube = agent.spawn_object("Cube", (0, 1, 3))
    agent.get_frame()
    agent.move_object(cube, (0.2, 1, 3), (0, 0, 0))
    moved = [agent.get_frame()["main"].tobytes() for _ in range(3)]
    assert len(set(moved)) == 1
    agent.set_position((0.1, 1, 0))
    agent.get_frame()  # the camera moves from the frame before to this one
    assert len({agent.get_frame()["main"].tobytes() for _ in range(3)}) == 1


def test_frames_flicker_without_incremental_rendering(make_agent):
    agent = make_agent(incremental=False)
    agent.spawn_object("Sphere", (0, 1, 2.5))
    assert len({agent.get_frame()["main"].tobytes() for _ in range(3)}) == 3
    assert make_agent(port=1, quality="standard", incremental=True).environment.stream.render_settings.incremental


def test_agent_that_joins_late_gets_the_same_bytes(make_agent):
    early = make_agent(spp=None)
    early.load_scenario(moving_cube())
    for _ in range(30):
        early.get_frame()
    late = make_agent(spp=None)
    for _ in range(3):
        here, there = early.get_frame(), late.get_frame()
        assert late.frame_index == early.frame_index
        for name in VIEWS:
            assert here[name].tobytes() == there[name].tobytes()


def test_agent_alone_gets_the_frames_of_an_agent_with_company(make_agent):
    def frames(port, *companions):
        agents = [make_agent(port=port, **each) for each in ({}, *companions)]
        agents[0].load_scenario(moving_cube())
        rounds = [[agent.get_frame() for agent in agents] for _ in range(4)]
        return [mine for mine, *_ in rounds]

    companions = {"width": 32, "height": 24}, {"main_frame_active": False}
    for here, there in zip(frames(1), frames(2, *companions), strict=True):
        for name in VIEWS:
            assert here[name].tobytes() == there[name].tobytes()


def test_edit_of_a_light_shows_in_the_frame_after_the_current_one_for_all_agents(make_agent):
    early, late = make_agent(), make_agent()
    early.spawn_object("Sphere", (0, 1, 2.5))
    before = early.get_frame()
    early.set_light_intensity("Main Light", 0.0)
    early.set_ambient_light_color(0, 200, 0)
    assert late.get_frame()["main"].tobytes() == before["main"].tobytes()
    after = early.get_frame()
    assert early.frame_index == 1
    assert after["main"].tobytes() != before["main"].tobytes()
    assert late.get_frame()["main"].tobytes() == after["main"].tobytes()


def test_frame_index_counts_the_frames_of_the_world(make_agent):
    agent = make_agent(main_frame_active=False, together=True)
    assert agent.frame_index == -1
    for index in range(3):
        agent.get_frame()
        assert agent.frame_index == index
    late = make_agent(main_frame_active=False, together=True)
    assert late.frame_index == -1
    late.get_frame()
    assert late.frame_index == 2
    agent.change_scene(SCENE)
    assert agent.frame_index == late.frame_index == -1
    agent.get_frame()
    assert agent.frame_index == 0


def test_new_agent_has_no_camera_motion_in_its_first_frame(make_agent):
    agent = make_agent(main_frame_active=False)
    agent.set_rotation((0, 45, 0))
    assert not agent.get_frame()["flow"].any()
    agent.set_rotation((0, 46, 0))
    assert np.abs(agent.get_frame()["flow"]).min(axis=(0, 1))[0] > 0.1


@pytest.mark.parametrize("quality", ["fast", "preview"])
def test_first_still_frame_equals_the_next_one(make_agent, quality):
    """Frame 0 waits for the base image, rather than being rendered in another way."""
    agent = make_agent(quality=quality, spp=None)
    agent.spawn_object("Sphere", (0, 1, 2.5))
    np.testing.assert_array_equal(agent.get_frame()["main"], agent.get_frame()["main"])


def skipping(make_agent, **settings):
    """Return the flow of an agent that gets frames 0 and 4 only, and those frames of one that gets every frame.

    Both cameras pan by 1° at each frame, and an object moves to the right by 1 cm.
    """
    agent, other = make_agent(main_frame_active=False, **settings), make_agent(main_frame_active=False)
    cube = Object("a", "Cube", (0, 0, 0), (0, 0, 0), path((-0.5, 1, 3), (0.5, 1, 3), seconds=8.0))
    agent.load_scenario(Scenario(SCENE, [cube], AllTogetherTimings(0.0)))
    complete = []
    for index in range(5):
        for each in (agent, other):
            each.set_rotation((0, index, 0))
        complete.append(other.get_frame())
        if index in (0, 4):
            frame = agent.get_frame()
    assert agent.frame_index == other.frame_index == 4
    assert frame["deltaTime"] == pytest.approx(4 / 25)
    return frame, complete


def test_flow_of_an_agent_that_skips_frames_spans_the_time_since_its_last_one(make_agent):
    frame, complete = skipping(make_agent)
    there = frame["object"].any(axis=-1)
    for part in (there, ~there):  # the object, and the background
        steps = [np.median(each["flow"][part], axis=0) for each in complete[1:]]
        np.testing.assert_allclose(np.median(frame["flow"][part], axis=0), np.sum(steps, axis=0), rtol=0.1, atol=0.1)
    still = np.median(complete[1]["flow"][~there], axis=0)
    assert np.median(frame["flow"][~there], axis=0)[0] > 3.5 * still[0] > 2.0
    object_part = np.median(frame["flow"][there], axis=0) - np.median(frame["flow"][~there], axis=0)
    assert object_part[0] < -0.4  # -4 cm at 3 m


def test_consecutive_flow_is_that_of_an_agent_that_gets_every_frame(make_agent):
    frame, complete = skipping(make_agent, consecutive_flow=True)
    for name in ("flow", "object", "depth", "category"):
        np.testing.assert_array_equal(frame[name], complete[-1][name])


def test_object_spawned_while_an_agent_skipped_frames_has_flow_in_its_view(make_agent):
    agent, other = make_agent(main_frame_active=False), make_agent(main_frame_active=False)
    agent.get_frame(), other.get_frame()
    for _ in range(3):
        other.get_frame()
    other.spawn_object("Cube", (0, 1, 3))
    other.get_frame()
    frame = agent.get_frame()
    assert frame["object"].any()
    assert np.isfinite(frame["flow"]).all()


def test_categories_have_the_same_numbers_in_all_scenes(make_agent):
    agent = make_agent(main_frame_active=False)
    agent.change_scene(SCENE)
    there = agent.categories
    agent.change_scene("solid_benchmark/scene")
    common = set(there.values()) & set(agent.categories.values())
    assert {"cube", "chair"} <= common
    assert [n for n, name in sorted(there.items()) if name in common] == [
        n for n, name in sorted(agent.categories.items()) if name in common
    ]
    assert all(agent.categories[number] == name for number, name in there.items() if name in common)
