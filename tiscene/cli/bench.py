# SPDX-License-Identifier: Apache-2.0
"""`tiscene bench`: measure frames per second on this machine."""

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
# Rows of the table for each size: name, buffers, quality, incremental.
KINDS = (
    ("labels", tuple(name for name in DEFAULT_BUFFERS if name != "rgb"), "preview", False),
    ("labels, rgb fast", DEFAULT_BUFFERS, "fast", False),
    ("same, incremental", DEFAULT_BUFFERS, "fast", True),
    ("labels, rgb preview", DEFAULT_BUFFERS, "preview", False),
    ("same, incremental", DEFAULT_BUFFERS, "preview", True),
    ("labels, rgb standard", DEFAULT_BUFFERS, "standard", False),
)


def run(args: argparse.Namespace) -> None:
    """Print the table of times."""
    source = args.scene or SCENE
    if not args.seconds >= 0.0:
        raise ArgumentError(f"--seconds {args.seconds:g}: must be 0 or more")
    # Raises errors before the table is begun.
    arch = Stream(source, width=8, height=8, buffers=("depth",), arch=args.arch).arch
    note(f"{source}, {arch}, {os.cpu_count()} logical cores; the first frame includes compiling")
    print_table(source, seconds=args.seconds, arch=args.arch)


def print_table(source: str | Scenario, *, seconds: float, arch: str | None = None) -> None:
    """Measure each kind of frame at each size, and print a line as soon as it is measured.

    Args:
        source: The source of the streams, as of `Stream`.
        seconds: The duration of each measurement, s; the first frame is extra.
        arch: As of `Stream`.
    """
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
            first, mean = measure(stream, seconds)
            spp = stream.render_settings.spp if "rgb" in buffers else 0
            size = f"{width}x{height}"
            print(f"{kind:<22} {size:>9} {spp:>4} {first:>10.2f} s {1e3 * mean:>7.1f} ms {1 / mean:>9.2f}", flush=True)


def measure(stream: Stream, seconds: float) -> tuple[float, float]:
    """Return the time of the next frame and the mean time of the frames after it, s.

    Args:
        stream: The stream; its position moves on.
        seconds: For how long frames after the first are rendered, s; at least one is.
    """
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
