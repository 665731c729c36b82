# SPDX-License-Identifier: Apache-2.0
"""Row "server": random bytes, half messages, slow and killed clients, many connections and signals, on loopback.

After each attack a new client must be served within a time limit. The server's memory stays bounded.
"""

from __future__ import annotations

import contextlib
import io
import json
import random
import signal
import socket
import struct
import tempfile
import time
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from tests.sailenv.client import OBJECT, Client, text
from tests.sailenv.served import Served
from tests.stress.outcomes import Outcome, count
from tests.stress.process_resources import resources

SELF = "tests.stress.server_attacks"
SERVICE = 60.0  # s, in which a new client must get a frame after an attack
MEMORY_GROWTH = 100 << 20  # bytes, over all attacks after the first
WARM_UP = 200  # random messages before the first measurement: they compile all kernels, about 500 MB
ARGUMENTS = ("object_view", "--spp", "1", "--wait", "0.5")


def service_seconds(server: Served) -> float:
    """Return how long a new client waits for its first frame, s; it connects again if there are too many clients."""
    began = time.monotonic()
    while True:
        try:
            with Client(server.address, timeout=SERVICE) as client:
                assert client.frame(OBJECT)["object"].shape == (24, 32, 3)
            return time.monotonic() - began
        except (EOFError, ConnectionError):
            if time.monotonic() - began > SERVICE:
                raise
            time.sleep(0.1)


def connection(server: Served, registered: bool = True) -> socket.socket:
    """Return a connection; registered: with the first message of the protocol sent."""
    connected = socket.create_connection(server.address, timeout=5.0)
    if registered:
        connected.sendall(struct.pack("<ii?", 16, 12, False))
    return connected


def random_message(rng: random.Random) -> bytes:
    """Return a command with arguments that may fit it, or random bytes."""
    parts: list[Callable[[], bytes]] = [
        lambda: rng.randbytes(rng.randrange(64)),
        lambda: text(rng.choice(["Cube", "Main Light", "a.zip", "file:/etc/passwd", "../../x", "x" * 5000])),
        lambda: struct.pack("<i", rng.choice([0, 1, -1, 255, 65536, 2**31 - 1, -(2**31)])),
        lambda: struct.pack("<3f", *(rng.choice([0, 1.5, -1e30, 1e38, float("nan")]) for _ in "xyz")),
        lambda: text(json.dumps({"scene_name": "object_view/scene", "objects": rng.choice([[], [1], [{}], {}, 7])})),
    ]
    return bytes([rng.randrange(0x22)]) + b"".join(rng.choice(parts)() for _ in range(rng.randrange(6)))


def send_random(server: Served, repetitions: int) -> str:
    """Send random messages, then disconnect."""
    rng = random.Random(repetitions)
    for _ in range(repetitions):
        with connection(server, rng.random() < 0.8) as connected, contextlib.suppress(OSError):
            for _ in range(rng.randrange(1, 8)):
                connected.sendall(random_message(rng))
    return "connections with random messages"


def send_halves(server: Served, repetitions: int) -> str:
    """Send the first half of a valid message, wait a moment, then disconnect without or with a reset."""
    rng = random.Random(repetitions)
    whole = (
        b"\x02" + text("object_view/scene"),
        b"\x09" + text("Cube") + struct.pack("<6f?3f??", 0, 1, 3, 0, 0, 0, 1, 1, 1, 1, 1, 1) + b"\0",
        b"\x0c" + text("a.zip") + struct.pack("<i", 1000) + bytes(1000),
        b"\x1d" + text(json.dumps({"scene_name": "object_view/scene", "objects": []})),
    )
    for _ in range(repetitions):
        with connection(server) as connected, contextlib.suppress(OSError):
            message = rng.choice(whole)
            connected.sendall(message[: rng.randrange(len(message))])
            time.sleep(0.01)
            if rng.random() < 0.5:
                connected.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    return "messages cut in half"


def connect_many(server: Served, repetitions: int) -> str:
    """Keep connections open, some registered, all silent; then close them."""
    with contextlib.ExitStack() as stack:
        for number in range(repetitions):
            with contextlib.suppress(OSError):
                stack.enter_context(connection(server, number % 2 == 0))
        time.sleep(0.5)
    return "silent connections at a time"


def request_unread(server: Served, repetitions: int) -> str:
    """Request large frames and read none."""
    with contextlib.ExitStack() as stack:
        for _ in range(repetitions):
            connected = stack.enter_context(socket.create_connection(server.address, timeout=5.0))
            connected.sendall(struct.pack("<ii?", 320, 240, False))
            with contextlib.suppress(OSError):
                connected.sendall(b"\x00\x08" * 20)
        service_seconds(server)
    return "clients that request 20 frames and read none"


