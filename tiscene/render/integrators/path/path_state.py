# SPDX-License-Identifier: Apache-2.0
"""The device arrays of a wavefront of paths: rays, hits, queues and path state, one row per path.

The kernels of the path tracer communicate through these arrays only. They are reused by every batch; results leave a
batch through the film.
"""

from typing import Any, NamedTuple

import taichi as ti

from tiscene.device.kernel_types import Template
from tiscene.device.memory import device_array
from tiscene.device.prefix_sums import SCAN_BLOCKS
from tiscene.errors import ArgumentError
from tiscene.render.intersect.ray_queue import hit, hit_id, ray

# Columns of `PathState.state`; vectors take three columns.
STATE_COLUMNS = 16
state = ti.types.vector(STATE_COLUMNS, ti.f32)
States = ti.types.ndarray(state, 1)
THROUGHPUT, RADIANCE, PDF, RELATIVE_IOR2, DIRECT, ORIGIN, SPREAD, DIFFUSE_FRACTION = 0, 3, 6, 7, 8, 11, 14, 15

# Columns of `PathState.features`, the denoiser's auxiliary features at the first vertex that is not mirror-like.
FEATURE_COLUMNS = 6
ALBEDO, NORMAL = 0, 3

# `PathState.status`: path depth (number of surface vertices so far) in the low bits, flags above.
DEPTH_MASK = 0xFFFF
LIVE = 1 << 16  # the path has another segment to trace
FEATURES_WRITTEN = 1 << 17
LIGHT_PENDING = 1 << 18  # DIRECT still has to be added, if the shadow ray is not occluded
LINK_CLASS_SHIFT = 19  # above: the link class of the mesh at the last vertex, if lights have links

# Columns of the film, sums over the samples of a pixel: radiance, albedo, normal, number of non-finite samples.
FILM_COLUMNS = 10
DROPPED = 9

# Stream compaction works on chunks of up to CHUNK entries. Short queues use smaller chunks, since Taichi gives a thread
# at least 512 iterations of a loop and there would be too few chunks for all threads.
CHUNK, CHUNKS = 128, 1 << 10


@ti.func
def chunk_size(count: ti.i32) -> ti.i32:
    """Return the number of entries per chunk for a queue of `count` entries."""
    return ti.math.clamp(count // CHUNKS, 8, CHUNK)


def chunks_for(count: int) -> int:
    """Return the largest number of chunks of any queue of up to `count` entries, plus the total, plus SCAN_BLOCKS."""
    return max(count // CHUNK, CHUNKS + CHUNKS // 8) + 2 + SCAN_BLOCKS


@ti.func
def get3(states: Template, row: ti.i32, column: ti.i32) -> ti.math.vec3:
    """Read three columns of a path's state."""
    return ti.math.vec3(states[row][column], states[row][column + 1], states[row][column + 2])


@ti.func
def set3(states: Template, row: ti.i32, column: ti.i32, v: ti.math.vec3):
    """Write three columns of a path's state."""
    for c in ti.static(range(3)):
        states[row][column + c] = v[c]


def check_numbers(pixels: int, spp: int, max_depth: int) -> None:
    """Raise an ArgumentError unless this number of paths can be traced."""
    if spp < 1 or max_depth < 1:
        raise ArgumentError(f"spp={spp}, max_depth={max_depth}: both must be at least 1")
    if pixels * spp >= 1 << 31:
        raise ArgumentError(f"{pixels} pixels at spp={spp}: more than 2^31 paths per frame; reduce spp")


class PathSamples(NamedTuple):
    """Identifies the random numbers of a set of paths.

    Attributes:
        spp: Paths per pixel in this set; path i belongs to pixel i // spp.
        index_bits: Bits that number all samples of a pixel, of which this set may be a part.
        key: Key of the frame's random numbers, see `frame_key`.
    """

    spp: int
    index_bits: int
    key: int


class PathState:
    """Arrays for up to `size` paths in flight.

    Args:
        size: Capacity, in paths.

    Attributes:
        first_sample: Number of the first sample traced in each pixel.
        rays, hits, hit_ids: The current segments and their intersections, see `tiscene.render.intersect.ray_queue`.
        queue, next_queue: i32 [size], rows of the paths to trace, now and after compaction; see `swap_queues`.
        shadow_rays: Shadow rays of the paths whose status has LIGHT_PENDING.
        shadow_queue: i32 [size], rows of those paths.
        occluded: i32 [size], 1 where a shadow ray is blocked.
        state: f32 [size, 16]: throughput 0-2; radiance 3-5; solid-angle density of the last sampled direction 6, 0 for
            camera rays; squared relative index of refraction along the path 7; unoccluded contribution of the light
            sample at the last vertex 8-10; position of that vertex 11-13; ray-cone spread 14, m per m; diffuse
            fraction of the last scattering 15.
        features: f32 [size, 6], albedo and normal for the denoiser.
        status: i32 [size], path depth and flags.
    """

    def __init__(self, size: int) -> None:
        self.size = size
        self.first_sample = 0
        self.rays = device_array(ray, size)
        self.hits = device_array(hit, size)
        self.hit_ids = device_array(hit_id, size)
        self.shadow_rays = device_array(ray, size)
        self.occluded = device_array(ti.i32, (size,))
        self.state = device_array(state, size)
        self.features = device_array(ti.f32, (size, FEATURE_COLUMNS))
        self.status = device_array(ti.i32, (size,))
        self.queue = device_array(ti.i32, (size,))
        self.next_queue = device_array(ti.i32, (size,))
        self.shadow_queue = device_array(ti.i32, (size,))
        self.chunks = device_array(ti.i32, (chunks_for(size),)), device_array(ti.i32, (chunks_for(size),))
        self._shadow_hits: tuple[Any, Any] | None = None

    def swap_queues(self) -> None:
        """Make the compacted queue of live paths the one to trace next."""
        self.queue, self.next_queue = self.next_queue, self.queue

    @property
    def shadow_hits(self) -> tuple[Any, Any]:
        """(hits, hit_ids) of shadow rays, allocated on first use: needed only where surfaces are partially opaque."""
        if self._shadow_hits is None:
            self._shadow_hits = device_array(hit, self.size), device_array(hit_id, self.size)
        return self._shadow_hits
