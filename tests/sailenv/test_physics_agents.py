# SPDX-License-Identifier: Apache-2.0
"""Objects of SAILenv agents and scenarios that fall and are pushed."""

import sys

import numpy as np
import pytest

pytest.importorskip("mujoco")

from tests.sailenv.conftest import SCENE
from tiscene.cli.main import main
from tiscene.errors import TisceneError
from tiscene.sailenv import AllTogetherTimings, Frustum, LinearWaypoints, Object, Scenario, Waypoint
from tiscene.sailenv.json_messages import scenario_of

LABELS = {"main_frame_active": False, "flow_frame_active": False, "category_frame_active": False}


def heights(agent, *ids):
    """Return the heights of objects in the agent's last frame, m."""
    rows = {str(row.id): row.position[1] for row in agent.environment.stream.world.state(agent.frame_index).objects}
    return [rows[id] for id in ids]


def test_spawned_object_falls_if_it_keeps_its_default_dynamics(make_agent):
    agent = make_agent(**LABELS, width=16, height=12, physics=True)
    falling = agent.spawn_object("Cube", (0, 1, 3), remove_default_dynamics=False)
    floating = agent.spawn_object("Cube", (1.5, 1, 3))
    for frame in range(11):
        agent.get_frame()
        assert heights(agent, falling, floating) == pytest.approx([1 - 0.5 * 9.81 * (frame / 25) ** 2, 1.0], abs=1e-6)
    agent.move_object(falling, (0, 3, 3), (0, 0, 0))
    agent.get_frame()
    assert heights(agent, falling) == [3.0]


def test_objects_stay_without_physics(make_agent):
    agent = make_agent(**LABELS, width=16, height=12)
    cube = agent.spawn_object("Cube", (0, 1, 3), remove_default_dynamics=False)
    for _ in range(5):
        agent.get_frame()
    assert heights(agent, cube) == [1.0]


@pytest.mark.parametrize(("of_agent", "of_scenario"), [(True, None), (False, True)])
def test_scenario_objects_without_a_dynamic_fall_on_a_mover_that_carries_them(make_agent, of_agent, of_scenario):
    """A cube of 1 m falls on a cube that rises slowly along its path."""
    agent = make_agent(**LABELS, width=16, height=12, physics=of_agent)
    rising = LinearWaypoints([Waypoint((0, 0, 3)), Waypoint((0, 0.4, 3))], 4.0)
    objects = [
        Object("carrier", "Cube", (0, 0, 3), (0, 0, 0), rising),
        Object("cube", "Cube", (0, 1.2, 3), (0, 0, 0)),
    ]
    scenario = Scenario(SCENE, objects, AllTogetherTimings(0.0), Frustum(False), of_scenario)
    (carrier, _), (cube, _) = agent.load_scenario(scenario)
    for _ in range(41):
        agent.get_frame()
    below, above = heights(agent, carrier, cube)
    assert below == pytest.approx(0.2 * 1.6, abs=1e-9)  # its path is exact
    assert above == pytest.approx(below + 1.0, abs=3e-3)


def test_scenario_json_has_the_key_only_if_it_is_set():
    plain, physical = Scenario(SCENE, []), Scenario(SCENE, [], physics=True)
    assert "physics" not in plain.asdict()
    assert physical.asdict()["physics"] is True
    for content, default, expected in ((plain, False, False), (plain, True, True), (physical, False, True)):
        scenario, *_ = scenario_of(content.asdict(), "object_view", lambda name: (name, (1, 1, 1)), default)
        assert scenario.physics is expected


def test_frames_of_a_physical_world_are_the_same_bytes_again(make_agent):
    def frames(port):
        agent = make_agent(**LABELS, port=port, width=24, height=18, physics=True)
        agent.spawn_object("Cube", (0, 0, 3), (0, 0, 0))
        agent.spawn_object("Chair 01", (0.2, 1.0, 3), (20, 30, 10), remove_default_dynamics=False)
        return [np.asarray(agent.get_frame()["depth"]).tobytes() for _ in range(15)]

    first = frames(1)
    assert first == frames(2)
    assert len(set(first)) > 10


def test_missing_engine_names_the_extra(make_agent, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(TisceneError, match=r"tiscene\[physics\]"):
        make_agent(**LABELS, physics=True)
    assert main(["serve", "--physics"]) == 2
    assert "tiscene[physics]" in capsys.readouterr().err


def test_scenario_without_the_engine_changes_nothing(make_agent, monkeypatch):
    agent = make_agent(**LABELS, width=16, height=12, strict=True)
    agent.get_frame()
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(TisceneError, match=r"tiscene\[physics\]"):
        agent.load_scenario(Scenario(SCENE, [Object("a", "Cube", (0, 1, 3), (0, 0, 0))], physics=True))
    agent.get_frame()
    assert agent.frame_index == 1
