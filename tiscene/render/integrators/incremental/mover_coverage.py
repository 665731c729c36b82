# SPDX-License-Identifier: Apache-2.0
"""Fraction of each pixel that movers cover, by rays through a fixed grid of 4 x 4 subpixels.

Each ray ends at the first static surface, so a mover covers the subpixel if it blocks the ray. Two probe subpixels of
each pixel find the movers. The other subpixels are tested only near the edges of movers, where the few paths of a pixel
would hit or miss the mover by chance and the denoiser would see noisy silhouettes.
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

SIDE = 4  # subpixels per row of a pixel
SUBPIXELS = SIDE * SIDE
PROBES = 2  # subpixels of each pixel that are always tested
PROBE_SUBPIXELS = SIDE, 2 * SIDE + SIDE - 1  # opposite each other
NO_MOVER_NEAR = -1

MoverTest = Callable[[Any, int], int]  # takes rays and their number; sets `blocked` for each ray


class MoverCoverage:
    """Subpixel rays up to the static surfaces of a view, and which of them movers block.

    Args:
        scene: The scene, as placed at CURRENT without the movers.
        view: Camera and image size.
        order: i32 [pixels], pixel numbers y * width + x in the order of rows, see `tiled_order`.
        pixels: The same on the device, see `upload_pixels`.

    Attributes:
        sharp: Whether the camera has a pinhole, so that these rays see what paths see.
    """

    def __init__(self, scene: DeviceScene, view: View, order: NDArray[np.int32], pixels: Any) -> None:
        self._view, self._order, self._pixels = view, order, pixels
        self.sharp = view.current.lens_radius == 0.0
        count = len(order)
        rays, queue = device_array(ray, count), upload(np.arange(count, dtype=np.int32))
        hits, hit_ids = device_array(hit, count), device_array(hit_id, count)
        self._probe_rays = device_array(ray, PROBES * count)
        self._other_distances = device_array(ti.f32, ((SUBPIXELS - PROBES) * count,))
        self._other_rays = device_array(ray, 1)
        for number in range(SUBPIXELS):
            subpixel_rays(view.array(), pixels, view.width, view.height, number, rays)
            closest(scene, CURRENT, rays, queue, count, hits, hit_ids)
            store_rays(count, number, rays, hits, self._probe_rays, self._other_distances)

    @property
    def max_rows(self) -> int:
        """Largest number of rays that are tested together."""
        return max(int(self._probe_rays.shape[0]), SUBPIXELS - PROBES)

    def count(self, test: MoverTest, blocked: Any, all_subpixels: bool) -> NDArray[np.int32]:
        """Count the covered subpixels of each pixel.

        Args:
            test: Tests rays against the movers.
            blocked: i32 [max_rows] on the device, output of `test`: whether a mover blocks each ray.
            all_subpixels: Whether to test all subpixels near edges of movers; False extrapolates from the probes.

        Returns:
            int32 [height, width], 0 .. SUBPIXELS; NO_MOVER_NEAR in pixels that are not next to a covered probe.
        """
        shape, count = (self._view.height, self._view.width), len(self._order)
        test(self._probe_rays, PROBES * count)
        covered = np.empty(count, np.int32)
        count_probes(self._pixels, count, blocked, covered)
        image = covered.reshape(shape)
        near = dilated(image > 0)
        edges = np.flatnonzero((near & dilated(image < SUBPIXELS)).ravel()[self._order]).astype(np.int32)
        batch = self.max_rows // (SUBPIXELS - PROBES)
        for begin in range(0, len(edges) if all_subpixels else 0, batch):
            ranks = edges[begin : begin + batch]
            rows = len(ranks) * (SUBPIXELS - PROBES)
            if self._other_rays.shape[0] < rows:
                self._other_rays = device_array(ray, min(2 * rows, self.max_rows))
            other_subpixel_rays(
                self._view.array(), self._pixels, *shape[::-1], ranks, len(ranks),
                self._other_distances, self._other_rays,
            )  # fmt: skip
            test(self._other_rays, rows)
            count_all(self._pixels, ranks, len(ranks), blocked, covered)
        image[~near] = NO_MOVER_NEAR
        return image


def dilated(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the mask dilated by a 3 x 3 square."""
    padded = np.pad(mask, 1)
    rows = padded[:-2] | padded[1:-1] | padded[2:]
    return rows[:, :-2] | rows[:, 1:-1] | rows[:, 2:]


@ti.func
def subpixel_ray(view: Template, pixel: ti.i32, number: ti.i32, width: ti.i32, height: ti.i32):
    """Return the camera ray through a subpixel's center. Numbers: the probes, then the others row by row."""
    subpixel = PROBE_SUBPIXELS[0] if number == 0 else PROBE_SUBPIXELS[1]
    if number >= PROBES:
        subpixel = number - PROBES
        for probe in ti.static(PROBE_SUBPIXELS):
            if subpixel >= probe:
                subpixel += 1
    x = pixel % width + (subpixel % SIDE + 0.5) / SIDE - 0.5
    y = pixel // width + (subpixel // SIDE + 0.5) / SIDE - 0.5
    return camera_ray(view, CURRENT, x, y, width, height)


@ti.kernel
def subpixel_rays(view: Floats2, pixels: Pixels, width: ti.i32, height: ti.i32, number: ti.i32, rays: Rays):
    """Generate the rays through one subpixel of every pixel."""
    for rank in range(width * height):
        origin, direction = subpixel_ray(view, pixels[rank][ROW], number, width, height)
        write_ray(rays, rank, origin, direction, ti.math.inf)


@ti.kernel
def store_rays(count: ti.i32, number: ti.i32, rays: Rays, hits: Hits, probe_rays: Rays, other_distances: Floats1):
    """Store probe rays up to their hits; of other subpixels only the distances of the hits, m."""
    for rank in range(count):
        if number < PROBES:
            probe_rays[number * count + rank] = rays[rank]
            probe_rays[number * count + rank][7] = hits[rank][0]
        else:
            other_distances[rank * (SUBPIXELS - PROBES) + number - PROBES] = hits[rank][0]


@ti.kernel
def count_probes(pixels: Pixels, count: ti.i32, blocked: Ints1, covered: Ints1):
    """Estimate covered subpixels from the probes alone."""
    for rank in range(count):
        found = 0
        for number in ti.static(range(PROBES)):
            found += blocked[number * count + rank]
        covered[pixels[rank][ROW]] = found * (SUBPIXELS // PROBES)


@ti.kernel
def other_subpixel_rays(
    view: Floats2,
    pixels: Pixels,
    width: ti.i32,
    height: ti.i32,
    ranks: Ints1,
    count: ti.i32,
    distances: Floats1,
    rays: Rays,
):
    """Generate the rays through the subpixels of some pixels that are not probes."""
    for row in range(count * (SUBPIXELS - PROBES)):
        rank, number = ranks[row // (SUBPIXELS - PROBES)], row % (SUBPIXELS - PROBES)
        origin, direction = subpixel_ray(view, pixels[rank][ROW], PROBES + number, width, height)
        write_ray(rays, row, origin, direction, distances[rank * (SUBPIXELS - PROBES) + number])


@ti.kernel
def count_all(pixels: Pixels, ranks: Ints1, count: ti.i32, blocked: Ints1, covered: Ints1):
    """Replace the estimate of some pixels by the count of all their subpixels."""
    for k in range(count):
        pixel = pixels[ranks[k]][ROW]
        found = covered[pixel] // (SUBPIXELS // PROBES)
        for number in range(SUBPIXELS - PROBES):
            found += blocked[k * (SUBPIXELS - PROBES) + number]
        covered[pixel] = found
