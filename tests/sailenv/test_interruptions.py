# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C in the middle of a frame of an agent: the frames that follow are those that it would have received."""

import numpy as np
import pytest

from tests.interruption import interrupted
from tests.sailenv.conftest import HOME, SCENE

VIEWS = ("object", "flow", "depth")


def content(agent):
    frame = agent.get_frame()
    return [np.asarray(frame[name]).tobytes() for name in VIEWS], frame["deltaTime"], agent.frame_index


def begin(agent):
    """Receive two frames, and edit the world."""
    agent.change_scene(SCENE)
    agent.set_position(HOME)
    for _ in range(2):
        agent.get_frame()
    agent.spawn_object("Cube", (0, 1, 3))
    agent.spawn_collidable_view_frustum()
    agent.set_ambient_light_color(9, 9, 9)
    agent.set_light_color(agent.lights_names[0], 200, 0, 0)
    agent.set_position((0.1, 1, 0))


@pytest.mark.parametrize("step", [7, pytest.param(1, marks=pytest.mark.slow)])
def test_frame_after_an_interrupted_one_is_that_frame_or_the_next(make_agent, step):
    agent = make_agent(main_frame_active=False, width=24, height=18, consecutive_flow=True)
    begin(agent)
    right = [content(agent) for _ in range(4)]
    line, lost = 0, []
    while True:
        begin(agent)
        line += step
        if not interrupted(agent.get_frame, line, ("tiscene/sailenv",)):
            break
        first = content(agent)
        lost.append(right.index(first))
        assert [first, content(agent)] == right[lost[-1] : lost[-1] + 2], line
    assert line > 100
    assert set(lost) == {0, 1}
    assert lost == sorted(lost)
