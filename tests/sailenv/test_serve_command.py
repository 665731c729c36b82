# SPDX-License-Identifier: Apache-2.0
"""`tiscene serve` as a process: arguments and signals."""

import re
import signal

import pytest

from tests.sailenv.client import MAIN, Client
from tests.sailenv.served import Served, served
from tiscene.cli.main import main
from tiscene.errors import ArgumentError
from tiscene.sailenv.agent_worlds import AgentWorlds
from tiscene.sailenv.server import Server


@pytest.mark.slow
def test_no_incremental_renders_each_frame_from_scratch(tmp_path):
    with served(tmp_path, "object_view", "--no-incremental") as server, Client(server.address) as c:
        c.spawn("Sphere", (0, 1, 2.5))
        frames = [c.frame(MAIN)["main"] for _ in range(2)]
    assert (frames[0] != frames[1]).any()


def test_interrupt_stops_the_server_cleanly(tmp_path):
    """As SIGTERM does, by which `served` stops every server."""
    server = Served(tmp_path, "object_view")
    with Client(server.address) as c:
        assert server.address[0] == "127.0.0.1"
        assert server.stop(signal.SIGINT) == 0
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


def test_empty_host_is_refused():
    """It would be that of all networks, where a script's variable is not set."""
    with pytest.raises(ArgumentError, match=r"127\.0\.0\.1 is this machine alone"):
        Server(AgentWorlds(), host="")
