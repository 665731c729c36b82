# SPDX-License-Identifier: Apache-2.0
"""Questions of agents about single pixels, in process and over the network."""

import pytest

from tests.sailenv.client import OBJECT
from tests.sailenv.conftest import SCENE
from tiscene.errors import ArgumentError
from tiscene.sailenv import AllTogetherTimings, LinearWaypoints, Object, Scenario, Waypoint

LABELS = {"main_frame_active": False, "flow_frame_active": False, "depth_frame_active": False}


def moving_cube():
    path = LinearWaypoints([Waypoint((-1.5, 1, 4)), Waypoint((1.5, 1, 4))], 1.0)
    return Scenario(SCENE, [Object("a", "Cube", (0, 0, 0), (0, 0, 0), path)], AllTogetherTimings(0.0))


def test_answers_are_the_pixels_of_the_views_of_the_last_frame(make_agent):
    agent, other = make_agent(**LABELS, width=32, height=24), make_agent(**LABELS, width=32, height=24)
    ((cube, _),) = agent.load_scenario(moving_cube())
    agent.get_frame(), other.get_frame()
    frame = agent.get_frame()
    for _ in range(6):  # the clock goes on, and the cube moves; the agent is still asked about its own frame
        other.get_frame()
    there = frame["object"].any(axis=-1)
    assert there.any()
    for y in range(0, 24, 3):
        for x in range(0, 32, 3):
            answer = agent.ask_pixel(y, x)
            assert (answer.frame, answer.y, answer.x, answer.left) == (1, y, x, None)
            assert answer.category == frame["category"][y, x]
            assert answer.object == (int(cube) if there[y, x] else 0)
            assert answer.name == ("cube" if there[y, x] else "")


def test_budget_is_each_agents_own_and_errors_do_not_count(make_agent, capsys):
    one = make_agent(query_budget=2, width=16, height=12)
    two = make_agent(strict=True, width=16, height=12)
    assert one.ask_pixel(0, 0) is None
    assert "get_frame" in capsys.readouterr().out
    one.get_frame(), two.get_frame()
    for y, x in ((12, 0), (0, 16), (-1, 0), (0.5, 0), ("a", 0)):
        assert one.ask_pixel(y, x) is None
    assert [one.ask_pixel(0, 0).left for _ in range(2)] == [1, 0]
    assert one.ask_pixel(0, 0) is None
    assert "budget of 2" in capsys.readouterr().out
    assert two.ask_pixel(11, 15).left == 1
    two.ask_pixel(0, 0)
    with pytest.raises(ArgumentError, match="budget of 2"):
        two.ask_pixel(0, 0)
    two.change_scene(SCENE)
    with pytest.raises(ArgumentError, match="get_frame"):
        two.ask_pixel(0, 0)


@pytest.mark.parametrize("budget", [-1, 1.5, "many"])
def test_invalid_budget_is_an_error(make_agent, budget):
    with pytest.raises(ArgumentError, match="query_budget"):
        make_agent(query_budget=budget)


def test_answers_over_the_network_are_those_in_process(server, connect, make_agent):
    agent, c = make_agent(at=None, width=32, height=24), connect()
    assert "get_frame" in c.ask_pixel(0, 0)
    assert c.spawn("Cube") == agent.spawn_object("Cube")
    c.frame(OBJECT), agent.get_frame()
    for left, (y, x) in ((2, (12, 16)), (1, (0, 0))):
        mine = agent.ask_pixel(y, x)
        assert c.ask_pixel(y, x) == (mine.frame, mine.category, mine.object, left, mine.name)
    assert "must" in c.ask_pixel(24, 0)
    assert c.ask_pixel(23, 31)[3] == 0
    assert "budget" in c.ask_pixel(0, 0)
    assert c.position()  # the connection goes on
