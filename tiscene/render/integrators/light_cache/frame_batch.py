# SPDX-License-Identifier: Apache-2.0
"""FrameBatch: a batch of a frame's paths, traced with the light cache and corrected for movers."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.kernel_types import float8
from tiscene.device.memory import device_array, upload
from tiscene.render.integrators.incremental.mover_bounds import cluster_boxes
from tiscene.render.integrators.incremental.mover_culling import cull_rays
from tiscene.render.integrators.light_cache import mover_paths as kernels
from tiscene.render.integrators.light_cache.cells import cell
from tiscene.render.integrators.light_cache.light_cache import LightCache, distinct
from tiscene.render.integrators.light_cache.missing_cells import collect_missing
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.integrators.path.path_scene import PathScene
from tiscene.render.integrators.path.path_state import PathSamples, PathState, chunks_for
from tiscene.render.integrators.path.wavefront_kernels import accumulate
from tiscene.render.intersect.ray_queue import hit, hit_id, ray, upload_pixels
from tiscene.render.intersect.surface_interaction import geometry_of
from tiscene.render.intersect.trace import occluded
from tiscene.render.view import View
from tiscene.scene.placement import MOVERS


class FrameScene:
    """The scene of one frame, with and without its movers.

    `DeviceScene` has one tree beside those of all instances. It holds in turn what stands still and what moves.

    Args:
        paths: Path tracer.
        moving: bool [n], the movers that are present.
        still: bool [n], the other instances that are present.

    Attributes:
        has_movers: Whether there are movers.
        full: Data of the whole scene.
        moving_rows: i32 [n] on the device, 1 for movers.
        boxes: Eight boxes around the movers, see `cull_rays`.
    """

    def __init__(self, paths: PathPass, moving: NDArray[np.bool_], still: NDArray[np.bool_]) -> None:
        self._paths, self._moving, self._still = paths, moving, still
        self.has_movers = bool(moving.any())
        self.full = paths.scene_arrays()
        self.moving_rows = upload(moving.astype(np.int32))
        self.boxes = device_array(float8, 6)
        if self.has_movers:
            self.boxes.from_numpy(cluster_boxes(self.place_movers()).T.copy())

    def static(self) -> PathScene:
        """Return the data of the static scene, valid until the next call of `place_movers`."""
        if not self.has_movers:
            return self.full
        self._paths.scene.place_movers(self._still)
        return replace(self.full, tree=MOVERS)

    def place_movers(self) -> NDArray[np.float64]:
        """Build the tree of the movers; return their boxes [n, 6]."""
        return self._paths.scene.place_movers(self._moving)


class SharpShadows:
    """Shadow rays to the sharp light, in the form that `PathPass.cast_shadows` takes.

    Attributes:
        radiance: f32 [size, 3], what each path gains.
    """

    def __init__(self, size: int) -> None:
        self.first_sample = 0
        self.shadow_rays = device_array(ray, size)
        self.occluded = device_array(ti.i32, (size,))
        self.radiance = device_array(ti.f32, (size, 3))
        self.shadow_hits = device_array(hit, size), device_array(hit_id, size)
        self.shadow_queue: Any = None


class FrameBatch:
    """Traces batches of a frame's paths.

    Args:
        paths: Path tracer; its film receives the paths.
        cell_width: Width of a cell, px.
        size: Largest number of paths in a batch.
    """

    def __init__(self, paths: PathPass, cell_width: float, size: int) -> None:
        self.size = size
        self._paths, self._cell_width = paths, cell_width
        self._state = PathState(size)
        self._segments, self._replaced = device_array(ray, size), device_array(ray, size)
        self._missing, self._missing_count = device_array(cell, 2 * size), device_array(ti.i32, (1,))
        self._near, self._blocked, self._touched = (device_array(ti.i32, (size,)) for _ in range(3))
        self._chunks = device_array(ti.i32, (chunks_for(size),))
        self._sharp: Any = SharpShadows(size)
        self._retraced: PathState | None = None

    def trace(
        self,
        view: View,
        scene: FrameScene,
        cache: LightCache,
        samples: PathSamples,
        max_depth: int,
        first: int,
        count: int,
    ) -> int:
        """Trace the paths first .. first + count - 1 of the image and add them to the film.

        Args:
            view: Camera and image size.
            scene: The frame's scene.
            cache: Light of its static part.
            samples: Random numbers of the paths.
            max_depth: Largest number of segments of a path.
            first: Number of the first path, a multiple of the samples per pixel.
            count: Number of paths, likewise.

        Returns:
            The number of paths that movers may change.
        """
        paths, state, sharp = self._paths, self._state, self._sharp
        self._cache, self._keeps_rays = cache, int(scene.has_movers)
        self._touched.fill(0)
        static = scene.static()
        paths.start(view, state, first, count, samples)
        live = count
        for step in range(static.steps(max_depth)):
            cleared = [sharp.shadow_rays]
            if scene.has_movers:
                cleared += [self._segments, self._replaced, state.shadow_rays]
            for rays in cleared:
                kernels.clear_rays(rays, count)
            tested, sharp.shadow_queue = live, state.queue
            live, shadows = paths.advance(static, state, live, first, step, samples, max_depth, 1, self)
            if scene.has_movers:
                for rays in (self._segments, self._replaced, state.shadow_rays, sharp.shadow_rays):
                    self._test(scene, rays, count)
                static = scene.static()
            if shadows:
                paths.cast_shadows(static, state, shadows, first, step, samples)
            if cache.sharp_light >= 0:
                paths.cast_shadows(static, sharp, tested, first, step, samples)
                kernels.add_sharp_light(
                    sharp.shadow_queue, tested, sharp.shadow_rays, sharp.occluded, sharp.radiance, state.state
                )
            if not live:
                break
        touched = self._touched.to_numpy()[:count]
        changed = np.flatnonzero(touched.reshape(-1, samples.spp).any(axis=1)).astype(np.int32)
        if len(changed):
            self._retrace(view, scene, samples, max_depth, first, changed)
        accumulate(
            paths.pixel_filter, math.inf, paths.pixels, first, count, samples.spp, samples.index_bits, samples.key,
            state.status, state.occluded, state.state, state.features, paths.film, 0,
        )  # fmt: skip
        return int(touched.sum())

    def cells_for(
        self, scene: PathScene, state: PathState, live: int, first: int, step: int, samples: PathSamples
    ) -> tuple[Any, ...]:
        """Return the last arguments of `shade`; see `path_pass.CellLookup`. Missing cells are computed."""
        spp, bits, key = samples
        # Camera paths share a pixel's footprint, see `start_paths`.
        width = self._cell_width / max(1.0 / math.sqrt(1 << bits), 0.25)
        complete = False
        while not complete:
            self._missing_count.fill(0)
            collect_missing(
                *geometry_of(self._paths.scene), *self._cache.cells, width, self._paths.pixels, first, spp, bits, key,
                step, state.queue, live, state.rays, state.hits, state.hit_ids, state.state, state.status,
                state.first_sample,
                self._missing, self._missing_count,
            )  # fmt: skip
            count = int(self._missing_count.to_numpy()[0])
            complete = count == 0 or self._cache.add(distinct(self._missing.to_numpy()[:count]), scene)
        if self._keeps_rays:
            kernels.copy_segments(state.rays, state.hits, state.queue, live, self._segments)
        sharp = self._sharp
        return (
            *self._cache.cells, width, self._keeps_rays, self._replaced,
            self._cache.sharp_light, sharp.shadow_rays, sharp.radiance, True,
        )  # fmt: skip

    def _test(self, scene: FrameScene, rays: Any, count: int) -> None:
        """Mark the paths whose ray a mover blocks."""
        with self._paths.vector_mode():
            near = cull_rays(rays, count, scene.boxes, self._blocked, self._near, self._chunks)
        if near:
            scene.place_movers()
            occluded(self._paths.scene, MOVERS, rays, self._near, near, self._blocked)
            kernels.mark(self._near, near, self._blocked, self._touched)

    def _retrace(
        self,
        view: View,
        scene: FrameScene,
        samples: PathSamples,
        max_depth: int,
        first: int,
        changed: NDArray[np.int32],
    ) -> None:
        """Trace the paths of some pixels with and without movers, and add the difference to the batch."""
        paths, spp, state = self._paths, samples.spp, self._state
        pixels = paths.order[first // spp + changed]
        count = len(changed) * spp
        retraced = self._retraced_state(count)
        with paths.restricted_to(upload_pixels(pixels, paths.width, paths.height)):
            self._trace_all(view, scene.static(), retraced, count, samples, max_depth)
            kernels.store_radiance(count, retraced.status, retraced.occluded, retraced.state, self._without_movers)
            self._trace_all(view, scene.full, retraced, count, samples, max_depth, scene.moving_rows)
            kernels.store_radiance(count, retraced.status, retraced.occluded, retraced.state, self._with_movers)
        kernels.add_changes(
            upload(changed), count, spp, self._touched, self._visible, self._with_movers, self._without_movers,
            retraced.features, state.status, state.occluded, state.state, state.features,
        )  # fmt: skip

    def _trace_all(
        self,
        view: View,
        scene: PathScene,
        state: PathState,
        count: int,
        samples: PathSamples,
        max_depth: int,
        moving_rows: Any = None,
    ) -> None:
        """Trace paths to their ends. Note which see a mover, if `moving_rows` says what moves."""
        self._paths.start(view, state, 0, count, samples)
        live = count
        for step in range(scene.steps(max_depth)):
            live, shadows = self._paths.advance(scene, state, live, 0, step, samples, max_depth, 1)
            if step == 0 and moving_rows is not None:
                kernels.note_visible_movers(state.hit_ids, count, moving_rows, self._visible)
            if shadows:
                self._paths.cast_shadows(scene, state, shadows, 0, step, samples)
            if not live:
                break

    def _retraced_state(self, count: int) -> PathState:
        """Return path state for at least `count` retraced paths."""
        if self._retraced is None or self._retraced.size < count:
            size = min(self.size, max(count + count // 2, 1024))
            self._retraced = PathState(size)
            self._visible = device_array(ti.i32, (size,))
            self._with_movers, self._without_movers = (device_array(ti.f32, (size, 3)) for _ in range(2))
        return self._retraced
