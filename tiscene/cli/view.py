# SPDX-License-Identifier: Apache-2.0
"""`tiscene view`: show frames of a scene or scenario in Rerun, as they are rendered."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Iterator
from typing import Any

import numpy as np

from tiscene.cli.stream_arguments import shown_frames, stream_of
from tiscene.cli.terminal import progress
from tiscene.errors import ArgumentError, DeviceError, ExportError, requires_extra
from tiscene.export.rerun_recording import columns, entities
from tiscene.frame.frame_display import has_display


def run(args: argparse.Namespace) -> None:
    """Open the viewer, or write a file, and send it frames."""
    with requires_extra("rerun"):
        import rerun as rr
    if args.save is None and args.connect is None and not has_display():
        raise DeviceError(
            "there is no display for the viewer: `--save run.rrd` writes a file for a viewer on another machine, "
            "`tiscene preview` a page for browsers"
        )
    frames = shown_frames(args)
    if args.camera and len(args.camera) > 1:
        raise ArgumentError("--camera: `tiscene view` shows one camera; name one")
    with progress(f"reading {args.source}", len(frames)) as step:
        stream = stream_of(args, step)
        recording = rr.RecordingStream("tiscene")
        with _viewer_errors():
            _open(recording, args)
        recording.log("world", rr.ViewCoordinates.RIGHT_HAND_Y_UP, static=True)
        step(0, task="first frame")
        for index in frames:
            frame = stream[index]
            times = [
                rr.TimeColumn("frame", sequence=[index]),
                rr.TimeColumn("time", duration=[np.timedelta64(round(frame.time * 1e9), "ns")]),
            ]
            for path, make in entities(frame).items():
                recording.send_columns(path, times, columns(path, [make()]))
            step(task=f"frame {index}")
        with _viewer_errors():
            recording.flush()
    if args.save is not None:
        print(args.save)


def _open(recording: Any, args: argparse.Namespace) -> None:
    """Connect a recording to a file, to a running viewer, or to a new one."""
    if args.save is not None:
        recording.save(args.save)
    elif args.connect is not None:
        recording.connect_grpc(args.connect)
    else:
        recording.spawn()


@contextlib.contextmanager
def _viewer_errors() -> Iterator[None]:
    """Convert what Rerun raises, such as for a viewer that is not there, to ExportError."""
    try:
        yield
    except (OSError, RuntimeError, ValueError) as error:
        raise ExportError(f"Rerun: {error}. `--save run.rrd` writes a file for a viewer on another machine.") from error
