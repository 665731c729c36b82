# SPDX-License-Identifier: Apache-2.0
"""Rendering ahead in a worker process: the bytes, order and errors of a stream without it, and a clean end."""

import contextlib
import copy
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from dynamics import LinearWaypoints, Waypoint
from tiscene.errors import ArgumentError, DeviceError
from tiscene.scenario.objects import Object
from tiscene.scenario.scenario import Scenario
from tiscene.stream.stream import Stream

SETTINGS = {"width": 16, "height": 12, "frames": 40, "buffers": ("instance", "depth")}


class Guarded(LinearWaypoints):
    """A path that cannot be pickled until it is released."""

    is_released = False

    def __getstate__(self):
        if not self.is_released:
            raise TypeError("is not released")
        return vars(self)


def scenario() -> Scenario:
    return Scenario("solid_benchmark", [Object("ball", "Ball 01", (0, 1, -3))])


@pytest.fixture(scope="module")
def ahead():
    """One stream with a worker for all tests of this module: its start takes seconds."""
    with Stream(scenario(), prefetch=3, **SETTINGS) as stream:
        yield stream


@pytest.fixture
def plain():
    return Stream(scenario(), **SETTINGS)


def assert_equal_frames(frame, other):
    assert frame.index == other.index
    for name in other:
        assert frame[name].tobytes() == other[name].tobytes(), name
    # Boxes are read before anything else measures the objects: nothing has been rendered in this process then.
    assert frame.objects.by_name("ball").amodal_box == other.objects.by_name("ball").amodal_box
    for name, column in frame.objects.arrays().items():
        assert column.tobytes() == other.objects.arrays()[name].tobytes(), name


def test_frames_are_those_of_a_stream_without_worker_after_seeks_and_edits(ahead, plain):
    for stream in (ahead, plain):
        stream.seek(0)
    for _ in range(4):
        assert_equal_frames(next(ahead), next(plain))
    for stream in (ahead, plain):
        stream.seek(20)
    assert_equal_frames(next(ahead), next(plain))
    for stream in (ahead, plain):
        stream.world.spawn("Ball 01", position=(0.5, 1.0, -2.5))
    for _ in range(3):
        assert_equal_frames(next(ahead), next(plain))
    assert len(ahead[21].objects) == len(ahead[20].objects) + 1
    for step in range(3):  # an edit at each frame
        for stream in (ahead, plain):
            stream.world.move("spawned_1", (0.1 * step, 1.0, -2.5))
        assert_equal_frames(next(ahead), next(plain))
    for stream in (ahead, plain):
        stream.restart(scenario())
    assert_equal_frames(next(ahead), next(plain))
    assert ahead.position == 1
    assert ahead.state_dict() == plain.state_dict()


def test_edit_that_cannot_be_pickled_is_an_error_for_each_frame_until_it_can(ahead):
    """The second frame was waited for without end."""
    ahead.seek(0)
    next(ahead)
    guarded = Guarded([Waypoint((0.5, 1.0, -2.5)), Waypoint((0.5, 2.0, -2.5))], 1.0)
    ahead.world.spawn("Ball 01", position=(0.5, 1.0, -2.5), dynamic=guarded)
    for _ in range(2):
        with pytest.raises(ArgumentError, match=r"Spawn in frame 1 cannot be pickled.*is not released.*prefetch=0"):
            next(ahead)
    vars(guarded)["is_released"] = True
    frame = next(ahead)
    assert frame.index == 1
    assert frame.depth.tobytes() == ahead[1].depth.tobytes()
    assert frame.depth.tobytes() != ahead[0].depth.tobytes()


def interrupt(*arguments):
    raise KeyboardInterrupt


@pytest.mark.slow
def test_interrupted_request_is_made_again(ahead, monkeypatch):
    ahead.seek(3)
    next(ahead)
    monkeypatch.setattr(ahead._ahead._requests, "send", interrupt)
    ahead.seek(6)
    with pytest.raises(KeyboardInterrupt):
        next(ahead)
    assert next(ahead).index == 6


