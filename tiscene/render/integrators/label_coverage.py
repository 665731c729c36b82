"""Coverage: which objects a pixel shows, and how much of it each fills, by a fixed set of rays through the pixel."""

from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.render.aovs import RANKS
from tiscene.render.integrators.label_hits import first_hits
from tiscene.render.ray_arrays import HitIds, Hits, Rays, RayWave, write_ray
from tiscene.render.surface import FLOATS_2D, INFO_INSTANCE_ID, INTS_1D, INTS_2D
from tiscene.render.view import View, camera_ray
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT

# Rays through a pixel, at the points of Hammersley's set: one in each row, column and cell of a 4 x 4 grid.
SAMPLES_LOG2 = 4
SAMPLES = 1 << SAMPLES_LOG2
_BATCH = 1 << 14  # pixels

RANKED = ti.types.ndarray(dtype=ti.f32, ndim=4)


class CoverageLabels:
    """The part of the label pass that looks at all of a pixel, not at its centre."""

    def __init__(self, scene: DeviceScene) -> None:
        self.scene = scene
        self._wave = RayWave()

    def render(self, view: View, queue: Any, count: int, coverage: NDArray[Any], reach: NDArray[np.float32]) -> None:
        """Fill the pixels of a queue; raise `reach` [h, w] to the distance of the farthest thing that they show, m."""
        for first in range(0, count, _BATCH):
            pixels = min(_BATCH, count - first)
            wave = self._wave.sized(pixels * SAMPLES)
            coverage_rays(queue, first, pixels, view.array(), view.width, view.height, wave.rays)
            first_hits(self.scene, CURRENT, wave, wave.queue, pixels * SAMPLES, together=True)
            coverage_labels(
                queue, first, pixels, wave.hits, wave.hit_ids, self.scene.instance_info, view.width, coverage, reach
            )


@ti.kernel
def coverage_rays(
    queue: INTS_1D, first: ti.i32, count: ti.i32, view: FLOATS_2D, width: ti.i32, height: ti.i32, rays: Rays
):
    for i in range(count * SAMPLES):
        pixel, sample = queue[first + i // SAMPLES], i % SAMPLES
        mirrored = 0
        for bit in ti.static(range(SAMPLES_LOG2)):
            mirrored |= ((sample >> bit) & 1) << (SAMPLES_LOG2 - 1 - bit)
        x = pixel % width + (sample + 0.5) / SAMPLES - 0.5
        y = pixel // width + (mirrored + 0.5) / SAMPLES - 0.5
        origin, direction = camera_ray(view, CURRENT, x, y, width, height)
        write_ray(rays, i, origin, direction, ti.math.inf)


@ti.kernel
def coverage_labels(
    queue: INTS_1D,
    first: ti.i32,
    count: ti.i32,
    hits: Hits,
    hit_ids: HitIds,
    instance_info: INTS_2D,
    width: ti.i32,
    coverage: RANKED,
    reach: FLOATS_2D,
):
    """Rank what the rays of each pixel met: the most first, of equals the lower id."""
    for i in range(count):
        pixel = queue[first + i]
        x, y = pixel % width, pixel // width
        ids = ti.Vector([0] * SAMPLES)
        alike, farthest = True, reach[y, x]
        for s in range(SAMPLES):
            ray = i * SAMPLES + s
            row = hit_ids[ray][0]
            ids[s] = instance_info[row, INFO_INSTANCE_ID] if row >= 0 else 0
            alike &= ids[s] == ids[0]
            farthest = ti.max(farthest, hits[ray][0])
        reach[y, x] = farthest
        for rank in range(RANKS):
            coverage[y, x, rank, 0] = 0.0
            coverage[y, x, rank, 1] = 0.0
        if alike:
            if ids[0] > 0:
                coverage[y, x, 0, 0] = ti.cast(ids[0], ti.f32)
                coverage[y, x, 0, 1] = 1.0
        else:
            counts = ti.Vector([0] * SAMPLES)  # of an id, where it is met for the first time
            for s in range(SAMPLES):
                place = s
                for earlier in range(s):
                    if place == s and ids[earlier] == ids[s]:
                        place = earlier
                counts[place] += 1
            for rank in range(RANKS):
                best = -1
                for s in range(SAMPLES):
                    if ids[s] > 0 and counts[s] > 0:
                        if best < 0 or counts[s] > counts[best] or (counts[s] == counts[best] and ids[s] < ids[best]):
                            best = s
                if best >= 0:
                    coverage[y, x, rank, 0] = ti.cast(ids[best], ti.f32)
                    coverage[y, x, rank, 1] = ti.cast(counts[best], ti.f32) / SAMPLES
                    counts[best] = 0
