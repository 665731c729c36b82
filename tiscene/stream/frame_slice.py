# SPDX-License-Identifier: Apache-2.0
"""FrameSlice: the frames of `stream[a:b]`, rendered on access."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Protocol, overload

from tiscene.frame.frame import Frame


class Frames(Protocol):
    """A source of frames by index."""

    def __getitem__(self, index: int, /) -> Frame: ...


class FrameSlice(Sequence[Frame]):
    """Some frames of a stream, each rendered when it is accessed.

    Args:
        stream: the source of frames.
        indices: their indices.
    """

    def __init__(self, stream: Frames, indices: range) -> None:
        self.stream = stream
        self.indices = indices

    def __len__(self) -> int:
        return len(self.indices)

    def __iter__(self) -> Iterator[Frame]:
        return (self.stream[index] for index in self.indices)

    @overload
    def __getitem__(self, index: int) -> Frame: ...

    @overload
    def __getitem__(self, index: slice) -> FrameSlice: ...

    def __getitem__(self, index: int | slice) -> Frame | FrameSlice:
        if isinstance(index, slice):
            return FrameSlice(self.stream, self.indices[index])
        return self.stream[self.indices[index]]