def test_stream_that_cannot_be_pickled_starts_no_worker():
    guarded = Guarded([Waypoint((0.5, 1.0, -2.5)), Waypoint((0.5, 2.0, -2.5))], 1.0)
    objects = [Object("ball", "Ball 01", (0, 1, -3), dynamic=guarded)]
    with Stream(Scenario("solid_benchmark", objects), prefetch=1, **SETTINGS) as stream:
        with pytest.raises(ArgumentError, match=r"the stream cannot be pickled.*is not released"):
            next(stream)
        assert stream._ahead._worker is None


def test_worker_waits_while_enough_frames_are_ready(ahead):
    ahead.seek(0)
    next(ahead)
    results, requests = ahead._ahead._results, ahead._ahead._requests
    taken = []
    while results.poll(20 if len(taken) < 3 else 0.5):
        taken.append(results.recv())
    assert len(taken) == 3
    for _ in taken:
        requests.send(None)
    ahead.seek(0)  # the worker renders again what this test has taken
    assert next(ahead).index == 0


def test_interrupted_wait_for_a_frame_can_be_continued(ahead, monkeypatch):
    ahead.seek(3)
    next(ahead)
    monkeypatch.setattr(ahead._ahead._results, "poll", interrupt)
    with pytest.raises(KeyboardInterrupt):
        next(ahead)
    assert next(ahead).index == 4


def test_frame_whose_pixels_were_received_before_an_interruption_does_not_get_those_of_the_next(ahead, monkeypatch):
    ahead.seek(3)
    way = LinearWaypoints([Waypoint((-0.5, 1.0, -2.5)), Waypoint((-0.5, 2.0, -2.5))], 1.0)
    ahead.world.spawn("Ball 01", position=(-0.5, 1.0, -2.5), dynamic=way)
    next(ahead)
    receive = ahead._ahead._receive
    monkeypatch.setattr(ahead._ahead, "_receive", lambda: interrupt(receive()))
    with pytest.raises(KeyboardInterrupt):
        next(ahead)
    monkeypatch.undo()
    assert next(ahead).depth.tobytes() == ahead[4].depth.tobytes() != ahead[5].depth.tobytes()


def test_iteration_ends_with_the_stream_and_can_start_again(ahead):
    ahead.seek(38)
    assert [frame.index for frame in ahead] == [38, 39]
    ahead.seek(37)
    assert [frame.index for frame in ahead] == [37, 38, 39]


def test_change_that_would_not_reach_the_worker_is_refused(ahead):
    with pytest.raises(ArgumentError, match="prefetch=0"):
        ahead.set_light(0, ahead.world.stage.lights[0])


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, lambda stream: pickle.loads(pickle.dumps(stream))])
def test_copy_of_the_stream_has_no_worker(ahead, copied):
    """A copy that shared the worker would get frames with the edits of the other stream."""
    ahead.seek(0)
    next(ahead)
    other = copied(ahead)
    assert other._ahead.count == 0
    ahead.world.move("ball", (0.4, 1.0, -3.0))
    other.world.move("ball", (-0.4, 1.0, -3.0))
    seen = next(ahead), next(other)
    assert seen[0].depth.tobytes() != seen[1].depth.tobytes()
    assert seen[1].depth.tobytes() == other[1].depth.tobytes()


def test_killed_worker_is_an_error_and_the_next_frame_starts_another(ahead):
    ahead.seek(5)
    next(ahead)
    process = ahead._ahead._worker
    os.kill(process.pid, signal.SIGKILL)
    with pytest.raises(DeviceError, match=r"exit code -9.*prefetch=0"):
        list(ahead)
    ahead.seek(7)
    assert next(ahead).index == 7


def test_worker_that_is_killed_while_it_sends_a_frame_is_an_error():
    """Frames larger than the buffer of a pipe are sent while they are read: the rest of one never arrives."""
    settings = SETTINGS | {"width": 160, "height": 120}
    with Stream(scenario(), prefetch=2, **settings) as stream:
        next(stream)
        assert stream._ahead._results.poll(20)
        os.kill(stream._ahead._worker.pid, signal.SIGKILL)
        with pytest.raises(DeviceError, match="exit code -9"):
            list(stream)


