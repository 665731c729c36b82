# SPDX-License-Identifier: Apache-2.0
"""SAILenv's views of a frame, in the types in which they travel: row 0 at the top."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.sailenv.light_controls import Color8
from tiscene.sailenv.unity_coordinates import flow_of

Array = NDArray[Any]
NO_CATEGORY = 255
FAR = 15.0  # m; where depth views end, and an agent's own view frustum


@dataclass(frozen=True)
class SailView:
    """flag: its bit in SAILenv's protocol. buffers: those of the frame that it needs.

    of: the view, from those by name and the category numbers by the frame's category ids.
    """

    flag: int
    buffers: tuple[str, ...]
    of: Callable[[Mapping[str, Array], NDArray[np.uint8]], Array]


def depth_of(meters: NDArray[np.float32]) -> NDArray[np.uint8]:
    """0 at the camera, 255 at FAR meters along the optical axis and beyond, steps of FAR / 255."""
    return np.rint(np.minimum(meters, np.float32(FAR)) * np.float32(255.0 / FAR)).astype(np.uint8)


def object_colors(ids: NDArray[np.int32]) -> NDArray[np.uint8]:
    """A color [h, w, 3] for each of 2^24 ids, no two alike; black for 0, which is nothing."""
    # An odd factor permutes the numbers modulo a power of two; this one sets neighbors far apart.
    mixed = ids.astype(np.uint32) * np.uint32(0x9E3779)
    return np.stack([(mixed >> np.uint32(shift)) & np.uint32(255) for shift in (16, 8, 0)], axis=-1).astype(np.uint8)


def clear(main: NDArray[np.uint8], instance: NDArray[np.int32], color: Color8) -> None:
    """Make what shows nothing but background exactly its color; at edges it is what was rendered."""
    nothing = np.pad(instance == 0, 1, constant_values=True)
    inside = nothing[1:-1, 1:-1].copy()
    for rows, columns in ((slice(2, None), slice(1, -1)), (slice(-2), slice(1, -1))):
        inside &= nothing[rows, columns] & nothing[columns, rows]
    main[inside] = color


# In the order in which they travel.
VIEWS = {
    "main": SailView(1, ("rgb",), lambda buffers, _: buffers["rgb"].copy()),
    "category": SailView(4, ("semantic",), lambda buffers, numbers: numbers[buffers["semantic"]]),
    "object": SailView(8, ("instance",), lambda buffers, _: object_colors(buffers["instance"])),
    "flow": SailView(16, ("backward_flow",), lambda buffers, _: flow_of(buffers["backward_flow"])),
    "depth": SailView(32, ("depth",), lambda buffers, _: depth_of(buffers["depth"])),
}
