# SPDX-License-Identifier: Apache-2.0
"""Coverage: which objects and materials a pixel shows, and how much of it each fills, by fixed rays through it."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.kernel_types import Floats2, Floats4, Ints1, Ints2
from tiscene.frame.buffers import RANKS
from tiscene.render.integrators.labels.first_hits import first_hits
from tiscene.render.intersect.ray_queue import HitIds, Hits, Rays, RayWave, write_ray
from tiscene.render.intersect.surface_interaction import INFO_INSTANCE_ID
from tiscene.render.view import View, camera_ray
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT, MOVERS

COVERAGES = ("coverage", "material_coverage")

# Rays through a pixel, at the points of Hammersley's set: one in each row, column and cell of a 4 x 4 grid.
SAMPLES_LOG2 = 4
SAMPLES = 1 << SAMPLES_LOG2
_BATCH = 1 << 14  # pixels


@dataclass(frozen=True, eq=False)
class CoverageSamples:
    """What the rays of each pixel meet. distance: float32 [pixels, SAMPLES], m. ids: int32, of instances; 0: none.
    materials: int32, numbers in `MaterialTable.labels`; 0: none, or not asked for."""

    distance: NDArray[np.float32]
    ids: NDArray[np.int32]
    materials: NDArray[np.int32]

    @classmethod
    def empty(cls, pixels: int) -> Self:
        """For so many pixels, not set."""
        shape = (pixels, SAMPLES)
        return cls(np.empty(shape, np.float32), np.empty(shape, np.int32), np.empty(shape, np.int32))


class CoverageLabels:
    """The part of the label pass that looks at all of a pixel, not at its center."""

    def __init__(self, scene: DeviceScene) -> None:
        self.scene = scene
        self._wave = RayWave()
        self._none = CoverageSamples.empty(1)
        self._batch = self._none

    def render(
        self,
        view: View,
        queue: Any,
        count: int,
        arrays: dict[str, NDArray[Any]],
        reach: NDArray[np.float32],
        still: CoverageSamples | None = None,
        kept: CoverageSamples | None = None,
    ) -> None:
        """Fill the pixels of a queue in those of COVERAGES that are among the arrays; raise `reach` [h, w] to the
        distance of the farthest thing that they show, m.

        still: what stands still: only the tree MOVERS is looked at besides. kept: is filled with what is met.
        """
        tree, behind = (CURRENT, self._none) if still is None else (MOVERS, still)
        if kept is None and len(self._batch.ids) < min(count, _BATCH):
            self._batch = CoverageSamples.empty(min(count, _BATCH))
        samples = self._batch if kept is None else kept
        materials = self.scene.materials.label_of_row()
        for first in range(0, count, _BATCH):
            pixels = min(_BATCH, count - first)
            wave = self._wave.reserved(pixels * SAMPLES)
            coverage_rays(
                queue, first, pixels, view.array(), view.width, view.height,
                int(still is not None), behind.distance, wave.rays,
            )  # fmt: skip
            first_hits(self.scene, tree, wave, wave.queue, pixels * SAMPLES, together=True)
            coverage_samples(
                queue, first, pixels, wave.hits, wave.hit_ids, self.scene.instance_info,
                int("material_coverage" in arrays), self.scene.triangle_material, materials, view.width,
                int(still is not None), behind.distance, behind.ids, behind.materials,
                int(kept is not None), samples.distance, samples.ids, samples.materials, reach,
            )  # fmt: skip
            for name, ids in (("coverage", samples.ids), ("material_coverage", samples.materials)):
                if name in arrays:
                    rank_samples(queue, first, pixels, int(kept is not None), ids, view.width, arrays[name])


@ti.kernel
def coverage_rays(
    queue: Ints1,
    first: ti.i32,
    count: ti.i32,
    view: Floats2,
    width: ti.i32,
    height: ti.i32,
    is_bounded: ti.i32,
    bounds: Floats2,
    rays: Rays,
):
    """Where `is_bounded` is set, rays end at the bounds, and meet what is there: the lower id counts then."""
    for i in range(count * SAMPLES):
        pixel, sample = queue[first + i // SAMPLES], i % SAMPLES
        mirrored = 0
        for bit in ti.static(range(SAMPLES_LOG2)):
            mirrored |= ((sample >> bit) & 1) << (SAMPLES_LOG2 - 1 - bit)
        x = pixel % width + (sample + 0.5) / SAMPLES - 0.5
        y = pixel // width + (mirrored + 0.5) / SAMPLES - 0.5
        origin, direction = camera_ray(view, CURRENT, x, y, width, height)
        t_max = ti.math.inf
        if is_bounded != 0 and bounds[pixel, sample] < ti.math.inf:
            t_max = ti.bit_cast(ti.bit_cast(bounds[pixel, sample], ti.i32) + 1, ti.f32)
        write_ray(rays, i, origin, direction, t_max)


@ti.kernel
def coverage_samples(
    queue: Ints1,
    first: ti.i32,
    count: ti.i32,
    hits: Hits,
    hit_ids: HitIds,
    instance_info: Ints2,
    names_materials: ti.i32,
    triangle_material: Ints1,
    label_of_material: Ints1,
    width: ti.i32,
    is_before: ti.i32,
    still_distance: Floats2,
    still_ids: Ints2,
    still_materials: Ints2,
    by_pixel: ti.i32,
    distances: Floats2,
    ids: Ints2,
    materials: Ints2,
    reach: Floats2,
):
    """What the rays of each pixel met, before what stands still if that is given, in the rows of the pixels
    (`by_pixel`) or one after another."""
    for i in range(count):
        pixel = queue[first + i]
        x, y = pixel % width, pixel // width
        to = pixel if by_pixel != 0 else i
        farthest = reach[y, x]
        for s in range(SAMPLES):
            ray = i * SAMPLES + s
            row, distance = hit_ids[ray][0], hits[ray][0]
            id, material = 0, 0
            if row >= 0:
                id = instance_info[row, INFO_INSTANCE_ID]
                if names_materials != 0:
                    material = label_of_material[triangle_material[hit_ids[ray][1]]]
            if is_before != 0:
                other = still_distance[pixel, s]
                if row < 0 or other < distance or (other == distance and still_ids[pixel, s] < id):
                    id, material, distance = still_ids[pixel, s], still_materials[pixel, s], other
            ids[to, s], materials[to, s], distances[to, s] = id, material, distance
            farthest = ti.max(farthest, distance)
        reach[y, x] = farthest


@ti.kernel
def rank_samples(
    queue: Ints1,
    first: ti.i32,
    count: ti.i32,
    by_pixel: ti.i32,
    samples: Ints2,
    width: ti.i32,
    coverage: Floats4,
):
    """Of what the rays of each pixel met the most first, of equals the lower id."""
    for i in range(count):
        pixel = queue[first + i]
        x, y = pixel % width, pixel // width
        at = pixel if by_pixel != 0 else i
        ids = ti.Vector([0] * SAMPLES)
        alike = True
        for s in range(SAMPLES):
            ids[s] = samples[at, s]
            alike &= ids[s] == ids[0]
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
