# SPDX-License-Identifier: Apache-2.0
"""The TCP server: every command of the protocol, frames, and messages of clients of all versions."""

import json
import struct

import numpy as np
import pytest

from tests.sailenv import client as wire
from tests.sailenv.client import ALL, MAIN, OBJECT, text
from tests.sailenv.conftest import SCENE, circling, zipped
from tiscene.sailenv import (
    AllTogetherTimings,
    LinearWaypoints,
    Object,
    Scenario,
    UniformMovementRandomBounce,
    Waypoint,
)

COMMANDS = range(0x1F)
CUBE = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n" + b"".join(
    b"f %d %d %d %d\n" % face
    for face in ((1, 4, 3, 2), (5, 6, 7, 8), (1, 2, 6, 5), (3, 4, 8, 7), (1, 5, 8, 4), (2, 3, 7, 6))
)


def test_every_command_of_the_protocol(connect):
    c = connect(width=48, height=36)
    used = set()
    write = c.write
    c.write = lambda data: (used.add(data[0]), write(data))[1]

    assert SCENE in c.scenes
    assert c.change_scene(SCENE) == "ok"
    assert "Did you mean" in c.change_scene("object_veiw")
    categories = c.categories()
    assert categories
    assert "" not in categories.values()
    assert {"Cube", "Chair 01", "Cube Trail"} <= set(c.spawnables())
    assert "Directional Light" in c.light_names()

    np.testing.assert_allclose(c.position(), (0.0, 0.2, -2.5), rtol=1e-6)
    assert c.set_position((0.25, 1.5, -0.5)) == "ok"
    assert c.position() == (0.25, 1.5, -0.5)
    assert c.set_rotation((10.0, 20.0, 0.0)) == "ok"
    assert c.rotation() == (10.0, 20.0, 0.0)
    assert c.set_position((float("nan"), 0.0, 0.0)) != "ok"
    assert c.set_position((0.0, 1.0, 0.0)) == c.set_rotation((0.0, 0.0, 0.0)) == "ok"

    cube = c.spawn("Cube", (0.0, 1.0, 3.0), scale=(0.5, 0.5, 0.5), limited=False)
    assert int(cube) > 0
    ball = c.spawn("Sphere", (0.5, 1, 3), dynamic=UniformMovementRandomBounce())
    assert int(ball) > 0
    assert c.spawn("Nothing") == ""
    frame = c.frame(ALL)
    assert frame["main"].shape == frame["object"].shape == (36, 48, 3)
    assert frame["flow"].shape == (36, 48, 2)
    assert frame["category"].shape == frame["depth"].shape == (36, 48)
    assert frame["deltaTime"] == pytest.approx(0.04)
    assert categories[int(frame["category"][18, 24])] == "cube"
    assert frame["category"][0, 0] == 255
    assert frame["depth"][0, 0] == 1.0
    assert len(np.unique(frame["object"].reshape(-1, 3), axis=0)) == 3
    assert c.move(cube, (0.0, 1.0, 4.0)) == "ok"
    assert c.move(12345, (0.0, 1.0, 4.0)) != "ok"
    nearer = frame["depth"][18, 24]
    assert c.frame(wire.DEPTH)["depth"][18, 24] > nearer
    assert c.despawn(ball) == "ok"
    assert c.despawn(ball) != "ok"
    c.spawn_view_frustum()
    assert set(c.frame(OBJECT)) == {"object", "deltaTime"}

    light = "Directional Light"
    for get, put, kind, form, values in (
        (0x0E, 0x0F, "ints", "<3i", (255, 128, 0)),
        (0x10, 0x11, "float", "<f", (2.5,)),
        (0x12, 0x13, "float", "<f", (0.5,)),
        (0x14, 0x15, "vector", "<3f", (1.0, 2.0, 3.0)),
        (0x16, 0x17, "vector", "<3f", (0.0, -1.0, 0.0)),
    ):
        assert "No Light" in c.light(get, "No Light", kind)
        assert c.set_light(put, "No Light", form, *values) != "ok"
        assert c.set_light(put, light, form, *values) == "ok"
        assert c.light(get, light, kind) == (values if len(values) > 1 else values[0])
    assert c.light_type(light) == "Directional"
    assert c.light_type("No Light") == "light_not_found"
    assert c.ambient() == (0, 0, 0)
    assert c.set_ambient(10, 20, 30) == "ok"
    assert c.ambient() == (10, 20, 30)
    assert c.clear_flags(255, 0, 127) == "ok"
    np.testing.assert_array_equal(np.rint(c.frame(MAIN)["main"][0, 0] * 255), (255, 0, 127))
    assert c.toggle_follow() == "ok"
    path = c.send_obj_zip("cube.zip", zipped({"cube.obj": CUBE}))
    assert path.endswith("cube.zip")
    uploaded = c.spawn("file:" + path, (-0.5, 0.5, 3.0))
    assert int(uploaded) > 0
    assert c.spawn("file:/etc/passwd") == ""
    assert c.toggle_follow() == "ok"
    ids = c.load_scenario(Scenario(SCENE, [circling()]))
    assert len(ids) == 1
    assert int(ids[0]) > 0
    assert c.load_scenario(Scenario(SCENE, [Object("a", "Nothing", (0, 0, 0), (0, 0, 0))])) == [""]
    c.delete()
    assert used >= set(COMMANDS)


