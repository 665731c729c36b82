# SPDX-License-Identifier: Apache-2.0
"""Row "threads": streams in several threads, alternately in one thread, and in worker processes: the same bytes."""

from __future__ import annotations

import hashlib
import multiprocessing
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

from tests.stress.child_process import ChildFailed, call
from tests.stress.outcomes import Outcome, count

if TYPE_CHECKING:
    import tiscene as ts

SELF = "tests.stress.concurrent_streams"
SEEDS = (1, 2)


def make(seed: int) -> ts.Stream:
    """Return a stream; odd seeds render incrementally, even seeds another scene and size by path tracing."""
    import tiscene as ts
    from tests.stress.steady_state import SIZE, scenario

    if seed % 2:
        return ts.Stream(scenario(), quality="fast", base_spp=4, seed=seed, **SIZE)
    moving = ts.Object("ball", "Ball 01", (0.0, 1.0, 0.6), dynamic=ts.UniformMovementRandomBounce(1.0, seed=seed))
    return ts.Stream(
        ts.Scenario("solid_benchmark", [moving]), quality="standard", spp=2, seed=seed, width=40, height=30
    )


def digest(frame: ts.Frame) -> str:
    """Return a digest of all buffers of a frame."""
    return hashlib.sha256(b"".join(frame[name].tobytes() for name in frame)).hexdigest()


def digests(seed: int, frames: int) -> list[str]:
    """Return the digests of the first frames of a stream."""
    with make(seed) as stream:
        return [digest(stream[index]) for index in range(frames)]


def alone(frames: int) -> list[list[str]]:
    """Run in a child process: one stream after the other."""
    return [digests(seed, frames) for seed in SEEDS]


def in_threads(frames: int) -> list[list[str]]:
    """Run in a child process: one stream per thread, made and rendered at the same time."""
    with ThreadPoolExecutor(len(SEEDS)) as pool:
        return list(pool.map(digests, SEEDS, [frames] * len(SEEDS)))


def made_here_rendered_in_threads(frames: int) -> list[list[str]]:
    """Run in a child process: streams made in the main thread, rendered in others at the same time."""
    streams = [make(seed) for seed in SEEDS]
    with ThreadPoolExecutor(len(SEEDS)) as pool:
        return list(pool.map(lambda stream: [digest(stream[index]) for index in range(frames)], streams))


def alternately(frames: int) -> list[list[str]]:
    """Run in a child process: frames of all streams in turn, in one thread."""
    streams = [make(seed) for seed in SEEDS]
    rounds = [[digest(stream[index]) for stream in streams] for index in range(frames)]
    return [list(each) for each in zip(*rounds, strict=True)]


def in_workers(method: str, frames: int) -> list[list[str]]:
    """Run in a child process: pickled streams in worker processes, while this process renders too."""
    streams = [make(seed) for seed in SEEDS]
    streams[0][0]
    with multiprocessing.get_context(method).Pool(len(SEEDS)) as pool:
        waiting = pool.starmap_async(_digests_of, [(stream, frames) for stream in streams])
        streams[1][0]
        return waiting.get(600)


def _digests_of(stream: ts.Stream, frames: int) -> list[str]:
    return [digest(stream[index]) for index in range(frames)]


def after_fork(frames: int) -> list[str]:
    """Run in a child process: use a stream in a forked process; return the error's type and message."""
    from tiscene.errors import TisceneError

    stream = make(SEEDS[0])
    stream[0]
    receiver, sender = multiprocessing.Pipe(duplex=False)

    def use() -> None:
        try:
            stream[0]
            sender.send(["no error", ""])
        except TisceneError as error:
            sender.send([type(error).__name__, str(error)])

    process = multiprocessing.get_context("fork").Process(target=use)
    process.start()
    result: list[str] = receiver.recv() if receiver.poll(60) else ["no answer", ""]
    process.kill()
    return result


def compare(use: str, function: str, arguments: list[Any], expected: list[list[str]]) -> Outcome:
    """Run one way to use several streams and compare the digests."""
    frames = sum(map(len, expected))
    try:
        found = call(f"{SELF}:{function}", *arguments)
    except ChildFailed as error:
        return Outcome(use, f"{error}", False)
    same = sum(a == b for pair in zip(found, expected, strict=True) for a, b in zip(*pair, strict=True))
    return Outcome(use, f"{same} of {frames} frames have the same bytes", same == frames)


def rows(scale: float) -> Iterator[Outcome]:
    """Run the row; scale 1 is the full count."""
    frames = count(100, scale, 2)
    expected = call(f"{SELF}:alone", frames)
    for use, function, arguments in (
        ("two streams, each made and rendered in a thread of its own", "in_threads", [frames]),
        ("two streams made in the main thread, rendered in two others", "made_here_rendered_in_threads", [frames]),
        ("two streams alternately in one thread", "alternately", [frames]),
        ("two pickled streams in `spawn` workers", "in_workers", ["spawn", frames]),
        ("two pickled streams in `forkserver` workers", "in_workers", ["forkserver", frames]),
    ):
        if sys.platform != "win32" or "forkserver" not in use:
            yield compare(use, function, arguments, expected)
    kind, message = call(f"{SELF}:after_fork", 1)
    yield Outcome("a stream in a forked process", f"{kind}: {message}", kind == "DeviceError" and "spawn" in message)
