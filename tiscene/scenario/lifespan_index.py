# SPDX-License-Identifier: Apache-2.0
"""LifespanIndex: which of many lifespans contain a frame, in time that depends on how many contain it.

A segment tree over all frames, of which only the nodes in use exist: a lifespan is listed at the O(log n) largest
aligned ranges of 2^level frames that it consists of.
"""

from __future__ import annotations

from collections.abc import Iterator


class LifespanIndex:
    """The lifespans of numbered objects."""

    def __init__(self) -> None:
        self._endless: dict[int, int] = {}  # first frame by number
        self._nodes: dict[int, tuple[int, ...]] = {}  # numbers by range; tuples are small
        self._levels = 0

    def add(self, number: int, first: int, last: int | None) -> None:
        """Add a lifespan.

        Args:
            number: number of the object.
            first: first frame.
            last: last frame; None: no end. A lifespan that ends before it begins contains no frame.
        """
        if last is None:
            self._endless[number] = first
            return
        self._levels = max(self._levels, (last - first + 1).bit_length())
        for node in _nodes(first, last):
            self._nodes[node] = (*self._nodes.get(node, ()), number)

    def remove(self, number: int, first: int, last: int | None) -> None:
        """Remove a lifespan that was added with the same values."""
        if last is None:
            del self._endless[number]
            return
        for node in _nodes(first, last):
            others = tuple(each for each in self._nodes.pop(node) if each != number)
            if others:
                self._nodes[node] = others

    def at(self, frame: int) -> list[int]:
        """Return the numbers of the lifespans that contain a frame, in ascending order."""
        found = [number for number, first in self._endless.items() if first <= frame]
        for level in range(self._levels):
            found += self._nodes.get(_node(level, frame >> level), ())
        return sorted(found)


def _node(level: int, index: int) -> int:
    """Return the key of the range of frames from index << level to ((index + 1) << level) - 1."""
    return index << 16 | level


def _nodes(first: int, last: int) -> Iterator[int]:
    """Yield the largest aligned ranges whose union is first..last."""
    level, end = 0, last + 1
    while first < end:
        if first & 1:
            yield _node(level, first)
            first += 1
        if end & 1:
            end -= 1
            yield _node(level, end)
        first, end, level = first >> 1, end >> 1, level + 1
