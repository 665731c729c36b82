# SPDX-License-Identifier: Apache-2.0
"""The TCP server: clients that send garbage, half messages or nothing, or disappear."""

import asyncio
import contextlib
import queue
import signal
import socket
import struct
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

from tests.sailenv.client import MAIN, OBJECT, Client, text
from tests.sailenv.conftest import SCENE
from tiscene.sailenv import wire_format
from tiscene.sailenv.agent_worlds import AgentWorlds
from tiscene.sailenv.server import Server


def serves(server):
    """Return whether a new client is served."""
    with Client(server.address) as client:
        return client.frame(OBJECT)["object"].shape == (24, 32, 3)


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


class LargeFrames(Server):
    """A server whose frames are larger than what systems keep for a client that does not read."""

    async def frame(self, agent, views):
        return {"main": np.zeros((3000, 3000, 3), np.uint8)}, 0.04


def test_frame_that_a_dropped_client_has_not_taken_is_not_kept_for_it(monkeypatch):
    """Its socket and the frame stayed for as long as the client was there."""
    monkeypatch.setattr(wire_format, "TIMEOUT", 0.3)
    server, addresses = LargeFrames(AgentWorlds(SCENE), port=0), queue.SimpleQueue()
    thread = threading.Thread(target=lambda: asyncio.run(server.run(lambda *address: addresses.put(address))))
    thread.start()
    try:
        with Client(addresses.get(timeout=30.0), timeout=20.0) as c:
            c.ask(0x00, bytes([MAIN]))
            size = c.int()
            deadline = time.monotonic() + 20.0
            while server._clients and time.monotonic() < deadline:
                time.sleep(0.05)
            taken = 0
            with contextlib.suppress(ConnectionError):
                while data := c.socket.recv(1 << 20):
                    taken += len(data)
            assert taken < size
    finally:
        server.stop()
        thread.join()


def test_client_killed_in_the_middle_of_a_frame_does_not_block_others(server, connect):
    other = connect()
    script = (
        "import sys, time\nfrom tests.sailenv.client import Client\n"
        f"c = Client({server.address!r}, width=160, height=120)\n"
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
