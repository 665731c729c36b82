# SPDX-License-Identifier: Apache-2.0
"""`tiscene bench`: frames per second on this machine, at a glance."""

from __future__ import annotations

import argparse
import os
import time

from tiscene.cli.demo import SCENE
from tiscene.cli.terminal import note
from tiscene.errors import ArgumentError
from tiscene.scenario.scenario import Scenario
from tiscene.stream.stream import DEFAULT_BUFFERS, Stream

SIZES = ((256, 192), (640, 480))
# name, buffers, quality, incremental
KINDS = (
    ("labels", tuple(name for name in DEFAULT_BUFFERS if name != "rgb"), "preview", False),
    ("labels, rgb fast", DEFAULT_BUFFERS, "fast", False),
    ("same, incremental", DEFAULT_BUFFERS, "fast", True),
    ("labels, rgb preview", DEFAULT_BUFFERS, "preview", False),
    ("same, incremental", DEFAULT_BUFFERS, "preview", True),
    ("labels, rgb standard", DEFAULT_BUFFERS, "standard", False),
)


def run(args: argparse.Namespace) -> None:
    """Print the table."""
    source = args.scene or SCENE
    if not args.seconds >= 0.0:
        raise ArgumentError(f"--seconds {args.seconds:g}: must be 0 or more")
    Stream(source, width=8, height=8, buffers=("depth",), arch=args.arch)  # what cannot be is said before the table
    note(f"{source}, {args.arch or 'cpu'}, {os.cpu_count()} logical cores; the first frame includes compiling")
    print_table(source, seconds=args.seconds, arch=args.arch)


def print_table(source: str | Scenario, *, seconds: float, arch: str | None = None) -> None:
    """One line for each size and kind of frame, as soon as it is measured."""
    print(f"{'buffers':<22} {'size':>9} {'spp':>4} {'first frame':>12} {'frame':>10} {'frames/s':>9}")
    for width, height in SIZES:
        for kind, buffers, quality, incremental in KINDS:
            stream = Stream(
                source,
                width=width,
                height=height,
                buffers=buffers,
                quality=quality,
                arch=arch,
                incremental=incremental,
            )
            first, each = measure(stream, seconds)
            spp = stream.quality.spp if "rgb" in buffers else 0
            row = (
                f"{kind:<22} {f'{width}x{height}':>9} {spp:>4} {first:>10.2f} s {1e3 * each:>7.1f} ms {1 / each:>9.2f}"
            )
            print(row, flush=True)


def measure(stream: Stream, seconds: float) -> tuple[float, float]:
    """Time of the next frame, and the mean of those after it for so many seconds (one at least); s."""
    began = time.perf_counter()
    next(stream)
    first = time.perf_counter() - began
    began = time.perf_counter()
    frames, elapsed = 0, 0.0
    while frames == 0 or elapsed < seconds:
        next(stream)
        frames += 1
        elapsed = time.perf_counter() - began
    return first, elapsed / frames
