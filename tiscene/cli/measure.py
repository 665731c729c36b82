# SPDX-License-Identifier: Apache-2.0
"""`tiscene measure`: the difficulty of a scenario's frames, as a table, JSON and a plot."""

from __future__ import annotations

import argparse
from pathlib import Path

from tiscene.cli.terminal import progress, task_shown
from tiscene.errors import ArgumentError, export_errors
from tiscene.export.array_files import json_file
from tiscene.export.difficulty_plot import difficulty_plot
from tiscene.files import write_atomically
from tiscene.frame.difficulty import MEASURES, Difficulty, summary
from tiscene.stream.stream import Stream

LABELS = ("instance", "forward_flow")


def run(args: argparse.Namespace) -> None:
    """Measure, print the table and the folder, and write `difficulty.json` and `difficulty.png` into it."""
    if args.frames.stop is None or args.frames.step < 0:
        raise ArgumentError("--frames: must have an end and a positive step, such as 0:250:5")
    frames = range(args.frames.start, args.frames.stop, args.frames.step)
    buffers = (*LABELS, "rgb") if args.contrast else LABELS
    measured: list[Difficulty] = []
    with progress(f"reading {args.source}", len(frames)) as step:
        stream = Stream(
            args.source,
            width=args.width,
            height=args.height,
            fps=args.fps,
            buffers=buffers,
            quality=args.quality,
            arch=args.arch,
            progress=task_shown(step),
        )
        step(0, "measuring")
        for index in frames:
            measured.append(stream[index].difficulty)
            step()
    print(f"{'measure':<12} {'mean':>9} {'min':>9} {'max':>9}")
    overall = summary(measured)
    for name, values in overall.items():
        cells = (f"{'–' if value is None else format(value, '.3g'):>9}" for value in values.values())
        print(f"{name:<12} {' '.join(cells)}")
    folder = Path(args.output or f"tiscene-measure-{Path(args.source).stem}")
    content = {
        "source": args.source,
        "settings": {"width": args.width, "height": args.height, "fps": args.fps},
        "summary": overall,
        "frames": list(frames),
        "measures": {name: [getattr(each, name) for each in measured] for name in MEASURES},
    }
    with export_errors(folder):
        write_atomically(folder / "difficulty.json", json_file(content))
        write_atomically(folder / "difficulty.png", difficulty_plot(list(frames), measured))
    print(folder)
