# SPDX-License-Identifier: Apache-2.0
"""Frames as samples: dicts of NumPy arrays that data loaders can batch."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from tiscene.errors import ArgumentError
from tiscene.frame.frame import Frame
from tiscene.stream.stream_interface import StreamInterface

Sample: TypeAlias = dict[str, Any]


@dataclass(frozen=True)
class FrameSamples:
    """Converts frames to samples.

    A sample has `index`, `time` (s) and each buffer under its name. With `objects` it also has the visible objects:
    `id`, `category_id`, `box` (x0, y0, x1, y1, px), `position` (m), `rotation` (w, x, y, z) and `velocity` (m/s), one
    row each. With several cameras, `views` has a sample for each of them.

    Attributes:
        objects: whether samples have the visible objects.
        transform: makes the sample of a frame in place of all this; None: as described.
    """

    objects: bool = False
    transform: Callable[[Frame], Any] | None = None

    def __call__(self, frame: Frame) -> Any:
        if self.transform is not None:
            return self.transform(frame)
        sample = self._of_view(frame)
        if len(views := frame.views) > 1:
            sample["views"] = {name: self._of_view(view) for name, view in views.items()}
        return sample

    def _of_view(self, frame: Frame) -> Sample:
        sample: Sample = {"index": frame.index, "time": frame.time, **frame.buffers}
        if self.objects:
            rows = [row for row in frame.objects if row.visible_pixels]
            sample["objects"] = {
                "id": np.array([row.id for row in rows], np.int64),
                "category_id": np.array([row.category_id for row in rows], np.int64),
                "box": np.array([row.visible_box for row in rows], np.float32).reshape(len(rows), 4),
                "position": np.array([row.position for row in rows], np.float32).reshape(len(rows), 3),
                "rotation": np.array([row.rotation for row in rows], np.float32).reshape(len(rows), 4),
                "velocity": np.array([row.velocity for row in rows], np.float32).reshape(len(rows), 3),
            }
        return sample


def frame_range(frames: range | None, stream: StreamInterface) -> range:
    """Return the indices of the frames that a data set has; `sys.maxsize` as their end if there is none.

    Args:
        frames: the indices; None: from the stream's position to its end.
        stream: their source.

    Raises:
        ArgumentError: `frames` is not a range, or the stream has no such frames.
    """
    end = stream.frames or sys.maxsize
    if frames is None:
        return range(stream.position, end)
    if not isinstance(frames, range):
        raise ArgumentError(f"frames={frames!r}: must be a range of frame indices, such as range(100), or None")
    if frames and not all(0 <= index < end for index in (frames[0], frames[-1])):
        raise ArgumentError(f"frames={frames}: the stream has the frames 0..{end - 1}")
    return frames


def is_endless(frames: range) -> bool:
    """Return whether a range of `frame_range` has no end."""
    return frames.stop == sys.maxsize
