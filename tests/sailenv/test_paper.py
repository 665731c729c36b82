# SPDX-License-Identifier: Apache-2.0
"""The three streams of the SAILenv paper: the same frames in process and over the network."""

import numpy as np
import pytest

from tests.sailenv.client import Client
from tests.sailenv.served import served
from tiscene.sailenv import (
    AllTogetherTimings,
    CatmullWaypoints,
    Frustum,
    Object,
    Scenario,
    UniformMovementRandomBounce,
    Vector3,
    WaitUntilCompleteTimings,
    Waypoint,
)


def cylinder():
    """Return a cylinder on a closed curve before a plain background: pose of the agent and scenario."""
    here, offsets = Vector3(0, 1, 0), [(0, 0, 2), (0, 1, 3), (1, 0.5, 3), (1, -0.5, 4), (-1.5, 0, 3.5)]
    turns = [(0, 0, 0), (90, 0, 0), (90, 90, 0), (90, 90, 90), (90, 90, 180)]
    waypoints = [Waypoint(here + Vector3(*offset), Vector3(*turn)) for offset, turn in zip(offsets, turns, strict=True)]
    dynamic = CatmullWaypoints(waypoints=waypoints, total_time=10.0)
    objects = [Object("c1", "Cylinder", Vector3(0, 0, 2), Vector3(0, 0, 0), dynamic)]
    return (0, 1, 0), (0, 0, 0), Scenario("object_view/scene", objects, AllTogetherTimings(0.2))


def bouncing():
    """Return chair, pillow and dish bouncing in the living room, within walls of the agent's view."""
    here = Vector3(-1.5, 2.0, 0.5)
    starts = {"Chair 01": (0.5, 0.0, 2.0), "Pillow 01": (0.0, -0.5, 2.0), "Dish 01": (-0.5, 0.5, 2.0)}
    directions = [Vector3(0, 5, 2), Vector3(2, 3, 1), Vector3(4, 1, 2)]
    objects = [
        Object(
            prefab.split()[0].lower(),
            prefab,
            here + Vector3(*start),
            Vector3(0, 0, 0),
            UniformMovementRandomBounce(seed=32, speed=0.5, start_direction=direction),
            frustum_limited=True,
        )
        for (prefab, start), direction in zip(starts.items(), directions, strict=True)
    ]
    scenario = Scenario("room_02/scene", objects, AllTogetherTimings(0.2), Frustum(True, 10.0))
    return here, (18, -12, 0), scenario


def racket():
    """Return a tennis racket on a curve through the bedroom, after a wait."""
    poses = [
        ((0.5, 1.4, 0.5), (0, 0, 0)),
        ((0.3, 1.0, -1.0), (90, 0, 0)),
        ((-0.4, 0.6, 0.5), (90, 90, 0)),
        ((-1.5, 1.8, -1.0), (90, 90, 90)),
        ((0.5, 1.4, -1.0), (90, 90, 180)),
    ]
    dynamic = CatmullWaypoints([Waypoint(Vector3(*at), Vector3(*turn)) for at, turn in poses])
    objects = [Object("racket", "Tennis Racket 01", Vector3(0.5, 1.4, 0.5), Vector3(0, 0, 0), dynamic)]
    timings = WaitUntilCompleteTimings(0.2)
    return (-1.3, 2, 1.5), (22, 144, 0), Scenario("room_01/scene", objects, timings, Frustum(False, 20.0))


@pytest.mark.slow
@pytest.mark.parametrize("example", [cylinder, bouncing, racket])
def test_streams_of_the_paper_are_the_same_in_process_and_over_the_network(make_agent, tmp_path, example):
    position, rotation, scenario = example()
    agent = make_agent(quality="preview")
    with served(tmp_path, "object_view", "--spp", "1") as server, Client(server.address, 64, 48, timeout=600.0) as c:
        agent.set_position(position), c.set_position(position)
        agent.set_rotation(rotation), c.set_rotation(rotation)
        ids = [id for id, _ in agent.load_scenario(scenario)]
        assert c.load_scenario(scenario) == ids
        assert "" not in ids
        seen = set()
        for _ in range(12):
            here, there = agent.get_frame(), c.frame()
            for name in ("main", "category", "object", "flow", "depth"):
                np.testing.assert_array_equal(here[name], there[name])
            seen.add(here["object"].tobytes())
        names = {agent.categories[number] for number in np.unique(here["category"]) if number != 255}
    assert len(seen) > 5  # the moving objects are in the image
    assert names >= {each.prefab.removesuffix(" 01").lower() for each in scenario.objects}
