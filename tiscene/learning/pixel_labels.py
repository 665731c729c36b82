# SPDX-License-Identifier: Apache-2.0
"""Labels of single pixels: read from a rendered frame, or computed with one ray.

The ray is the one that the label pass shoots through the center of that pixel in the full image, to the last bit, so
that both ways give the same label.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.frame.frame import Frame
from tiscene.render.view import CENTER, HALF_HEIGHT, POSITION, RIGHT, TANGENT, UP, View
from tiscene.scene.placement import CURRENT, NEXT, PREVIOUS
from tiscene.stream.stream import Stream
from tiscene.world.world_state import WorldState

LABELS = ("semantic", "instance", "part", "depth")


@dataclass(frozen=True)
class PixelLabel:
    """What one pixel shows.

    Attributes:
        category: semantic category; "" for the background and for objects without one.
        category_id: value in the `semantic` buffer; 0 for none.
        instance: value in the `instance` buffer; 0 for the background.
        object: name of the object; "" for the background.
        part: value in the `part` buffer; 0 for none.
        depth: m along the optical axis; infinity for the background.
        moving: whether the object moves between frames k - 1 and k + 1.
    """

    category: str
    category_id: int
    instance: int
    object: str
    part: int
    depth: float
    moving: bool


@dataclass(frozen=True)
class PixelView(View):
    """A view of one pixel of an image.

    Attributes:
        pixel: row and column in the image.
        image_size: width and height of the image, px.
    """

    pixel: tuple[int, int] = (0, 0)
    image_size: tuple[int, int] = (1, 1)

    def rows(self) -> NDArray[np.float32]:
        """Return the cameras as `View.rows` does, looking along the ray of the pixel.

        The arithmetic is that of `camera_ray`, in single precision and in its order.
        """
        rows = super().rows()
        (y, x), (width, height), half, one = self.pixel, self.image_size, np.float32(0.5), np.float32
        for row in rows:
            scale = one(2.0) * (row[TANGENT] + row[HALF_HEIGHT]) / one(height)
            right = (one(x) - half * one(width - 1)) * scale
            down = (one(y) - half * one(height - 1)) * scale
            start = POSITION if row[HALF_HEIGHT] > 0.0 else CENTER
            axis_right, axis_up = row[RIGHT : RIGHT + 3], row[UP : UP + 3]
            row[start : start + 3] = row[start : start + 3] + right * axis_right - down * axis_up
            row[[TANGENT, HALF_HEIGHT]] /= one(height)  # the size of a pixel decides which texture level is read
        return rows


def moving_instances(state: WorldState) -> set[int]:
    """Return the instance ids of the objects that move between frames k - 1 and k + 1.

    An object that appears or vanishes does not move by that.
    """
    placement = state.placement
    poses, present = placement.world_from_object, placement.present
    moved = np.zeros(len(placement.instance_id), np.bool_)
    for other in (PREVIOUS, NEXT):
        moved |= present[CURRENT] & present[other] & (poses[CURRENT] != poses[other]).any(axis=(1, 2))
    return set(placement.instance_id[moved].tolist())


def label_in_frame(frame: Frame, y: int, x: int, moving: bool) -> PixelLabel:
    """Return the label of a pixel of a frame that has the buffers LABELS."""
    return _label(frame, int(frame.instance[y, x]), {name: frame[name][y, x] for name in LABELS}, moving)


def has_labels(frame: Frame) -> bool:
    """Return whether a frame has all buffers that a label needs."""
    return all(name in frame for name in LABELS)


def render_label(source: Stream, index: int, y: int, x: int) -> PixelLabel:
    """Return the label of a pixel of frame `index` with one ray, without rendering the frame.

    Args:
        source: the stream.
        index: frame number.
        y: row, px.
        x: column, px.
    """
    state = source.world.state(index)
    cameras = state.cameras[0]
    # A view that is not static is not cached: there is one for each pixel.
    previous = replace(cameras.previous, name=f"{cameras.previous.name}, one pixel")
    size = source.width, source.height
    view = PixelView(previous, cameras.current, cameras.next, 1, 1, pixel=(y, x), image_size=size)
    frame = source.render_view(index, view, LABELS)
    values: dict[str, Any] = {name: frame[name][0, 0] for name in LABELS}
    instance = int(values["instance"])
    return _label(frame, instance, values, instance in moving_instances(state))


def _label(frame: Frame, instance: int, values: Mapping[str, Any], moving: bool) -> PixelLabel:
    number = int(values["semantic"])
    name = frame.objects.by_id(instance).name if instance else ""
    depth = float(values["depth"])
    return PixelLabel(frame.categories.get(number, ""), number, instance, name, int(values["part"]), depth, moving)
