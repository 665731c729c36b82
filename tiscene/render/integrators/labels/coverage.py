# SPDX-License-Identifier: Apache-2.0
"""Coverage buffers: which objects and materials each pixel shows, and which fraction of it each fills.

Sixteen rays per pixel, at the points of a Hammersley set. The results are ids ranked by their number of samples.
"""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.kernel_types import Floats2, Floats4, Ints1, Ints2
from tiscene.device.memory import empty_on_device
from tiscene.frame.buffers import RANKS
from tiscene.render.integrators.labels.first_hits import first_hits
from tiscene.render.intersect.ray_queue import HitIds, Hits, Rays, RayWave, write_ray
from tiscene.render.view import View, camera_ray
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.instance_upload import INFO_INSTANCE_ID
from tiscene.scene.placement import CURRENT, MOVERS

COVERAGES = ("coverage", "material_coverage")

# Rays per pixel, at the points of a Hammersley set: one in each row, each column and each cell of a 4 x 4 grid.
SAMPLES_LOG2 = 4
SAMPLES = 1 << SAMPLES_LOG2
_BATCH = 1 << 14  # pixels


@dataclass(frozen=True, eq=False)
class CoverageSamples:
    """Hits of the coverage rays of each pixel.

    Attributes:
        distance: float32 [pixels, SAMPLES], m; NumPy or device array, as the others.
        ids: int32 [pixels, SAMPLES], instance ids; 0 for none.
        materials: int32 [pixels, SAMPLES], numbers in `MaterialTable.labels`; 0 for none or if not requested.
    """

    distance: Any
    ids: Any
    materials: Any

    @classmethod
    def empty(cls, pixels: int, on_card: bool) -> Self:
        """Return uninitialized samples of this many pixels, in the device's memory if `on_card`."""
        empty = empty_on_device if on_card else np.empty
        return cls(*(empty((pixels, SAMPLES), dtype) for dtype in (np.float32, np.int32, np.int32)))


class CoverageLabels:
    """Renders the buffers of COVERAGES for the label pass.

    Args:
        scene: The scene.
    """

    def __init__(self, scene: DeviceScene) -> None:
        self.scene = scene
        self._wave = RayWave()
        self._on_card = scene.traversal == "bvh2"
        self._none = CoverageSamples.empty(1, self._on_card)
        self._batch = self._none
        self._distance: Any = None  # scratch in place of `max_distance`

    def render(
        self,
        view: View,
        queue: Any,
        count: int,
        arrays: dict[str, Any],
        max_distance: NDArray[np.float32] | None,
        static: CoverageSamples | None = None,
        result: CoverageSamples | None = None,
    ) -> None:
        """Write the coverage buffers at the queued pixels.

        Args:
            view: Camera and image size.
            queue: i32 pixel numbers on the device; count: their number.
            arrays: Output, buffers by name; those not in COVERAGES are ignored.
            max_distance: Output, float32 [h, w], raised to the distance of the farthest hit of each pixel, m; None: not
                needed.
            static: Samples of the static instances; only the tree MOVERS is traced in addition. None: all is traced.
            result: Output, samples of all pixels of the image; None: not needed.
        """
        tree, behind = (CURRENT, self._none) if static is None else (MOVERS, static)
        if result is None and self._batch.ids.shape[0] < min(count, _BATCH):
            self._batch = CoverageSamples.empty(min(count, _BATCH), self._on_card)
        if max_distance is None:
            shape = view.height, view.width
            if self._distance is None or self._distance.shape != shape:
                self._distance = (empty_on_device if self._on_card else np.zeros)(shape, np.float32)
        samples = self._batch if result is None else result
        materials = self.scene.materials.label_of_row()
        for first in range(0, count, _BATCH):
            pixels = min(_BATCH, count - first)
            wave = self._wave.reserved(pixels * SAMPLES)
            coverage_rays(
                queue, first, pixels, view.array(), view.width, view.height,
                int(static is not None), behind.distance, wave.rays,
            )  # fmt: skip
            first_hits(self.scene, tree, wave, wave.queue, pixels * SAMPLES, coherent=True)
            coverage_samples(
                queue, first, pixels, wave.hits, wave.hit_ids, self.scene.instance_info,
                int("material_coverage" in arrays), self.scene.triangle_material, materials, view.width,
                int(static is not None), behind.distance, behind.ids, behind.materials,
                int(result is not None), samples.distance, samples.ids, samples.materials,
                self._distance if max_distance is None else max_distance,
            )  # fmt: skip
            for name, ids in (("coverage", samples.ids), ("material_coverage", samples.materials)):
                if name in arrays:
                    rank_samples(queue, first, pixels, int(result is not None), ids, view.width, arrays[name])


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
    """Generate the rays of the queued pixels, SAMPLES per pixel.

    Args:
        is_bounded: 1: rays end just behind `bounds`, so that hits at equal distance are found and the lower id wins.
        bounds: f32 [pixels, SAMPLES], m.
    """
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
    has_static: ti.i32,
    static_distance: Floats2,
    static_ids: Ints2,
    static_materials: Ints2,
    by_pixel: ti.i32,
    distances: Floats2,
    ids: Ints2,
    materials: Ints2,
    max_distance: Floats2,
):
    """Write the hits of the rays, merged with those of static instances.

    Args:
        names_materials: 1: write materials, else 0.
        has_static: 1: the nearer of the hit and the static sample counts, at equal distance the lower id.
        by_pixel: 1: write to the row of the pixel, 0: to that of the queue.
        max_distance: Raised to the distance of the farthest sample.
    """
    for i in range(count):
        pixel = queue[first + i]
        x, y = pixel % width, pixel // width
        to = pixel if by_pixel != 0 else i
        farthest = max_distance[y, x]
        for s in range(SAMPLES):
            ray = i * SAMPLES + s
            row, distance = hit_ids[ray][0], hits[ray][0]
            id, material = 0, 0
            if row >= 0:
                id = instance_info[row, INFO_INSTANCE_ID]
                if names_materials != 0:
                    material = label_of_material[triangle_material[hit_ids[ray][1]]]
            if has_static != 0:
                other = static_distance[pixel, s]
                if row < 0 or other < distance or (other == distance and static_ids[pixel, s] < id):
                    id, material, distance = static_ids[pixel, s], static_materials[pixel, s], other
            ids[to, s], materials[to, s], distances[to, s] = id, material, distance
            farthest = ti.max(farthest, distance)
        max_distance[y, x] = farthest


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
    """Write the RANKS most frequent ids of each pixel and their fractions, at equal counts the lower id first."""
    for i in range(count):
        pixel = queue[first + i]
        x, y = pixel % width, pixel // width
        at = pixel if by_pixel != 0 else i
        ids = ti.Vector([0] * SAMPLES)
        uniform = True
        for s in range(SAMPLES):
            ids[s] = samples[at, s]
            uniform &= ids[s] == ids[0]
        for rank in range(RANKS):
            coverage[y, x, rank, 0] = 0.0
            coverage[y, x, rank, 1] = 0.0
        if uniform:
            if ids[0] > 0:
                coverage[y, x, 0, 0] = ti.cast(ids[0], ti.f32)
                coverage[y, x, 0, 1] = 1.0
        else:
            counts = ti.Vector([0] * SAMPLES)  # of an id, at its first sample
            for s in range(SAMPLES):
                first_sample = s
                for earlier in range(s):
                    if first_sample == s and ids[earlier] == ids[s]:
                        first_sample = earlier
                counts[first_sample] += 1
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
