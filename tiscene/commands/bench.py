"""`tiscene bench`: frames per second on this machine, at a glance."""

from __future__ import annotations

import argparse
import os
import time
from itertools import count

from tiscene.commands.demo import SCENE
from tiscene.commands.progress import note
from tiscene.stream import DEFAULT_BUFFERS, Stream

SIZES = ((256, 192), (640, 480))
KINDS = (
    ("labels", tuple(name for name in DEFAULT_BUFFERS if name != "rgb"), "preview"),
    ("labels, rgb preview", DEFAULT_BUFFERS, "preview"),
    ("labels, rgb standard", DEFAULT_BUFFERS, "standard"),
)


def run(args: argparse.Namespace) -> None:
    """Print the table, one line as soon as it is measured."""
    scene = args.scene or SCENE
    note(f"{scene}, {args.arch or 'cpu'}, {os.cpu_count()} logical cores; the first frame includes compiling")
    print(f"{'buffers':<22} {'size':>9} {'spp':>4} {'first frame':>12} {'frame':>10} {'frames/s':>9}")
    for width, height in SIZES:
        for kind, buffers, quality in KINDS:
            stream = Stream(scene, width=width, height=height, buffers=buffers, quality=quality, arch=args.arch)
            first, each = measure(stream, args.seconds)
            spp = stream.quality.spp if "rgb" in buffers else 0
            size = f"{width}x{height}"
            print(
                f"{kind:<22} {size:>9} {spp:>4} {first:>10.2f} s {1000.0 * each:>7.1f} ms {1.0 / each:>9.2f}",
                flush=True,
            )


def measure(stream: Stream, seconds: float) -> tuple[float, float]:
    """Time of the first frame and the mean of those after it, s; at least one is measured."""
    began = time.perf_counter()
    next(stream)
    first = time.perf_counter() - began
    began = time.perf_counter()
    for frames in count(1):
        next(stream)
        elapsed = time.perf_counter() - began
        if elapsed >= seconds:
            return first, elapsed / frames
    raise AssertionError("count() never ends")
