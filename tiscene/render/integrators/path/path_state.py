# SPDX-License-Identifier: Apache-2.0
"""The arrays that a batch of paths lives in between kernels. One row a path; nothing outlives a batch but the film."""

from typing import Any

import taichi as ti

from tiscene.device.kernel_types import Template
from tiscene.render.intersect.ray_queue import hit, hit_id, ray

# Columns of `state`.
STATE_COLUMNS = 16
state = ti.types.vector(STATE_COLUMNS, ti.f32)
States = ti.types.ndarray(state, 1)
THROUGHPUT, RADIANCE, PDF, RELATIVE_IOR2, DIRECT, ORIGIN, SPREAD, DIFFUSE_PART = 0, 3, 6, 7, 8, 11, 14, 15

# Columns of `features`: what the denoiser is told about the first thing seen that is not a mirror.
FEATURE_COLUMNS = 6
ALBEDO, NORMAL = 0, 3

# `status`: the number of surfaces met so far, and bits.
DEPTH_MASK = 0xFFFF
LIVE = 1 << 16
SEEN = 1 << 17  # features are written
SAMPLED = 1 << 18  # the light sampled at the last vertex is not yet counted

# Columns of the film, sums over the samples of a pixel: radiance, albedo, normal, number of samples dropped.
FILM_COLUMNS = 10
DROPPED = 9

# Entries that one thread compacts: so many, and fewer where there would be too few chunks for all threads, since
# Taichi gives a thread 512 turns of a loop at least.
CHUNK, CHUNKS = 128, 1 << 10


@ti.func
def chunk_size(count: ti.i32) -> ti.i32:
    return ti.math.clamp(count // CHUNKS, 8, CHUNK)


def chunks_for(count: int) -> int:
    """The most chunks that so many entries or fewer are in, and one more."""
    return max(count // CHUNK, CHUNKS + CHUNKS // 8) + 2


@ti.func
def get3(states: Template, row: ti.i32, column: ti.i32) -> ti.math.vec3:
    return ti.math.vec3(states[row][column], states[row][column + 1], states[row][column + 2])


@ti.func
def set3(states: Template, row: ti.i32, column: ti.i32, v: ti.math.vec3):
    for c in ti.static(range(3)):
        states[row][column + c] = v[c]


class PathState:
    """Room for `size` paths at a time.

    rays, hits, hit_ids, queue: as tiscene.render.intersect wants them; `queue` and `next_queue` swap roles.
    shadow_rays: of the paths that are SAMPLED. occluded: their answers. shadow_hits: made where shadow rays must look
    at what they meet.
    state: throughput 0-2, radiance 3-5, density of the last direction 6 (0: none, the camera's),
    squared index of refraction of where the path is 7, light sampled at the last vertex and not yet tested for shadow
    8-10, that vertex 11-13, by how much the path widens 14, m per m, the diffuse
    part of the last scattering 15. features: f32 [size, 6]. status: i32 [size].
    first_sample: number of the first of the samples that are traced in each pixel.
    """

    def __init__(self, size: int) -> None:
        self.size = size
        self.first_sample = 0
        self.rays = ti.ndarray(ray, size)
        self.hits = ti.ndarray(hit, size)
        self.hit_ids = ti.ndarray(hit_id, size)
        self.shadow_rays = ti.ndarray(ray, size)
        self.occluded = ti.ndarray(ti.i32, (size,))
        self.state = ti.ndarray(state, size)
        self.features = ti.ndarray(ti.f32, (size, FEATURE_COLUMNS))
        self.status = ti.ndarray(ti.i32, (size,))
        self.queue = ti.ndarray(ti.i32, (size,))
        self.next_queue = ti.ndarray(ti.i32, (size,))
        self.shadow_queue = ti.ndarray(ti.i32, (size,))
        self.chunks = ti.ndarray(ti.i32, (chunks_for(size), 2))
        self._shadow_hits: tuple[Any, Any] | None = None

    def swap(self) -> None:
        """The live paths become those to trace."""
        self.queue, self.next_queue = self.next_queue, self.queue

    @property
    def shadow_hits(self) -> tuple[Any, Any]:
        """(hits, hit_ids) of shadow rays."""
        if self._shadow_hits is None:
            self._shadow_hits = ti.ndarray(hit, self.size), ti.ndarray(hit_id, self.size)
        return self._shadow_hits
