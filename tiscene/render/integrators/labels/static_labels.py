# SPDX-License-Identifier: Apache-2.0
"""Labels of what stands still before a camera that does not move: rendered once, not for every frame.

Of a picture seen before, only the pixels that something else may cover are rendered anew, and those whose mirrors may
show it. The bytes are those of the whole picture: a ray that meets only what stands still finds the same whatever else
is there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.render.integrators.labels.coverage import CoverageSamples
from tiscene.render.view import View
from tiscene.scene.camera import Camera
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT, NEXT, PREVIOUS, Placement

KEPT_VIEWS = 4  # those not seen for longest go first
KEPT_PIXELS = 1 << 19  # larger pictures are rendered whole: this many take 130 MB with all buffers
ALL_TIMES = PREVIOUS, CURRENT, NEXT
MOST_CHANGED = 0.6  # of the pixels; where more change, the picture is rendered whole
_MARGIN = 1e-3  # of a distance; far more than rays and boxes are rounded by


@dataclass(eq=False)
class StaticImage:
    """Labels of a view. arrays: buffers by name. reach: float32 [h, w], the distance beyond which nothing can change a
    pixel, m. mirrors: bool [h, w], where another thing than the first one is shown. samples: what coverages are made
    of, if they are among the buffers."""

    arrays: dict[str, NDArray[Any]]
    reach: NDArray[np.float32]
    mirrors: NDArray[np.bool_]
    samples: CoverageSamples | None


@dataclass(eq=False)
class _Seen:
    """What was in a view when it was rendered last, which instances have stood still since, and their picture."""

    placement: Placement
    still: NDArray[np.bool_]
    picture: StaticImage | None = None


class StillLabels:
    """Pictures of what stands still in the views of a scene."""

    def __init__(self, scene: DeviceScene) -> None:
        self.scene = scene
        self._seen: dict[tuple[Camera, int, int], _Seen] = {}

    def picture(
        self,
        view: View,
        buffers: Iterable[str],
        times: Iterable[int],
        draw: Callable[[View, tuple[str, ...]], StaticImage],
    ) -> tuple[StaticImage, NDArray[np.bool_], NDArray[np.bool_]] | None:
        """A picture of what stands still, with those buffers; bool [h, w]: the pixels where more is to be seen; and
        bool [n]: the instances that may be there.

        times: for which those buffers need the scene placed, as it is again when this returns. draw: renders a picture
        of all that is placed. None: the whole picture is to be rendered; the view is new, changes too much or is too
        large to keep.
        """
        placement = self.scene.placement
        seen = self._look(view, placement)
        if seen is None or not seen.still.any():
            return None
        if seen.picture is None or not seen.picture.arrays.keys() >= set(buffers):
            names = tuple(dict.fromkeys([*(seen.picture.arrays if seen.picture else ()), *buffers]))
            self.scene.place(replace(placement, present=placement.present & seen.still), ALL_TIMES)
            seen.picture = draw(view, names)
            self.scene.place(placement, ALL_TIMES)
        changed = self._changed(view, np.flatnonzero(~seen.still), times, seen.picture)
        if changed.mean() > MOST_CHANGED:
            return None
        return seen.picture, changed, ~seen.still

    def _look(self, view: View, placement: Placement) -> _Seen | None:
        """What is known of a view, None if it is new, or orthographic; what moves now stands still no more."""
        fixed = view.previous == view.current == view.next
        if not fixed or view.orthographic or view.width * view.height > KEPT_PIXELS:
            return None
        key = view.current, view.width, view.height
        seen = self._seen.pop(key, None)
        new = seen is None
        if seen is None:
            deforms = np.array([mesh.deformation is not None for mesh in self.scene.meshes], bool)
            seen = _Seen(placement, ~deforms[placement.mesh])
            if len(self._seen) >= KEPT_VIEWS:
                del self._seen[next(iter(self._seen))]
        self._seen[key] = seen
        still = _unchanged(seen.placement, placement, seen.still)
        if still.sum() != seen.still.sum():
            seen.picture = None
        seen.still = still
        seen.placement = placement
        return None if new else seen

    def _changed(
        self, view: View, rows: NDArray[np.int64], times: Iterable[int], picture: StaticImage
    ) -> NDArray[np.bool_]:
        """The pixels that the boxes of those instances may cover, before what stands still there, at any of the times,
        and all mirrors if they are anywhere."""
        placement, boxes = self.scene.placement, self.scene.mesh_boxes
        changed = np.zeros((view.height, view.width), bool)
        size = np.array([view.width, view.height])
        camera, focal = view.camera_from_world()[CURRENT], view.focal_lengths()[CURRENT]
        for time in times:
            there = placement.present[time, rows]
            if not there.any():
                continue
            if time == CURRENT:
                changed |= picture.mirrors
            shown = rows[there]
            matrices = placement.world_from_object[time, shown]
            corners = boxes[time, placement.mesh[shown]][:, _CORNERS, np.arange(3)]
            world = np.einsum("nij,nkj->nki", matrices[:, :, :3], corners) + matrices[:, None, :, 3]
            seen = np.einsum("ij,nkj->nki", camera[:, :3], world) + camera[:, 3]
            nearest = seen[..., 2].min(axis=1)
            with np.errstate(divide="ignore", invalid="ignore"):
                pixels = seen[..., :2] / seen[..., 2:] * focal + 0.5 * size
            low, high = np.floor(pixels.min(axis=1)) - 1.0, np.ceil(pixels.max(axis=1)) + 1.0
            around = nearest <= _MARGIN  # of the camera's plane: it may be anywhere
            low[around], high[around] = 0.0, size
            low, high = np.clip(low, 0, size).astype(int), np.clip(high, 0, size).astype(int)
            sides = np.concatenate([seen[..., :2], -seen[..., :2]], axis=2) * focal
            sides += seen[..., 2:] * (0.5 * np.concatenate([size, size]) + 1.0)
            ahead = (sides.max(axis=1) > 0.0).all(axis=1) & (seen[..., 2].max(axis=1) > 0.0)
            for (x0, y0), (x1, y1), z in zip(low[ahead], high[ahead], nearest[ahead] * (1.0 - _MARGIN), strict=True):
                changed[y0:y1, x0:x1] |= picture.reach[y0:y1, x0:x1] >= z
        return changed


_CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])


def _unchanged(before: Placement, now: Placement, still: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which instances of `now` are there and stand still at the three times, as they did `before`, and are `still`."""
    result = np.zeros(len(now.mesh), bool)
    count = min(len(before.mesh), len(now.mesh))
    world = now.world_from_object[:, :count]
    same = still[:count] & now.present[:, :count].all(axis=0) & before.present[:, :count].all(axis=0)
    for a, b in ((world[0], world[1]), (world[2], world[1]), (before.world_from_object[CURRENT, :count], world[1])):
        same &= (a == b).all(axis=(1, 2))
    for a, b in zip(_identity(before, count), _identity(now, count), strict=True):
        same &= a == b
    same &= (before.box_from_object[:count] == now.box_from_object[:count]).all(axis=(1, 2))
    result[:count] = same
    return result


def _identity(placement: Placement, count: int) -> tuple[NDArray[np.int32], ...]:
    part = np.zeros(count, np.int32) if placement.part is None else placement.part[:count]
    return placement.mesh[:count], placement.instance_id[:count], placement.category_id[:count], part
