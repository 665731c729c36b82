# SPDX-License-Identifier: Apache-2.0
"""`tiscene preview`: write frames of a scene or scenario as one HTML page."""

from __future__ import annotations

import argparse

from tiscene.cli.stream_arguments import shown_frames, stream_of
from tiscene.cli.terminal import progress
from tiscene.export.preview import write_preview


def run(args: argparse.Namespace) -> None:
    """Render, and print the page."""
    frames = shown_frames(args)
    with progress(f"reading {args.source}", len(frames)) as step:
        stream = stream_of(args, step)
        step(0, task="color scales")
        write_preview(stream, args.output, frames=frames, progress=lambda index: step(task=f"frame {index}"))
    print(args.output)
