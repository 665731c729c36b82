# SPDX-License-Identifier: Apache-2.0
"""Device arrays of rays, hits and queues, and the order in which the pixels of an image are traced."""

from functools import lru_cache
from typing import Any, Self

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.kernel_types import Template
from tiscene.device.memory import device_array, upload
from tiscene.render.sampling.sobol import pixel_order

_TILE = 8

# Arrays of vectors: the address of an element does not depend on the array's shape.
# ray: origin, LINKS, direction, t_max. hit: distance, b1, b2, unused. hit_id: instance row, triangle.
ray = ti.types.vector(8, ti.f32)
hit = ti.types.vector(4, ti.f32)
hit_id = ti.types.vector(2, ti.i32)
pixel = ti.types.vector(2, ti.i32)
Rays = ti.types.ndarray(ray, 1)
Hits = ti.types.ndarray(hit, 1)
HitIds = ti.types.ndarray(hit_id, 1)
Pixels = ti.types.ndarray(pixel, 1)
T_MAX = 7  # column of a ray
LINKS = 3  # of a shadow ray: 1 + SHADOWING of its light (see `light_table`); 0: all meshes cast shadows
ROW, PLACE = 0, 1  # of a pixel: y * width + x, and its position in `pixel_order`


@ti.func
def write_ray(rays: Template, row: ti.i32, origin: ti.math.vec3, direction: ti.math.vec3, t_max: ti.f32):
    """Write one ray."""
    rays[row] = ray(origin.x, origin.y, origin.z, 0.0, direction.x, direction.y, direction.z, t_max)


@ti.func
def ray_origin(rays: Template, row: ti.i32) -> ti.math.vec3:
    """Return the origin of a ray."""
    return ti.math.vec3(rays[row][0], rays[row][1], rays[row][2])


@ti.func
def ray_direction(rays: Template, row: ti.i32) -> ti.math.vec3:
    """Return the direction of a ray."""
    return ti.math.vec3(rays[row][4], rays[row][5], rays[row][6])


@ti.func
def write_hit(
    hits: Template,
    hit_ids: Template,
    row: ti.i32,
    distance: ti.f32,
    b1: ti.f32,
    b2: ti.f32,
    instance: ti.i32,
    triangle: ti.i32,
):
    """Write the hit of one ray. Where it hits no instance, -1, its distance is infinite."""
    hits[row] = hit(ti.select(instance >= 0, distance, ti.math.inf), b1, b2, 0.0)
    hit_ids[row] = hit_id(instance, triangle)


def upload_pixels(rows: NDArray[np.int32], width: int, height: int, frames: int = 1) -> Any:
    """Return pixels, int32 [n], y * width + x, as a device array with ROW and PLACE.

    Args:
        rows: The pixels.
        width: Image width, px.
        height: Image height, px.
        frames: Number of images below each other, each with these pixels.
    """
    first_rows = width * height * np.arange(frames, dtype=np.int32)
    places = np.tile(pixel_order(width, height)[rows], frames)
    return upload_rows(np.add.outer(first_rows, rows).ravel(), places)


def upload_rows(rows: NDArray[np.int32], places: NDArray[np.int32]) -> Any:
    """Return ROW and PLACE of pixels, int32 [n] each, as a device array."""
    array = device_array(pixel, len(rows))
    array.from_numpy(np.column_stack([rows, places]))
    return array


class TracedRays:
    """Rays and their hits.

    Attributes:
        rays: [n] of `ray`.
        hits: [n] of `hit`.
        hit_ids: [n] of `hit_id`.
        queue: i32 [n], all rays.
        next_queues: Two queues, i32 [n], for rays that continue after a hit. Their order depends on scheduling, and
            results do not, since each ray writes to its own row.
    """

    def __init__(self) -> None:
        self.rays: Any = None
        self.hits: Any = None
        self.hit_ids: Any = None
        self.queue: Any = None
        self.next_queues: tuple[Any, Any] = (None, None)

    def _allocate(self, order: NDArray[np.int32]) -> None:
        """Make arrays of as many rows as are in the queue."""
        count = len(order)
        self.rays, self.hits, self.hit_ids = (device_array(kind, count) for kind in (ray, hit, hit_id))
        self.queue = upload(order)
        self.next_queues = _two_queues(count)


