# SPDX-License-Identifier: Apache-2.0
"""Frames and streams from the arguments of commands."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from typing import Any

from tiscene.cli.terminal import task_shown
from tiscene.errors import ArgumentError
from tiscene.export.preview.frame_choice import DEFAULT_LENGTH
from tiscene.frame.buffers import BUFFERS, buffer_names
from tiscene.stream.stream import Stream

SHOWN_BUFFERS = ("rgb", "semantic", "instance", "depth", "forward_flow", "normal")  # without --buffers
# Options with the names of the arguments of Stream that they give.
_SETTINGS = (
    *("width", "height", "fps", "quality", "spp", "seed", "taxonomy", "root", "strict", "subdivision", "untrusted"),
    "arch",
)


def selected_frames(frames: slice | None, count: int | None) -> range:
    """Return the frames that `--frames` and `--count` select.

    Args:
        frames: A slice with start, stop (None: no end) and step; None for frame 0, or for all from 0 on with a count.
        count: The maximum number of frames; None: no limit.

    Raises:
        ArgumentError: The count is not positive, or the frames have no end.
    """
    if count is not None and count < 1:
        raise ArgumentError(f"--count {count}: must be at least 1")
    if frames is None:
        return range(count or 1)
    if frames.stop is not None:
        return range(frames.start, frames.stop, frames.step)[:count]
    if count is None:
        start = frames.start
        raise ArgumentError(
            f"--frames {start}: has no end, and neither has a stream: give an end, such as {start}:{start + 100}"
        )
    return range(frames.start, frames.start + count * frames.step, frames.step)


def named_buffers(names: Sequence[str] | None, default: Sequence[str]) -> tuple[str, ...]:
    """Return the buffers that `--buffers` names: ("all",) for all, None for the default ones."""
    return tuple(BUFFERS) if names == ("all",) else buffer_names(names or default)


def stream_settings(args: argparse.Namespace, buffers: Sequence[str]) -> dict[str, Any]:
    """Return the arguments of Stream that the options of `common_arguments` give, and the buffers."""
    settings = {name: getattr(args, name) for name in _SETTINGS}
    camera = args.camera[0] if args.camera and len(args.camera) == 1 else args.camera
    return settings | {"buffers": buffers, "camera": camera, "variants": dict(args.variant)}


def shown_frames(args: argparse.Namespace) -> range:
    """Return the frames to show."""
    return range(DEFAULT_LENGTH) if args.frames is None else selected_frames(args.frames, None)


def stream_of(args: argparse.Namespace, step: Callable[..., None]) -> Stream:
    """Return the stream of a command that shows frames, `preview` or `view`.

    Args:
        args: of the command.
        step: of `terminal.progress`.
    """
    settings = stream_settings(args, named_buffers(args.buffers, SHOWN_BUFFERS))
    return Stream(args.source, **settings, progress=task_shown(step))