def test_closing_the_stream_ends_a_thread_that_waits_for_a_frame():
    stream, errors, seen = Stream(scenario(), prefetch=2, **SETTINGS | {"frames": None}), [], threading.Event()

    def iterate():
        try:
            for _ in stream:
                seen.set()
        except BaseException as error:
            errors.append(error)

    thread = threading.Thread(target=iterate)
    thread.start()
    assert seen.wait(60)
    stream.close()
    thread.join()
    (error,) = errors
    assert isinstance(error, ArgumentError)
    assert "closed" in str(error)


THREAD = """
import atexit, threading, time

if __name__ == "__main__":
    atexit.register(time.sleep, 1)  # called last: the thread sees the end of the worker
    import tiscene as ts
    stream = ts.Stream("solid_benchmark", width=16, height=12, buffers=("depth",), prefetch=2)
    next(stream)
    threading.Thread(target=list, args=(stream,), daemon=True).start()
"""


@pytest.mark.slow
def test_thread_that_iterates_at_the_end_of_the_program_prints_nothing(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(THREAD)
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


NO_GUARD = """
import tiscene as ts

next(ts.Stream("room_01", width=16, height=12, buffers=("depth",), prefetch=2))
"""


@pytest.mark.slow
def test_script_without_a_guard_is_told_so(tmp_path):
    """The stream's pickle is larger than a pipe holds, and the worker ends before it reads any of it."""
    script = tmp_path / "script.py"
    script.write_text(NO_GUARD)
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stdout) == (1, "")
    assert "if __name__ == '__main__':" in done.stderr
    assert done.stderr.count("Traceback") == 1


@pytest.mark.slow
def test_script_from_standard_input_is_told_that_it_must_be_a_file():
    done = subprocess.run([sys.executable, "-"], input=NO_GUARD, capture_output=True, text=True, timeout=300)
    assert done.returncode == 1
    assert "exit code 1). Its error is printed above. It imports the main script, which must be a file" in done.stderr


@pytest.mark.parametrize("prefetch", [-1, 1.5, "2"])
def test_invalid_prefetch_is_refused(prefetch):
    with pytest.raises(ArgumentError, match="prefetch"):
        Stream(scenario(), prefetch=prefetch, **SETTINGS)


PROGRAM = """
import sys
import tiscene as ts

if __name__ == "__main__":
    stream = ts.Stream("solid_benchmark", width=16, height=12, buffers=("depth",), prefetch=2)
    if sys.argv[1] == "starting":
        stream._ahead._start(stream)
        print(stream._ahead._worker.pid, flush=True)
    for frame in stream:
        if frame.index == 0:
            print(stream._ahead._worker.pid, flush=True)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize(
    ("when", "sent"),
    [
        ("rendering", signal.SIGINT),
        ("rendering", signal.SIGTERM),
        ("rendering", signal.SIGKILL),
        ("starting", signal.SIGKILL),
    ],
)
def test_worker_ends_with_its_owner(tmp_path, when, sent):
    """Ctrl-C reaches the whole process group; a killed owner cannot tell its worker anything."""
    script = tmp_path / "script.py"
    script.write_text(PROGRAM)
    command = [sys.executable, str(script), when]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, start_new_session=True, **pipes) as owner:
        try:
            worker = int(owner.stdout.readline())
            if sent == signal.SIGINT:
                os.killpg(owner.pid, sent)
            else:
                owner.send_signal(sent)
            _, errors = owner.communicate(timeout=30)
            assert owner.returncode == -sent
            assert errors.count("Traceback") == (sent == signal.SIGINT), errors
            assert "leaked" not in errors
            deadline = time.monotonic() + 10
            while runs(worker) and time.monotonic() < deadline:
                time.sleep(0.05)
            assert not runs(worker)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(owner.pid, signal.SIGKILL)


def runs(process: int) -> bool:
    """Return whether a process is there, and more than an entry that waits for init."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.slow
def test_frames_of_color_have_the_same_bytes():
    settings = {"width": 16, "height": 12, "spp": 1, "buffers": ("rgb",), "frames": 2, "incremental": False}
    with Stream("solid_benchmark", prefetch=1, **settings) as ahead:
        for frame, other in zip(ahead, Stream("solid_benchmark", **settings), strict=True):
            np.testing.assert_array_equal(frame.rgb, other.rgb)
