# SPDX-License-Identifier: Apache-2.0
"""RenderAhead: a worker process that renders the next frames of a stream while the current one is used."""

from __future__ import annotations

import atexit
import multiprocessing
import os
import pickle
import queue
import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from typing import Any

from tiscene.device import runtime
from tiscene.errors import ArgumentError, DeviceError
from tiscene.frame.frame import Frame
from tiscene.stream.stream_interface import StreamInterface
from tiscene.stream.view_renderer import Pixels

POLL_SECONDS = 0.5  # between two checks that the worker lives
JOIN_SECONDS = 5.0
WORKER_NAME = "tiscene prefetch"
NO_GUARD = 3  # exit code of a worker that was about to start a worker itself, as it ran the owner's script

_interpreter_exits = threading.Event()
atexit.register(_interpreter_exits.set)  # after `resource_tracker` was imported: before multiprocessing ends workers


class RenderAhead:
    """Renders frames of a stream ahead of its position, in one worker process that starts with the first frame.

    The worker has a copy of the stream and sends arrays of pixels; the owner computes objects and events.
    It waits while `count` frames are ready; the owner acknowledges each one it receives. After a seek or an edit of
    the world, frames that were rendered ahead in vain are dropped. The frames have the same bytes as without a worker.

    Args:
        count: number of frames that may be ready; 0 for no worker.
    """

    def __init__(self, count: int) -> None:
        self.count = count
        self._worker: Any = None
        self._turn = threading.RLock()
        self._number = 0  # of the last request
        self._expected = 0, 0  # position and number of edits of the frame that comes next

    def next_frame(self, stream: StreamInterface) -> Frame:
        """Return the frame at the stream's position, and move on.

        Raises:
            StopIteration: that is the stream's end.
            ArgumentError: another thread closed the stream meanwhile; or it, or an edit, cannot be pickled.
            DeviceError: the worker has died.
            TisceneError: whatever rendering the frame has raised in the worker.
        """
        with self._turn:  # other threads that iterate get the following frames
            at = stream.position, stream.world.edit_count
            if at[0] == stream.frames:
                raise StopIteration
            pixels = self._pixels(stream, *at)
            with runtime.ONE_THREAD:
                changed = (stream.position, stream.world.edit_count) != at  # by another thread: not what was rendered
                return stream._next(None if changed else pixels)

    def _pixels(self, stream: StreamInterface, position: int, version: int) -> Sequence[Pixels]:
        """Return the pixels of a frame, one for each camera, and expect the following one.

        Args:
            stream: the stream.
            position: the stream's position.
            version: number of edits of its scenario.
        """
        if stream.world.replaced_lights:
            self.check_no_worker("world.set_light")
        if self._worker is None:
            self._start(stream)
            self._expected = -1, version  # the worker's copy has the edits, and no frame is requested yet
        if (position, version) != self._expected:
            self._request(stream, position, version)
        self._expected = -1, version  # if an exception comes before the frame is returned, it is requested again
        while True:
            request, result = self._receive()
            if request == self._number:
                break  # else a frame that was rendered ahead in vain
        if isinstance(result, BaseException):
            self.close()
            raise result
        self._expected = position + 1, version
        pixels: Sequence[Pixels] = result
        return pixels

    def check_no_worker(self, action: str) -> None:
        """Raise ArgumentError for something that the worker's copy of the stream would miss."""
        if self.count:
            raise ArgumentError(
                f"{action} does not reach the process that renders ahead: make the stream with prefetch=0"
            )

    def close(self) -> None:
        """End the worker."""
        worker, self._worker = self._worker, None
        if worker is None:
            return
        worker.kill()  # it has no state that could be lost
        worker.join(JOIN_SECONDS)
        worker.close()
        self._requests.close()
        self._results.close()

    def _start(self, stream: StreamInterface) -> None:
        if multiprocessing.current_process().name == WORKER_NAME:
            raise SystemExit(NO_GUARD)  # the owner explains it
        copied = _pickled("the stream", stream)
        context = multiprocessing.get_context("spawn")
        # Pipes, not a Queue: that keeps an end for writing open here, so that this process would wait for ever for the
        # rest of a frame whose sender was killed. Its semaphores have names, which a killed process leaves behind.
        requests, self._requests = context.Pipe(duplex=False)
        self._results, results = context.Pipe(duplex=False)
        self._worker = context.Process(
            target=_render_ahead, args=(self.count, requests, results), name=WORKER_NAME, daemon=True
        )
        try:
            with _interrupts_blocked():  # the worker inherits this: Ctrl-C is for the process that owns it
                self._worker.start()
        except BaseException:
            self._worker = None
            raise
        requests.close()
        results.close()
        # Not an argument: multiprocessing holds the reading end of the pipe for these, and so would wait for ever for
        # a worker that ends before it has read them.
        try:
            self._requests.send_bytes(copied)
        except OSError:
            pass  # the worker is dead; `_receive` reports that
        except BaseException:  # Ctrl-C in the middle of it: the next frame starts another worker
            self.close()
            raise

    def _request(self, stream: StreamInterface, position: int, version: int) -> None:
        """Ask for the frames from a position on, and send the edits since the last request.

        Args:
            stream: the stream.
            position: index of the first frame.
            version: number of edits of its scenario.

        Raises:
            ArgumentError: an edit cannot be pickled; nothing is requested then.
        """
        number, first = self._number + 1, self._expected[1]
        edits = [
            _pickled(f"{type(each).__name__} in frame {each.frame}", each)
            for each in stream.world.edits(first, version)
        ]
        try:
            with suppress(OSError):  # the worker is dead; `_receive` reports that
                self._requests.send((number, position, first, edits))
            self._number, self._expected = number, (position, version)
        except BaseException:  # Ctrl-C in the middle of it: the next frame starts another worker
            self.close()
            raise

    def _receive(self) -> tuple[int, Any]:
        try:
            while not self._results.poll(POLL_SECONDS):
                if self._worker is None or not self._worker.is_alive():
                    raise EOFError
            received: tuple[int, Any] = self._results.recv()
            with suppress(OSError):  # the worker is dead; the next call reports that
                self._requests.send(None)
        except (EOFError, OSError):
            if _interpreter_exits.is_set():
                raise SystemExit from None  # ends a daemon thread, and prints nothing
            worker = self._worker
            if worker is None:
                raise ArgumentError("another thread closed the stream while this one waited for a frame") from None
            worker.join(JOIN_SECONDS)
            code = worker.exitcode
            self.close()
            if code == NO_GUARD:
                raise DeviceError(
                    "prefetch= starts a process that imports this script: put what runs below "
                    "`if __name__ == '__main__':`, or make the stream with prefetch=0"
                ) from None
            reason = (
                "Its error is printed above. It imports the main script, which must be a file; prefetch=0 does not"
                if code == 1
                else "It may have run out of memory: make the stream with prefetch=0 or a smaller number"
            )
            raise DeviceError(f"the process that renders ahead has ended (exit code {code}). {reason}") from None
        except BaseException:  # Ctrl-C, perhaps in the middle of a result: the next frame starts another worker
            self.close()
            raise
        return received