class RayWave(TracedRays):
    """Rays that belong to no pixel, queued in order; reallocated when more are needed."""

    def reserved(self, count: int) -> Self:
        """Return itself, with at least `count` rows."""
        if self.rays is None or self.rays.shape[0] < count:
            self._allocate(np.arange(1 << (count - 1).bit_length(), dtype=np.int32))
        return self


class RayArrays(TracedRays):
    """One ray and its hit for each pixel, in row y * width + x; reallocated when the size changes.

    Attributes:
        count: Number of pixels.
        distance: f32 [n], scratch space for one number per ray.
        queue: i32 [n], all pixels in tracing order; `queue_of` returns a subset.
        mirrored: Two queues, i32 [n], for rays that are reflected by mirrors.
    """

    def __init__(self) -> None:
        super().__init__()
        self.count = 0
        self._size = (0, 0)
        self.distance: Any = None
        self._subset: Any = None
        self._subset_values = np.zeros(0, np.int32)
        self.mirrored: tuple[Any, Any] = (None, None)

    def resized(self, width: int, height: int) -> Self:
        """Return itself, with one row for each pixel."""
        if self._size != (width, height):
            self._size = (width, height)
            self.count = width * height
            self._allocate(tiled_order(width, height))
            self.distance = device_array(ti.f32, (self.count,))
            self._subset = device_array(ti.i32, (self.count,))
            self._subset_values = np.zeros(self.count, np.int32)  # rows past the subset's keep what they had
            self.mirrored = _two_queues(self.count)
        return self

    def copy_of(self, other: Self) -> Self:
        """Return itself, with the size, the rays and the hits of others."""
        self.resized(*other._size)
        self.rays.copy_from(other.rays)
        self.hits.copy_from(other.hits)
        self.hit_ids.copy_from(other.hit_ids)
        return self

    def queue_of(self, pixels: NDArray[np.bool_]) -> tuple[Any, int]:
        """Return (queue, count) of the pixels where an image [h, w] is True, in tracing order."""
        order = tiled_order(self._size[0], self._size[1])
        queue = order[pixels.ravel()[order]]
        if len(queue):
            self._subset_values[: len(queue)] = queue
            self._subset.from_numpy(self._subset_values)
        return self._subset, len(queue)


def _two_queues(count: int) -> tuple[Any, Any]:
    return device_array(ti.i32, (count,)), device_array(ti.i32, (count,))


@lru_cache(maxsize=4)
def tiled_order(width: int, height: int) -> NDArray[np.int32]:
    """Return all pixels, int32 [width * height], y * width + x, tile by tile, with the tiles shuffled.

    Neighboring rays visit the same nodes. Taichi gives each thread one contiguous part of a loop; shuffled tiles
    balance the load between threads.
    """
    pixels = np.arange(width * height, dtype=np.int32)
    return pixels[np.argsort(tiled_ranks(pixels, width, height))]


def tiled_ranks(pixels: NDArray[np.int32], width: int, height: int) -> NDArray[np.int64]:
    """Return numbers, int64 [n], that sort pixels, y * width + x, as in `tiled_order`."""
    tiles_y, tiles_x = -(-height // _TILE), -(-width // _TILE)
    count = tiles_y * tiles_x
    stride = next(s for s in range(max(1, int(0.618 * count)), 2 * count + 1) if np.gcd(s, count) == 1)
    y, x = np.divmod(pixels.astype(np.int64), width)
    tile = y // _TILE * tiles_x + x // _TILE
    shuffled = tile * pow(stride, -1, count) % count
    return shuffled * _TILE**2 + y % _TILE * _TILE + x % _TILE
