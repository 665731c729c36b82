# SPDX-License-Identifier: Apache-2.0
"""The TCP server: several clients and their clock."""

import socket
import statistics
import threading
import time

import numpy as np
import pytest

from tests.sailenv.client import FLOW, MAIN, OBJECT
from tests.sailenv.conftest import SCENE, WAIT, circling
from tiscene.sailenv import AllTogetherTimings, Scenario


@pytest.mark.slow
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


@pytest.mark.skipif(not hasattr(socket, "TCP_QUICKACK"), reason="only Linux acknowledges at once")
def test_client_that_sends_arguments_one_by_one_is_not_held_back_by_its_system(connect):
    def one_by_one(connection, data):
        for first in range(0, len(data), 4):
            connection.send(data[first : first + 4])

    client = connect(send=one_by_one)
    client.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 0)  # as SAILenv's own client
    times = []
    for degrees in range(31):
        began = time.monotonic()
        assert client.set_rotation((0.0, degrees, 0.0)) == "ok"
        times.append(time.monotonic() - began)
    assert statistics.median(times) < 0.03  # 0.04 to 0.09 otherwise
