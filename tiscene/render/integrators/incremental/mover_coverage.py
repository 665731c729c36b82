# SPDX-License-Identifier: Apache-2.0
"""How much of each pixel the movers cover, by rays through fixed places up to the first surface that stands still.

Two of a pixel's places tell where movers are; all sixteen are looked through where an edge of one may be.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.kernel_types import Floats1, Floats2, Ints1, Template
from tiscene.device.memory import device_array, upload
from tiscene.render.intersect.ray_queue import ROW, Hits, Pixels, Rays, hit, hit_id, ray, write_ray
from tiscene.render.intersect.trace import closest
from tiscene.render.view import View, camera_ray
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT

SIDE = 4  # places in a row of a pixel
SUBPIXELS, FIRST = SIDE * SIDE, 2
PROBE_SUBPIXELS = SIDE, 2 * SIDE + SIDE - 1  # opposite each other
NO_MOVER_NEAR = -1

Test = Callable[[Any, int], int]  # rays and how many: what is in the way of each goes to `cut`


class MoverCoverage:
    """Through a picture of what a DeviceScene has placed at CURRENT, which should be all but the movers."""

    def __init__(self, scene: DeviceScene, view: View, order: NDArray[np.int32], pixels: Any) -> None:
        """sharp: paths see no more than these rays do. order, pixels: as `PathCache` has them."""
        self._view, self._order, self._pixels = view, order, pixels
        self.sharp = view.current.lens_radius == 0.0
        count = len(order)
        rays, queue = device_array(ray, count), upload(np.arange(count, dtype=np.int32))
        hits, hit_ids = device_array(hit, count), device_array(hit_id, count)
        self._first = device_array(ray, FIRST * count)
        self._ends = device_array(ti.f32, ((SUBPIXELS - FIRST) * count,))
        self._all = device_array(ray, 1)
        for place in range(SUBPIXELS):
            look_rays(view.array(), pixels, view.width, view.height, place, rays)
            closest(scene, CURRENT, rays, queue, count, hits, hit_ids)
            keep_looks(count, place, rays, hits, self._first, self._ends)

    @property
    def rows(self) -> int:
        """How many rays are tested together."""
        return int(self._first.shape[0])

    def covered(self, test: Test, cut: Any, all_places: bool) -> NDArray[np.int32]:
        """How many of its SUBPIXELS of each pixel have a mover in front, int32 [height, width]; NO_MOVER_NEAR where none is
        near. all_places: where an edge may be; else what the first say."""
        shape, count = (self._view.height, self._view.width), len(self._order)
        test(self._first, FIRST * count)
        looks = np.empty(count, np.int32)
        count_first(self._pixels, count, cut, looks)
        first = looks.reshape(shape)
        near = widened(first > 0)
        edges = np.flatnonzero((near & widened(first < SUBPIXELS)).ravel()[self._order]).astype(np.int32)
        most = self.rows // (SUBPIXELS - FIRST)
        for begin in range(0, len(edges) if all_places else 0, most):
            here = edges[begin : begin + most]
            rows = len(here) * (SUBPIXELS - FIRST)
            if self._all.shape[0] < rows:
                self._all = device_array(ray, min(2 * rows, self.rows))
            again_rays(self._view.array(), self._pixels, *shape[::-1], here, len(here), self._ends, self._all)
            test(self._all, rows)
            count_again(self._pixels, here, len(here), cut, looks)
        first[~near] = NO_MOVER_NEAR
        return first


def widened(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """And the eight pixels around each."""
    padded = np.pad(mask, 1)
    rows = padded[:-2] | padded[1:-1] | padded[2:]
    return rows[:, :-2] | rows[:, 1:-1] | rows[:, 2:]


@ti.func
def ray_through(view: Template, pixel: ti.i32, place: ti.i32, width: ti.i32, height: ti.i32):
    """The first places are opposite each other, the others follow row by row."""
    square = PROBE_SUBPIXELS[0] if place == 0 else PROBE_SUBPIXELS[1]
    if place >= FIRST:
        square = place - FIRST
        for first in ti.static(PROBE_SUBPIXELS):
            if square >= first:
                square += 1
    x = pixel % width + (square % SIDE + 0.5) / SIDE - 0.5
    y = pixel // width + (square // SIDE + 0.5) / SIDE - 0.5
    return camera_ray(view, CURRENT, x, y, width, height)


@ti.kernel
def look_rays(view: Floats2, pixels: Pixels, width: ti.i32, height: ti.i32, place: ti.i32, rays: Rays):
    """A ray through that place of every pixel."""
    for rank in range(width * height):
        origin, direction = ray_through(view, pixels[rank][ROW], place, width, height)
        write_ray(rays, rank, origin, direction, ti.math.inf)


@ti.kernel
def keep_looks(count: ti.i32, place: ti.i32, rays: Rays, hits: Hits, first: Rays, ends: Floats1):
    """The rays through the first places, up to what they met; of the others only where they end."""
    for rank in range(count):
        if place < FIRST:
            first[place * count + rank] = rays[rank]
            first[place * count + rank][7] = hits[rank][0]
        else:
            ends[rank * (SUBPIXELS - FIRST) + place - FIRST] = hits[rank][0]


@ti.kernel
def count_first(pixels: Pixels, count: ti.i32, cut: Ints1, looks: Ints1):
    """As if the other places were like the first ones."""
    for rank in range(count):
        found = 0
        for place in ti.static(range(FIRST)):
            found += cut[place * count + rank]
        looks[pixels[rank][ROW]] = found * (SUBPIXELS // FIRST)


@ti.kernel
def again_rays(
    view: Floats2, pixels: Pixels, width: ti.i32, height: ti.i32, ranks: Ints1, count: ti.i32, ends: Floats1, rays: Rays
):
    """The rays through the other places of some pixels."""
    for row in range(count * (SUBPIXELS - FIRST)):
        rank, place = ranks[row // (SUBPIXELS - FIRST)], row % (SUBPIXELS - FIRST)
        origin, direction = ray_through(view, pixels[rank][ROW], FIRST + place, width, height)
        write_ray(rays, row, origin, direction, ends[rank * (SUBPIXELS - FIRST) + place])


@ti.kernel
def count_again(pixels: Pixels, ranks: Ints1, count: ti.i32, cut: Ints1, looks: Ints1):
    """What the first places said, and now the others."""
    for k in range(count):
        pixel = pixels[ranks[k]][ROW]
        found = looks[pixel] // (SUBPIXELS // FIRST)
        for place in range(SUBPIXELS - FIRST):
            found += cut[k * (SUBPIXELS - FIRST) + place]
        looks[pixel] = found
