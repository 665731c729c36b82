# SPDX-License-Identifier: Apache-2.0
"""Agents and clients of a server in the object view, which is quick to read and to render."""

import contextlib
import io
import zipfile
from dataclasses import replace

import pytest

from tests.sailenv.client import Client
from tests.sailenv.served import served
from tiscene.render.render_settings import PRESETS
from tiscene.sailenv import Agent, CatmullWaypoints, LinearWaypoints, Object, Waypoint

SCENE = "object_view/scene"
HOME = (0.0, 1.0, 0.0)  # agents look along +z
SETTINGS = {"scene": SCENE, "spp": 1}
VIEWS = ("main", "category", "object", "flow", "depth")
SERVED = ("--spp", "1", "--no-incremental", "--query-budget", "3")  # agents beside clients have these settings too
WAIT = 2.0  # s: for how long the server's clock waits for a slow client


@pytest.fixture(scope="package", autouse=True)
def few_samples():
    """Give base images and panoramas few samples per pixel; their noise matters to no test here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(PRESETS, "preview", replace(PRESETS["preview"], base_spp=8, panorama_spp=8))
        yield


@pytest.fixture
def make_agent(request):
    """Return a function that registers an agent at HOME; all agents of a test share a world, which ends with it."""
    agents = []

    def make(*, at=HOME, **others):
        named = {"port": abs(hash(request.node.nodeid)) % 60000, "width": 64, "height": 48} | SETTINGS
        named |= ({"incremental": False} if "server" in request.fixturenames else {}) | others
        agent = Agent(**named)
        agent.register()
        if at is not None:
            agent.set_position(at)
        agents.append(agent)
        return agent

    yield make
    for agent in agents:
        agent.delete()


@pytest.fixture(scope="package")
def server(tmp_path_factory):
    with served(tmp_path_factory.mktemp("serve"), "object_view", *SERVED, "--wait", str(WAIT)) as server:
        yield server


@pytest.fixture
def connect(server):
    """Return a function that connects a client to an empty scene."""
    with contextlib.ExitStack() as stack:

        def connect(**others):
            return stack.enter_context(Client(server.address, **others))

        assert connect().change_scene(SCENE) == "ok"
        yield connect


def path(*positions, seconds=4.0):
    return LinearWaypoints([Waypoint(position) for position in positions], seconds)


def zipped(members):
    """Return a ZIP file of contents by name."""
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return data.getvalue()


def circling(**others):
    """Return a cylinder that moves along a closed curve."""
    waypoints = [Waypoint((0.0, 1.0, 2.5)), Waypoint((0.6, 1.3, 3.0)), Waypoint((-0.5, 0.8, 3.5))]
    return Object("c", "Cylinder", (0, 0, 2), (0, 0, 0), CatmullWaypoints(waypoints, 10.0), **others)
