# SPDX-License-Identifier: Apache-2.0
"""Which frames and color scales a page has."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from tiscene.errors import ArgumentError
from tiscene.export.preview.buffer_codec import PageBuffer
from tiscene.frame.buffers import BUFFERS
from tiscene.frame.frame import Frame
from tiscene.frame.visualize import limits_of

if TYPE_CHECKING:
    from tiscene.stream.stream import Stream

DEFAULT_LENGTH = 100  # frames of an endless stream
SAMPLES = 5  # frames by which color scales are chosen


def frame_indices(stream: Stream, frames: range | None) -> range:
    """Return the frames of a page.

    Args:
        stream: their source.
        frames: their indices; None: all of a finite stream, the first DEFAULT_LENGTH of an endless one.

    Raises:
        ArgumentError: no frames, or frames that the stream does not have.
    """
    if frames is None:
        return range(DEFAULT_LENGTH if stream.frames is None else stream.frames)
    if not isinstance(frames, range) or not frames or min(frames) < 0:
        raise ArgumentError(f"frames={frames!r}: must be a range of one or more frame indices, such as range(100)")
    if stream.frames is not None and max(frames) >= stream.frames:
        raise ArgumentError(f"frames={frames}: the stream has the frames 0..{stream.frames - 1}")
    return frames


def sampled_frames(stream: Stream, frames: range) -> dict[int, Frame]:
    """Return a few frames from all over the page, by index."""
    last = len(frames) - 1
    chosen = dict.fromkeys(frames[round(last * part / max(SAMPLES - 1, 1))] for part in range(SAMPLES))
    return {index: stream[index] for index in chosen}


def page_buffers(names: Sequence[str], samples: Mapping[int, Frame]) -> list[PageBuffer]:
    """Return how buffers are shown, with color scales for all frames."""
    views = [view for frame in samples.values() for view in frame.views.values()]
    return [PageBuffer(BUFFERS[name], limits_of(name, [view[name] for view in views])) for name in names]
