# SPDX-License-Identifier: Apache-2.0
"""The TCP server: every command, several clients, old and faulty clients, and garbage."""

import contextlib
import io
import json
import random
import re
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
import zipfile

import numpy as np
import pytest

from tests.sailenv import client as wire
from tests.sailenv.client import ALL, FLOW, MAIN, OBJECT, Client, text
from tests.sailenv.conftest import SCENE
from tests.sailenv.served import Served, served
from tiscene.cli.main import main
from tiscene.sailenv import (
    AllTogetherTimings,
    CatmullWaypoints,
    LinearWaypoints,
    Object,
    Scenario,
    UniformMovementRandomBounce,
    Waypoint,
)

COMMANDS = range(0x1F)
WAIT = 2.0  # s
CUBE = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n" + b"".join(
    b"f %d %d %d %d\n" % face
    for face in ((1, 4, 3, 2), (5, 6, 7, 8), (1, 2, 6, 5), (3, 4, 8, 7), (1, 5, 8, 4), (2, 3, 7, 6))
)


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    with served(tmp_path_factory.mktemp("serve"), "object_view", "--spp", "1", "--wait", str(WAIT)) as server:
        yield server


@pytest.fixture
def connect(server):
    """Return a function that connects a client to an empty scene."""
    with contextlib.ExitStack() as stack:

        def connect(**others):
            return stack.enter_context(Client(server.address, **others))

        assert connect().change_scene(SCENE) == "ok"
        yield connect


def circling(**others):
    waypoints = [Waypoint((0.0, 1.0, 2.5)), Waypoint((0.6, 1.3, 3.0)), Waypoint((-0.5, 0.8, 3.5))]
    return Object("c", "Cylinder", (0, 0, 2), (0, 0, 0), CatmullWaypoints(waypoints, 10.0), **others)


def zipped(**members):
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        for name, content in members.items():
            archive.writestr(name.replace("__", "."), content)
    return data.getvalue()


def serves(server):
    """Return whether a new client is served."""
    with Client(server.address) as client:
        return client.frame(OBJECT)["object"].shape == (24, 32, 3)


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
    path = c.send_obj_zip("cube.zip", zipped(cube__obj=CUBE))
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
        assert remote["deltaTime"] == pytest.approx(local["deltaTime"])


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
    path = slow.send_obj_zip("c.zip", zipped(c__obj=CUBE))
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


def test_four_concurrent_clients_see_the_same_frames(connect):
    scenario = Scenario(SCENE, [circling()], AllTogetherTimings(0.0))
    clients = [connect() for _ in range(4)]
    clients[0].load_scenario(scenario)
    for c in clients:  # from here on the clock waits for all of them
        c.frame(FLOW)
    seen = [[] for _ in clients]

    def request_frames(row):
        for _ in range(6):
            seen[row].append(clients[row].frame(MAIN | OBJECT | FLOW))
            time.sleep(0.01 * row)

    threads = [threading.Thread(target=request_frames, args=(row,)) for row in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60.0)
    for frames in seen[1:]:
        assert len(frames) == 6
        for mine, theirs in zip(frames, seen[0], strict=True):
            assert mine["deltaTime"] == pytest.approx(0.04)
            for name in ("main", "object", "flow"):
                np.testing.assert_array_equal(mine[name], theirs[name])
    assert len({frame["flow"].tobytes() for frame in seen[0]}) == 6


def test_clock_waits_for_a_slow_client_once(connect):
    quick, slow = connect(), connect()
    quick.frame(OBJECT), slow.frame(OBJECT)
    quick.frame(OBJECT)
    began = time.monotonic()
    quick.frame(OBJECT)
    assert time.monotonic() - began > 0.9 * WAIT
    began = time.monotonic()
    for _ in range(3):
        quick.frame(OBJECT)
    assert time.monotonic() - began < 0.9 * WAIT
    assert slow.frame(OBJECT)["deltaTime"] == pytest.approx(5 * 0.04)


