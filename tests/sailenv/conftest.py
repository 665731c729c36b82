# SPDX-License-Identifier: Apache-2.0
"""Agents in the object view, which is quick to read and to render."""

import pytest

from tiscene.sailenv import Agent

SCENE = "object_view/scene"
HOME = (0.0, 1.0, 0.0)  # agents look along +z
SETTINGS = {"scene": SCENE, "spp": 1}


@pytest.fixture
def make_agent(request):
    """Return a function that registers an agent at HOME; all agents of a test share a world, which ends with it."""
    agents = []

    def make(*, at=HOME, **others):
        named = {"port": abs(hash(request.node.nodeid)) % 60000, "width": 64, "height": 48} | SETTINGS | others
        agent = Agent(**named)
        agent.register()
        if at is not None:
            agent.set_position(at)
        agents.append(agent)
        return agent

    yield make
    for agent in agents:
        agent.delete()
