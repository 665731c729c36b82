# SPDX-License-Identifier: Apache-2.0
"""Threads that share a stream: edits lie between frames, and each frame goes to one thread."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from tests.stream.test_stream import same
from tiscene.scenario.objects import Object
from tiscene.scenario.scenario import Scenario
from tiscene.stream.render_ahead import RenderAhead
from tiscene.stream.stream import Stream
from tiscene.world.world import World

SETTINGS = {"width": 16, "height": 12, "frames": 40, "buffers": ("instance", "depth", "backward_flow")}

EDITS = {
    "move": lambda world: world.move("ball", (0.4, 1.0, -2.0)),
    "despawn": lambda world: world.despawn("ball"),
    "spawn": lambda world: world.spawn("Ball 01", (0.4, 1.0, -2.0)),
    "turn_camera": lambda world: world.turn_camera(yaw=20.0),
    "move_camera": lambda world: world.move_camera((0.0, 0.3, 0.0), relative=True),
}


def ball() -> Scenario:
    return Scenario("solid_benchmark", [Object("ball", "Ball 01", (-0.4, 1, -2))])


@pytest.mark.parametrize("edit", EDITS)
def test_edit_by_another_thread_while_a_frame_is_rendered_replays(edit, monkeypatch):
    """It takes effect at the next frame, whose pixels show it; the frame itself is finished as it began."""
    stream, threads, compute = Stream(ball(), **SETTINGS), [], World._compute_state

    def edited(world, parts, frame):
        state = compute(world, parts, frame)
        if frame == 2 and not threads:
            threads.append(threading.Thread(target=EDITS[edit], args=(stream.world,)))
            threads[0].start()
            threads[0].join(0.2)
        return state

    monkeypatch.setattr(World, "_compute_state", edited)
    seen = [next(stream) for _ in range(3)]
    threads[0].join()
    seen += [next(stream) for _ in range(2)]
    replay = Stream(stream.scenario, **SETTINGS)
    assert [same(frame, replay[frame.index]) for frame in seen] == [True] * 5
    assert [each.frame for each in stream.scenario.edits] == [3]
    assert not np.array_equal(seen[2].depth, seen[3].depth)


def test_edit_by_another_thread_while_the_worker_renders_replays(monkeypatch):
    """The worker's pixels lack the edit."""
    with Stream(ball(), prefetch=2, **SETTINGS) as stream:
        seen, receive = [next(stream)], RenderAhead._receive

        def edited(ahead):
            received = receive(ahead)
            if stream.position == 1 and not stream.world.edit_count:
                stream.world.move("ball", (0.4, 1.0, -3.0))
            return received

        monkeypatch.setattr(RenderAhead, "_receive", edited)
        seen += [next(stream) for _ in range(3)]
        replay = Stream(stream.scenario, **SETTINGS)
        assert [same(frame, replay[frame.index]) for frame in seen] == [True] * 4
        assert [each.frame for each in stream.scenario.edits] == [1]


@pytest.mark.parametrize("prefetch", [0, 2])
def test_each_frame_goes_to_one_of_the_threads_that_iterate(prefetch):
    with Stream(ball(), prefetch=prefetch, **SETTINGS) as stream, ThreadPoolExecutor(4) as pool:
        found = [frame.index for frames in pool.map(list, [stream] * 4) for frame in frames]
    assert sorted(found) == list(range(40))


def test_seek_by_another_thread_is_not_lost(monkeypatch):
    stream, threads, compute = Stream(ball(), **SETTINGS), [], World._compute_state

    def sought(world, parts, frame):
        if not threads:
            threads.append(threading.Thread(target=stream.seek, args=(20,)))
            threads[0].start()
            time.sleep(0.1)
        return compute(world, parts, frame)

    monkeypatch.setattr(World, "_compute_state", sought)
    next(stream)
    threads[0].join()
    assert next(stream).index == 20