@pytest.mark.parametrize(
    "message",
    [
        b"",
        b"\x10",
        struct.pack("<ii?", -1, 5, False),
        struct.pack("<ii?", 2**31 - 1, 2**31 - 1, False),
        struct.pack("<ii?", 0, 0, True),
        b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n",
    ],
)
def test_client_with_an_invalid_registration_is_dropped(server, message):
    with socket.create_connection(server.address, timeout=20.0) as connection:
        connection.sendall(message)
        connection.shutdown(socket.SHUT_WR)
        assert connection.recv(1) == b""
    assert serves(server)


@pytest.mark.parametrize(
    "message",
    [
        b"\xff",
        b"\x1f",
        b"\x02" + struct.pack("<i", -1),
        b"\x02" + struct.pack("<i", 2**31 - 1) + b"x" * 100,
        b"\x02" + struct.pack("<i", 4) + b"\xff\xfe\xfd\xfc",
        b"\x0c" + text("a.zip") + struct.pack("<i", 2**31 - 1),
        b"\x0c" + text("a.zip") + struct.pack("<i", -5),
        b"\x1d" + text("{]"),
        b"\x1d" + text("[" * 5000),
        b"\x1d" + text("5"),
        b"\x09"
        + text("Cube")
        + struct.pack("<6f?3f??", 0, 1, 3, 0, 0, 0, 1, 1, 1, 1, 1, 1)
        + b"\1"
        + text("x")
        + text("]"),
    ],
)
def test_client_that_violates_the_protocol_is_dropped_and_others_are_served(server, connect, message):
    other = connect()
    with Client(server.address, timeout=20.0) as c, contextlib.suppress(ConnectionError):
        c.write(message)
        assert c.socket.recv(1) == b""
    assert other.frame(OBJECT)["object"].shape == (24, 32, 3)


@pytest.mark.parametrize(
    "message",
    [b"\x00", b"\x02\x05\x00\x00\x00ab", b"\x09" + text("Cube") + b"\0" * 7, b"\x0c" + text("a") + b"\x00\x01\0\0abc"],
)
def test_incomplete_message_of_one_client_does_not_block_others(server, connect, message):
    other, silent = connect(), connect()
    silent.write(message)
    assert other.frame(OBJECT)["object"].shape == (24, 32, 3)
    silent.socket.close()
    assert other.spawn("Cube", (0, 1, 3)) != ""


def test_client_that_never_reads_does_not_block_others(server, connect):
    unread, other = connect(width=640, height=480), connect()
    for _ in range(40):
        unread.ask(0x00, bytes([OBJECT]))
    assert other.frame(OBJECT)["object"].shape == (24, 32, 3)
    unread.socket.close()


def test_client_killed_in_the_middle_of_a_frame_does_not_block_others(server, connect):
    other = connect()
    script = (
        "import sys, time\nfrom tests.sailenv.client import Client\n"
        f"c = Client({server.address!r}, width=320, height=240)\n"
        "for _ in range(3): c.frame()\n"
        "print('framing', flush=True)\n"
        "while True: c.ask(0x00, bytes([61]))\n"
    )
    child = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE)
    assert child.stdout.readline().strip() == b"framing"
    time.sleep(0.05)
    child.send_signal(signal.SIGKILL)
    child.wait()
    child.stdout.close()
    for _ in range(3):
        assert other.frame(OBJECT)["object"].shape == (24, 32, 3)


