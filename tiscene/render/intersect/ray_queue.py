# SPDX-License-Identifier: Apache-2.0
"""The arrays that one wave of primary rays is traced through."""

from functools import lru_cache
from typing import Any, Self

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.kernel_types import Template
from tiscene.render.sampling.sobol import pixel_order

_TILE = 8

# Kernels take rays and their hits as vectors: the address of a number is then known without the array's shape.
ray = ti.types.vector(8, ti.f32)
hit = ti.types.vector(4, ti.f32)
hit_id = ti.types.vector(2, ti.i32)
pixel = ti.types.vector(2, ti.i32)
Rays = ti.types.ndarray(ray, 1)
Hits = ti.types.ndarray(hit, 1)
HitIds = ti.types.ndarray(hit_id, 1)
Pixels = ti.types.ndarray(pixel, 1)
ROW, PLACE = 0, 1  # of a pixel: y * width + x, and where it stands in `pixel_order`


@ti.func
def write_ray(rays: Template, row: ti.i32, origin: ti.math.vec3, direction: ti.math.vec3, t_max: ti.f32):
    """A row of an array of rays, as tiscene.render.intersect takes them."""
    rays[row] = ray(origin.x, origin.y, origin.z, 0.0, direction.x, direction.y, direction.z, t_max)


@ti.func
def ray_origin(rays: Template, row: ti.i32) -> ti.math.vec3:
    return ti.math.vec3(rays[row][0], rays[row][1], rays[row][2])


@ti.func
def ray_direction(rays: Template, row: ti.i32) -> ti.math.vec3:
    return ti.math.vec3(rays[row][4], rays[row][5], rays[row][6])


def upload_rays(rays: NDArray[np.float32]) -> Any:
    """Rays, float32 [n, 8], as kernels take them."""
    array = ti.ndarray(ray, len(rays))
    array.from_numpy(np.ascontiguousarray(rays, np.float32))
    return array


def upload_pixels(rows: NDArray[np.int32], width: int, height: int) -> Any:
    """Pixels of a picture, by their rows y * width + x, as kernels take them."""
    array = ti.ndarray(pixel, len(rows))
    array.from_numpy(np.column_stack([rows, pixel_order(width, height)[rows]]))
    return array


class RayArrays:
    """One ray for each pixel, and what it hits. Kept from frame to frame, made anew where the size changes.

    queue: all pixels, in the order to trace them in; `queue_of` has some of them. further, mirrored: two queues each,
    for the rays that go on after a hit; their order is the threads' business, since each ray writes to its own row
    only. distance: f32 [n], for whoever needs one for each ray.
    """

    def __init__(self) -> None:
        self.count = 0
        self._size = (0, 0)
        self.rays: Any = None
        self.hits: Any = None
        self.hit_ids: Any = None
        self.distance: Any = None
        self.queue: Any = None
        self._some: Any = None
        self.further: tuple[Any, Any] = (None, None)
        self.mirrored: tuple[Any, Any] = (None, None)

    def sized(self, width: int, height: int) -> Self:
        """Itself, with one row for each pixel (row y * width + x)."""
        if self._size != (width, height):
            self._size = (width, height)
            self.count = width * height
            self.rays = ti.ndarray(ray, self.count)
            self.hits = ti.ndarray(hit, self.count)
            self.hit_ids = ti.ndarray(hit_id, self.count)
            self.distance = ti.ndarray(ti.f32, (self.count,))
            self.queue = ti.ndarray(ti.i32, (self.count,))
            self.queue.from_numpy(tiled_order(width, height))
            self._some = ti.ndarray(ti.i32, (self.count,))
            self.further = ti.ndarray(ti.i32, (self.count,)), ti.ndarray(ti.i32, (self.count,))
            self.mirrored = ti.ndarray(ti.i32, (self.count,)), ti.ndarray(ti.i32, (self.count,))
        return self

    def queue_of(self, pixels: NDArray[np.bool_]) -> tuple[Any, int]:
        """The pixels where an image [h, w] is True, in the order to trace them in, and how many they are."""
        order = tiled_order(self._size[0], self._size[1])
        queue = order[pixels.ravel()[order]]
        if len(queue):
            self._some.from_numpy(np.resize(queue, self.count))
        return self._some, len(queue)


class RayWave:
    """Rays that belong to no pixel, and what they hit. Kept, made anew where more are needed.

    queue: all of them, in order. further: two queues for the rays that go on after a hit.
    """

    def __init__(self) -> None:
        self._room = 0
        self.rays: Any = None
        self.hits: Any = None
        self.hit_ids: Any = None
        self.queue: Any = None
        self.further: tuple[Any, Any] = (None, None)

    def sized(self, count: int) -> Self:
        """Itself, with `count` rows or more."""
        if self._room < count:
            self._room = 1 << (count - 1).bit_length()
            self.rays = ti.ndarray(ray, self._room)
            self.hits = ti.ndarray(hit, self._room)
            self.hit_ids = ti.ndarray(hit_id, self._room)
            self.queue = ti.ndarray(ti.i32, (self._room,))
            self.queue.from_numpy(np.arange(self._room, dtype=np.int32))
            self.further = ti.ndarray(ti.i32, (self._room,)), ti.ndarray(ti.i32, (self._room,))
        return self


class AnyHitArrays:
    """Rays that each ask whether they meet one instance. Kept, made anew where more are needed."""

    def __init__(self) -> None:
        self._room = 0
        self.rays: Any = None
        self.targets: Any = None
        self.result: Any = None
        self.queue: Any = None

    def sized(self, count: int) -> Self:
        """Itself, with `count` rows or more."""
        if self._room < count:
            self._room = 1 << (count - 1).bit_length()
            self.rays = ti.ndarray(ray, self._room)
            self.targets = ti.ndarray(ti.i32, (self._room,))
            self.result = ti.ndarray(ti.i32, (self._room,))
            self.queue = ti.ndarray(ti.i32, (self._room,))
            self.queue.from_numpy(np.arange(self._room, dtype=np.int32))
        return self


@lru_cache(maxsize=4)
def tiled_order(width: int, height: int) -> NDArray[np.int32]:
    """Every pixel's row, int32 [width * height], tile by tile, the tiles strewn over the picture.

    Neighboring rays share the nodes they visit; Taichi gives each thread one contiguous part of a loop, so without
    the strewing one thread would get the sky and the other one the furniture.
    """
    rows = np.arange(width * height, dtype=np.int32).reshape(height, width)
    tiles_y, tiles_x = -(-height // _TILE), -(-width // _TILE)
    count = tiles_y * tiles_x
    stride = next(s for s in range(max(1, int(0.618 * count)), 2 * count + 1) if np.gcd(s, count) == 1)
    y, x = np.mgrid[:height, :width]
    tile = (y // _TILE) * tiles_x + x // _TILE
    place = np.empty(count, np.int64)
    place[(np.arange(count) * stride) % count] = np.arange(count)
    return rows.ravel()[np.argsort(place[tile].ravel(), kind="stable")]
