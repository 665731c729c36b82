# SPDX-License-Identifier: Apache-2.0
"""SAILenv's views of a frame: main, category, object, flow and depth, converted from tiscene's buffers.

The arrays have the types that travel over the wire, with row 0 at the top. `VIEWS` lists the views in the order in
which the protocol sends them.
"""

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
FAR = 15.0  # m; the far end of depth views and of an agent's own view frustum


@dataclass(frozen=True)
class SailView:
    """One view.

    Attributes:
        flag: Its bit in SAILenv's protocol.
        buffers: The buffers of a frame that it is made of.
        convert: Makes the view of those buffers by name, and of the category number of each category id.
    """

    flag: int
    buffers: tuple[str, ...]
    convert: Callable[[Mapping[str, Array], NDArray[np.uint8]], Array]


def depth_of(meters: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return depth [h, w] in steps of FAR / 255: 0 at the camera, 255 at FAR along the optical axis and beyond."""
    return np.rint(np.minimum(meters, np.float32(FAR)) * np.float32(255.0 / FAR)).astype(np.uint8)


def object_colors(ids: NDArray[np.int32]) -> NDArray[np.uint8]:
    """Return a distinct color [h, w, 3] for each of 2^24 object ids [h, w]; black for id 0, no object."""
    # An odd factor permutes the numbers modulo a power of two; this one puts neighbors far apart.
    mixed = ids.astype(np.uint32) * np.uint32(0x9E3779)
    return np.stack([(mixed >> np.uint32(shift)) & np.uint32(255) for shift in (16, 8, 0)], axis=-1).astype(np.uint8)


def fill_background(main: NDArray[np.uint8], instance: NDArray[np.int32], color: Color8) -> None:
    """Set pixels of the background to exactly its color, in place; pixels beside an object keep their rendered mixture.

    Args:
        main: uint8 [h, w, 3].
        instance: Object ids [h, w], 0 where there is no object.
        color: 8-bit sRGB.
    """
    empty = np.pad(instance == 0, 1, constant_values=True)
    inside = empty[1:-1, 1:-1].copy()
    for rows, columns in ((slice(2, None), slice(1, -1)), (slice(-2), slice(1, -1))):
        inside &= empty[rows, columns] & empty[columns, rows]
    main[inside] = color


VIEWS = {
    "main": SailView(1, ("rgb",), lambda buffers, _: buffers["rgb"].copy()),
    "category": SailView(4, ("semantic",), lambda buffers, numbers: numbers[buffers["semantic"]]),
    "object": SailView(8, ("instance",), lambda buffers, _: object_colors(buffers["instance"])),
    "flow": SailView(16, ("backward_flow",), lambda buffers, _: flow_of(buffers["backward_flow"])),
    "depth": SailView(32, ("depth",), lambda buffers, _: depth_of(buffers["depth"])),
}