def _render_ahead(count: int, requests: Connection, results: Connection) -> None:
    """Render frames of a pickled stream, in the worker: from the position of the last request to the stream's end.

    Args:
        count: Number of results that may wait for the owner.
        requests: Gives the bytes of the stream, then (number, position, and arguments of `World.follow`, each edit as
            bytes), and None when the owner has received a result.
        results: Takes (number of the request, pixels or error).
    """
    threading.Thread(target=_exit_with_owner, daemon=True).start()
    ready: queue.SimpleQueue[tuple[int, Any]] = queue.SimpleQueue()
    threading.Thread(target=_send, args=(ready, results), daemon=True).start()
    stream = pickle.loads(requests.recv_bytes())  # with threads that watch the owner, since it takes seconds
    number, position, free = 0, None, count
    while True:
        while position is None or not free or requests.poll():
            try:
                request = requests.recv()
            except EOFError:  # the owner has ended
                os._exit(1)
            if request is None:
                free += 1
                continue
            number, position, first, edits = request
            stream.world.follow(first, [pickle.loads(each) for each in edits])
        try:
            result: Any = [Pixels.of(view) for view in stream[position].views.values()]
        except Exception as error:
            result = _picklable(error)
        ready.put((number, result))
        free -= 1
        is_last = isinstance(result, Exception) or position + 1 == stream.frames
        position = None if is_last else position + 1


def _send(ready: queue.SimpleQueue[tuple[int, Any]], results: Connection) -> None:
    """Send results while the next ones are rendered: a pipe takes no more than a small frame before it is read."""
    while True:
        try:
            results.send(ready.get())
        except OSError:  # the owner has ended
            os._exit(1)


def _pickled(name: str, value: Any) -> bytes:
    """Return what the worker gets as bytes. Raises ArgumentError, with the name, if it cannot be pickled."""
    try:
        return pickle.dumps(value)
    except Exception as error:
        raise ArgumentError(
            f"{name} cannot be pickled for the process that renders ahead: {error}. Define its classes and functions "
            "at the top of a module, or make the stream with prefetch=0"
        ) from error


def _picklable(error: Exception) -> Exception:
    """Return an exception that the other process can raise; some have a constructor that pickle cannot call."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return DeviceError(f"{type(error).__name__}: {error}")
    return error


def _exit_with_owner() -> None:
    """End this process when its owner dies: nobody would read its frames."""
    owner = multiprocessing.parent_process()
    while owner is not None and owner.is_alive():
        owner.join(POLL_SECONDS)
        if os.name == "posix" and os.getppid() != owner.pid:
            break  # a process that the owner has forked keeps the pipe open from which `is_alive` knows
    os._exit(1)


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Block SIGINT in this thread, and in processes that it starts."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # the first process starts it, which unblocks SIGINT
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