def upload_bombs(server: Served, repetitions: int) -> str:
    """Upload archives that would expand to 1 GB, and archives with paths that leave their folder."""
    bomb, escape = io.BytesIO(), io.BytesIO()
    with (
        zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("a.obj", "w", force_zip64=True) as member,
    ):
        for _ in range(256):
            member.write(bytes(1 << 22))
    with zipfile.ZipFile(escape, "w") as archive:
        for name in ("../escaped.obj", "/tmp/tiscene-escaped.obj", "a/../../escaped.obj"):
            archive.writestr(name, "v 0 0 0\n")
    accepted = 0
    for number in range(repetitions):
        with Client(server.address, timeout=60.0) as client, contextlib.suppress(EOFError, OSError):
            data = (bomb, escape)[number % 2].getvalue()
            path = client.send_obj_zip("model.zip", data)
            accepted += bool(path and client.spawn("file:" + path, (0, 0, 3)))
    assert not Path("/tmp/tiscene-escaped.obj").exists()
    assert not accepted, f"{accepted} archives were accepted"
    return "uploads of archive bombs and of paths that leave the folder"


def kill_clients(server: Served, repetitions: int) -> str:
    """Start client processes that request frames, and kill them."""
    from tests.stress.child_process import start

    for _ in range(repetitions):
        with start(f"{SELF}:request_frames", list(server.address)) as process:
            assert process.stdout is not None
            began = process.stdout.readline()
            process.kill()
            assert began, "a client got no frame"
    return "client processes killed while they request frames"


def request_frames(address: list[Any]) -> None:
    """Run in a child process: request frames until killed."""
    client = Client((address[0], address[1]), timeout=SERVICE)
    client.frame(OBJECT)
    print("ready", flush=True)
    while True:
        client.frame(OBJECT)


ATTACKS: tuple[tuple[Callable[[Served, int], str], int], ...] = (
    (send_random, 1000),
    (send_halves, 500),
    (connect_many, 100),
    (request_unread, 20),
    (upload_bombs, 10),
    (kill_clients, 20),
)


def attack(server: Served, function: Callable[[Served, int], str], repetitions: int) -> Outcome:
    """Run an attack and measure how the server serves a new client afterwards."""
    use = (function.__doc__ or "").splitlines()[0]
    before, began = resources(server.process.pid), time.monotonic()
    try:
        use = f"{repetitions} {function(server, repetitions)}"
        seconds = service_seconds(server)
    except (AssertionError, EOFError, OSError) as error:
        return Outcome(use, f"{error!r}; the server runs: {server.process.poll() is None}", False)
    after = resources(server.process.pid)
    duration = time.monotonic() - began
    figures = (
        f"{duration:.0f} s; next client served in {seconds:.2f} s; {before.resident >> 20} to {after.resident >> 20} MB"
    )
    return Outcome(use, figures, after.resident - before.resident < MEMORY_GROWTH)


def stop_with_clients(folder: Path, clients: int) -> Outcome:
    """Send SIGTERM to a server whose clients wait for frames and replies."""
    server = Served(folder, *ARGUMENTS)
    service_seconds(server)
    with contextlib.ExitStack() as stack:
        for number in range(clients):
            connected = stack.enter_context(connection(server, number % 3 > 0))
            if number % 3 == 2:
                connected.sendall(b"\x00\x08")
        began = time.monotonic()
        status = server.stop(signal.SIGTERM)
        seconds = time.monotonic() - began
    traceback = "Traceback" in server.log
    figures = f"exit status {status} after {seconds:.2f} s; traceback in the log: {traceback}"
    return Outcome(f"SIGTERM with {clients} clients", figures, status == 0 and not traceback)


def rows(scale: float) -> Iterator[Outcome]:
    """Run the row; scale 1 is the full count."""
    with tempfile.TemporaryDirectory(prefix="tiscene-stress-") as name:
        server = Served(Path(name), *ARGUMENTS)
        try:
            service_seconds(server)
            send_random(server, WARM_UP)
            service_seconds(server)
            files = resources(server.process.pid).files
            for function, full in ATTACKS:
                yield attack(server, function, count(full, scale, 2))
            time.sleep(0.5)
            left = resources(server.process.pid).files - files
            status = server.stop()
            errors = server.log.count("Traceback")
            figures = f"{left} more open files; exit status {status}; {errors} tracebacks in the log"
            yield Outcome("the server after all attacks", figures, left <= 0 and status == 0 and not errors)
        finally:
            server.process.kill()
        yield stop_with_clients(Path(name), count(50, scale, 6))
