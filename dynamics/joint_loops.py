# SPDX-License-Identifier: Apache-2.0
"""Joints between rigid bodies as a graph: which of them close loops."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any


def closing_joints(ends: Sequence[tuple[Any, ...]], loose: Sequence[bool]) -> list[int]:
    """Return the rows of joints that connect what earlier ones have connected.

    Args:
        ends: the two ends of each joint; None for all that is no rigid body.
        loose: whether a joint connects nothing in this sense.
    """
    roots: dict[Any, Any] = {}

    def root(end: Any) -> Any:
        while end in roots:
            end = roots[end]
        return end

    closing = []
    for row, ((one, other), is_loose) in enumerate(zip(ends, loose, strict=True)):
        if is_loose:
            continue
        first, second = root(one), root(other)
        if first == second:
            closing.append(row)
        else:
            roots[first if first is not None else second] = second if first is not None else first
    return closing
