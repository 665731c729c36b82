# SPDX-License-Identifier: Apache-2.0
"""The stream of the commands that show frames, `preview` and `view`, from their arguments."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from tiscene.cli.render import selected_frames
from tiscene.export.preview.frame_choice import DEFAULT_LENGTH
from tiscene.frame.buffers import BUFFERS
from tiscene.stream.stream import Stream

DEFAULT_BUFFERS = ("rgb", "semantic", "instance", "depth", "forward_flow", "normal")


def shown_frames(args: argparse.Namespace) -> range:
    """Return the frames to show."""
    return range(DEFAULT_LENGTH) if args.frames is None else selected_frames(args.frames, None)


def stream_of(args: argparse.Namespace, step: Callable[..., None]) -> Stream:
    """Return the stream to show.

    Args:
        args: of the command.
        step: of `terminal.progress`.
    """
    return Stream(
        args.source,
        width=args.width,
        height=args.height,
        fps=args.fps,
        buffers=tuple(BUFFERS) if args.buffers == ("all",) else args.buffers or DEFAULT_BUFFERS,
        quality=args.quality,
        spp=args.spp,
        seed=args.seed,
        camera=args.camera[0] if args.camera and len(args.camera) == 1 else args.camera,
        variants=dict(args.variant),
        taxonomy=args.taxonomy,
        root=args.root,
        strict=args.strict,
        subdivision=args.subdivision,
        untrusted=args.untrusted,
        arch=args.arch,
        progress=lambda task, fraction: step(0, task=f"{task}: {fraction:.0%}"),
    )
