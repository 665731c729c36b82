# SPDX-License-Identifier: Apache-2.0
"""FrameSlice: the frames of `stream[a:b]`, rendered on access."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
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
        read: returns the first of some frames, where iterating does more than indexing; None: it does not.
    """

    def __init__(self, stream: Frames, indices: range, read: Callable[[range], Frame] | None = None) -> None:
        self.stream = stream
        self.indices = indices
        self._read = read

    def __len__(self) -> int:
        return len(self.indices)

    def __repr__(self) -> str:
        return f"<FrameSlice of {self.indices}>"

    def __iter__(self) -> Iterator[Frame]:
        if self._read is None:
            return (self.stream[index] for index in self.indices)
        return map(self._read, (self.indices[place:] for place in range(len(self.indices))))

    @overload
    def __getitem__(self, index: int) -> Frame: ...

    @overload
    def __getitem__(self, index: slice) -> FrameSlice: ...

    def __getitem__(self, index: int | slice) -> Frame | FrameSlice:
        if isinstance(index, slice):
            return FrameSlice(self.stream, self.indices[index], self._read)
        return self.stream[self.indices[index]]