def fuzz(server, rounds, seed):
    """Connect clients that send random valid and invalid messages."""
    random_bytes = random.Random(seed)

    def garbage(count):
        return random_bytes.randbytes(random_bytes.randrange(count))

    def message():
        command = random_bytes.choice([*COMMANDS, random_bytes.randrange(256)])
        parts = {
            0: lambda: garbage(64),
            1: lambda: text(random_bytes.choice(["Cube", "Main Light", "a.zip", SCENE, "file:/etc/passwd", "x" * 500])),
            2: lambda: struct.pack("<i", random_bytes.choice([0, 1, -1, 5, 255, 65536, 2**31 - 1, -(2**31)])),
            3: lambda: struct.pack("<3f", *(random_bytes.choice([0, 1.5, -1e30, 1e38, float("nan")]) for _ in "xyz")),
            4: lambda: text(json.dumps({"scene_name": SCENE, "objects": random_bytes.choice([[], [1], [{}], {}, 7])})),
            5: lambda: bytes([random_bytes.randrange(2)]),
        }
        return bytes([command]) + b"".join(parts[random_bytes.randrange(6)]() for _ in range(random_bytes.randrange(6)))

    for _ in range(rounds):
        with socket.create_connection(server.address, timeout=20.0) as connection, contextlib.suppress(OSError):
            if random_bytes.random() < 0.1:
                connection.sendall(garbage(40))
                continue
            connection.sendall(struct.pack("<ii?", 16, 12, random_bytes.random() < 0.5))
            for _ in range(random_bytes.randrange(1, 8)):
                connection.sendall(message())
            if random_bytes.random() < 0.5:
                connection.shutdown(socket.SHUT_WR)
                connection.settimeout(2.0)
                while connection.recv(65536):
                    pass


def test_server_survives_random_messages(server):
    fuzz(server, 40, seed=1)
    assert serves(server)


def test_client_that_changes_its_scene_leaves_the_others_where_they_are(connect):
    staying, leaving = connect(), connect()
    staying.spawn("Cube", (0, 1, 3))
    before, _ = staying.frame(OBJECT), leaving.frame(OBJECT)
    assert leaving.change_scene("solid_benchmark/scene") == "ok"
    for _ in range(3):
        leaving.frame(OBJECT)
    began = time.monotonic()
    for _ in range(3):
        frame = staying.frame(OBJECT)
        assert (frame["object"] == before["object"]).all()
        assert frame["deltaTime"] == pytest.approx(0.04)
    assert time.monotonic() - began < 2 * WAIT  # the clock does not wait for those elsewhere
    assert leaving.change_scene(SCENE) == "ok"
    assert leaving.frame(OBJECT)["object"].any()


@pytest.mark.slow
def test_memory_does_not_grow_with_random_messages(server):
    fuzz(server, 300, seed=2)
    before = server.resident
    for seed in range(3, 8):
        fuzz(server, 300, seed=seed)
    assert server.resident - before < 40 << 20
    assert serves(server)


def test_no_incremental_renders_each_frame_from_scratch(tmp_path):
    with served(tmp_path, "object_view", "--no-incremental") as server, Client(server.address) as c:
        c.spawn("Sphere", (0, 1, 2.5))
        frames = [c.frame(MAIN)["main"] for _ in range(2)]
    assert (frames[0] != frames[1]).any()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_stops_the_server_cleanly(tmp_path, number):
    server = Served(tmp_path, "object_view")
    with Client(server.address) as c:
        assert server.address[0] == "127.0.0.1"
        assert server.stop(number) == 0
        assert c.socket.recv(1) == b""
    assert re.search(r"agent 0 \(127.0.0.1:\d+\) registered, 32x24\n", server.log)
    assert server.log.rstrip().endswith("stopped")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--host", "nowhere.invalid"], "cannot listen on nowhere.invalid:8085"),
        (["--port", "70000"], "--port 70000: must be from 0 to 65535"),
        (["--wait", "-1"], "--wait -1.0: must be 0 s or more"),
        (["--fps", "0"], "fps=0"),
        (["--quality", "best"], "quality='best': must be one of fast"),
        (["--spp", "0"], "spp=0: must be at least 1"),
        (["--seed", "-1"], "seed=-1: must be from 0"),
        (["--arch", "metal"], "arch='metal': must be one of cpu, cuda"),
        (["nowhere"], "no scene 'nowhere'"),
    ],
)
def test_invalid_arguments_of_serve_are_errors(capsys, arguments, message):
    assert main(["serve", *arguments]) == 2
    assert message in capsys.readouterr().err