@pytest.mark.parametrize("compress", [False, True])
def test_frames_over_the_network_are_those_in_process(server, connect, make_agent, compress):
    scenario = Scenario(SCENE, [circling()], AllTogetherTimings(0.0))
    c = connect(compress=compress)
    agent = make_agent(at=None, width=32, height=24)
    (there,), ((here, _),) = c.load_scenario(scenario), agent.load_scenario(scenario)
    assert there == here
    for step in range(4):
        if step == 2:
            c.set_position((0.1, 1.1, 0.0)), agent.set_position((0.1, 1.1, 0.0))
            c.spawn("Dish 01", (0.3, 1.2, 1.5), (40, 0, 0)), agent.spawn_object("Dish 01", (0.3, 1.2, 1.5), (40, 0, 0))
        remote, local = c.frame(), agent.get_frame()
        for name in ("main", "category", "object", "flow", "depth"):
            np.testing.assert_array_equal(remote[name], local[name])
        assert remote["deltaTime"] == local["deltaTime"]


def test_numbers_over_the_network_are_those_in_process(server, connect, make_agent):
    """A script that computes with what it is told, such as one that walks by steps, does the same in both ways."""
    c, agent = connect(), make_agent(at=None, width=32, height=24)
    assert c.change_scene(SCENE) == "ok"
    agent.change_scene(SCENE)
    light = agent.lights_names[0]
    assert c.position() == tuple(agent.get_position())
    assert c.rotation() == tuple(agent.get_rotation())
    assert c.light(0x14, light, "vector") == agent.get_light_position(light)
    assert c.light(0x16, light, "vector") == agent.get_light_direction(light)
    assert c.set_light(0x13, light, "<f", 0.3) == "ok"
    agent.set_light_indirect_multiplier(light, 0.3)
    assert c.light(0x12, light, "float") == agent.get_light_indirect_multiplier(light)


def test_messages_may_arrive_byte_by_byte(connect):
    def send_bytewise(connection, data):
        for byte in data:
            connection.sendall(bytes([byte]))

    slow, plain = connect(send=send_bytewise), connect()
    scenario = Scenario(SCENE, [circling()], AllTogetherTimings(0.0))
    assert len(slow.load_scenario(scenario)) == 1
    spawned = slow.spawn("Cube", (0.4, 1.0, 3.0), dynamic=LinearWaypoints([Waypoint((0, 1, 3)), Waypoint((1, 1, 3))]))
    assert int(spawned) > 0
    assert slow.set_light(0x0F, "Main Light", "<3i", 1, 2, 3) == "ok"
    path = slow.send_obj_zip("c.zip", zipped({"c.obj": CUBE}))
    assert int(slow.spawn("file:" + path, (0, 0, 3))) > 0
    one, two = slow.frame(), plain.frame()
    for name in ("main", "category", "object", "flow", "depth"):
        np.testing.assert_array_equal(one[name], two[name])


def test_spawn_accepts_messages_of_older_clients(connect):
    bounce = UniformMovementRandomBounce(speed=0.5)
    dynamic = text(bounce.get_type()) + text(json.dumps(bounce.asdict()))
    for ends in ([b"", b""], [b"\0", b"\1" + dynamic, b"\0"], [b"\1" + dynamic, b"\0"]):
        c = connect()
        assert c.change_scene(SCENE) == "ok"
        for x, end in enumerate(ends):
            start = text("Cube") + struct.pack("<6f?3f?", 2 * x - 1, 1, 3, 0, 0, 0, True, 1, 1, 1, True)
            assert int(c.request(0x09, start + end)) > 0
        assert c.frame(OBJECT)["object"].any()
