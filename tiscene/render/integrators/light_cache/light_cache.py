# SPDX-License-Identifier: Apache-2.0
"""LightCache: the light on surfaces of one static scene, in a hash table that is filled as needed."""

from __future__ import annotations

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.memory import device_array
from tiscene.render.integrators.incremental.base_image import ProgressCallback
from tiscene.render.integrators.light_cache import fill_kernels as kernels
from tiscene.render.integrators.light_cache.cells import KEY1, KEY2, VALUE_COLUMNS, Cells, cell
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.integrators.path.path_scene import PathScene
from tiscene.render.integrators.path.path_state import PathSamples, PathState
from tiscene.render.integrators.path.wavefront_kernels import compact
from tiscene.render.intersect.ray_queue import hit, hit_id, pixel, ray
from tiscene.render.intersect.trace import closest
from tiscene.render.sampling.sobol import frame_key, index_bits
from tiscene.scene.light_description import DistantLight
from tiscene.scene.lights.light_table import LightTable

CELLS_FRAME = -7  # frame number of the random numbers of cells
FILL_PATHS = 1 << 17  # paths in flight while cells are filled
LEAST_CAPACITY = 1 << 16  # slots
SLOT_BYTES = 4 * (2 + VALUE_COLUMNS)
PROGRESS_CELLS = 4 * FILL_PATHS  # fewer paths are not reported

SHARP = 0.1  # rad, largest angle of a light whose shadows are sharp

CellRows = NDArray[np.int32]  # [n, CELL_COLUMNS], see `cells`


class LightCache:
    """Light that arrives on the surfaces of one static scene.

    Args:
        paths: Path tracer of the scene, of any size.
        seed: Seed of the random numbers.
        spp: Paths per cell.
        max_depth: Largest number of segments of a path, that from the camera to the cell included.
        memory_limit: Limit of the table's memory, bytes. When it is full all cells are dropped.
        progress: Called with "light cache" and the completed fraction, where it takes long.

    Attributes:
        sharp_light: Row of the light that is not in the cells, see the function of this name.
        cells: The table on the device.
        count: Number of cells in the table.
    """

    def __init__(
        self, paths: PathPass, *, seed: int, spp: int, max_depth: int, memory_limit: int, progress: ProgressCallback
    ) -> None:
        self._paths = paths
        self._samples = PathSamples(spp, index_bits(spp), frame_key(seed, CELLS_FRAME))
        self._max_depth = max_depth
        self.sharp_light = sharp_light(paths.scene.lights)
        self._progress = progress
        # Tables are at most half full, and their capacities are powers of two.
        self.limit = max(memory_limit // SLOT_BYTES // 4, LEAST_CAPACITY // 2)
        self._state: PathState | None = None
        self.clear()

    def clear(self) -> None:
        """Drop all cells."""
        self.count = 0
        self.cells = _table(LEAST_CAPACITY)

    @property
    def bytes(self) -> int:
        """Memory of the table."""
        return int(self.cells.keys.shape[0]) * SLOT_BYTES

    def add(self, missing: CellRows, scene: PathScene) -> bool:
        """Compute the light of cells that the table lacks, and insert them.

        Args:
            missing: Distinct cells.
            scene: Data of the static scene.

        Returns:
            False if the table was too full and has been cleared; then nothing was added. A table that is empty takes
            as many of the cells as fit.
        """
        if self.count + len(missing) > self.limit:
            if self.count:
                self.clear()
                return False
            missing = missing[: self.limit]
        self._reserve(self.count + len(missing))
        step = max(1, FILL_PATHS // max(self._samples.spp, kernels.PROBES))
        reports = len(missing) * self._samples.spp >= PROGRESS_CELLS
        for begin in range(0, len(missing), step):
            if reports:
                self._progress("light cache", begin / len(missing))
            self._compute(missing[begin : begin + step], scene)
        if reports:
            self._progress("light cache", 1.0)
        return True

    def _reserve(self, count: int) -> None:
        """Make the table large enough for `count` cells."""
        capacity = int(self.cells.keys.shape[0])
        if 2 * count > capacity:
            while 2 * count > capacity:
                capacity *= 2
            old, self.cells = self.cells, _table(capacity)
            kernels.reinsert(*old, *self.cells)

    def _compute(self, rows: CellRows, scene: PathScene) -> None:
        """Trace the paths of some cells, and insert the cells."""
        paths, (spp, bits, key), count = self._paths, self._samples, len(rows)
        if self._state is None:
            self._state = PathState(FILL_PATHS)
            self._probe_rays = device_array(ray, FILL_PATHS)
            self._probe_hits, self._probe_ids = device_array(hit, FILL_PATHS), device_array(hit_id, FILL_PATHS)
        state = self._state
        cells, pixels = device_array(cell, count), device_array(pixel, count)
        cells.from_numpy(np.ascontiguousarray(rows))
        values = device_array(ti.f32, (count, VALUE_COLUMNS))
        probes = count * kernels.PROBES
        kernels.probe_rays(cells, count, self._probe_rays, state.queue, pixels, bits)
        closest(
            paths.scene, scene.tree, self._probe_rays, state.queue, probes, self._probe_hits, self._probe_ids,
            coherent=False,
        )  # fmt: skip
        total = count * spp
        with paths.restricted_to(pixels):
            with paths.vector_mode():
                kernels.start_cell_paths(
                    *scene.arrays, cells, 0, total, spp, bits, key, self.sharp_light, pixels,
                    self._probe_rays, self._probe_hits, self._probe_ids,
                    state.rays, state.shadow_rays, state.state, state.status, state.queue, scene.any_emission,
                )  # fmt: skip
            counts = compact(state.status, state.queue, total, state.next_queue, state.shadow_queue, state.chunks)
            state.swap_queues()
            live, shadows = counts & 0xFFFFFFFF, counts >> 32
            for step in range(1, scene.steps(self._max_depth) + 1):
                if shadows:
                    paths.cast_shadows(scene, state, shadows, 0, step - 1, self._samples)
                if not live or step == scene.steps(self._max_depth):
                    break
                live, shadows = paths.advance(scene, state, live, 0, step, self._samples, self._max_depth, 1)
        kernels.mean_of_paths(0, count, spp, state.status, state.occluded, state.state, values)
        kernels.insert(cells, values, count, *self.cells)
        self.count += count


def distinct(rows: CellRows) -> CellRows:
    """Return each cell once, in the order of their keys."""
    keys = rows[:, KEY1].astype(np.int64) << 32 | rows[:, KEY2].astype(np.uint32).astype(np.int64)
    _, first = np.unique(keys, return_index=True)
    return np.ascontiguousarray(rows[first])


def _table(capacity: int) -> Cells:
    cells = Cells(device_array(ti.i32, (capacity, 2)), device_array(ti.f32, (capacity, VALUE_COLUMNS)))
    cells.keys.fill(0)
    return cells


def sharp_light(lights: LightTable) -> int:
    """Return the row of the brightest light at infinity that casts sharp shadows, -1 for none.

    Its light is sampled at every pixel, since cells would blur its shadows.
    """
    rows = [
        (max(light.irradiance), int(row))
        for light, row in zip(lights.lights, lights.rows(), strict=True)
        if isinstance(light, DistantLight) and light.angle <= SHARP and light.casts_shadows
    ]
    return max(rows)[1] if rows else -1
