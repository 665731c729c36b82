# SPDX-License-Identifier: Apache-2.0
"""The incremental pass: radiance of a frame as a base image of the static scene plus the changes by movers.

Prepared once per static scene, camera and set of lights (`IncrementalPass.prepare`): a base image at many samples per
pixel, and a few cached paths per pixel through the same scene. Per frame (`IncrementalPass.render`):

1. All recorded rays of the cached paths are tested against the movers alone.
2. Light on blocked rays is subtracted. Paths with a blocked segment are traced again from there, in the scene with the
   movers and with the same random numbers; their light is added.
3. The mean change of each pixel's paths corrects the base image, which acts as a control variate.

The expectation equals that of path tracing. Every frame is a function of its own inputs, not of previous frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynamics.lru_cache import LRUCache
from tiscene.errors import ArgumentError
from tiscene.render.integrators.incremental import retrace_kernels as kernels
from tiscene.render.integrators.incremental.base_image import (
    IncrementalBase,
    ProgressCallback,
    base_placement,
    no_progress,
    render_base_image,
    scene_under_group,
    static_scene_key,
)
from tiscene.render.integrators.incremental.base_image_cache import BaseImageCache
from tiscene.render.integrators.incremental.base_lights import BaseLights
from tiscene.render.integrators.incremental.changed_regions import Region, changed_regions
from tiscene.render.integrators.incremental.cost_estimate import ProbePaths
from tiscene.render.integrators.incremental.frame_scratch import FrameScratch
from tiscene.render.integrators.incremental.mover_coverage import NO_MOVER_NEAR, SUBPIXELS, MoverCoverage
from tiscene.render.integrators.incremental.outlier_filter import filter_outliers
from tiscene.render.integrators.incremental.path_cache import PathCache, state_size
from tiscene.render.integrators.incremental.path_retracer import PathRetracer
from tiscene.render.integrators.incremental.selected_paths import PathSelection
from tiscene.render.integrators.path.path_image import PathImage
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.integrators.path.path_state import PathSamples, PathState
from tiscene.render.sampling.sobol import frame_key, index_bits
from tiscene.render.view import View
from tiscene.scene.placement import CURRENT, Placement

# Frame numbers of the random numbers of cached paths, and of shadow rays through partially opaque movers.
CACHED_PATHS_FRAME, MOVER_OPACITY_FRAME, EXTRA_PATHS_FRAME, EXTRA_OPACITY_FRAME = -2, -3, -5, -6
CACHE_BYTES = 1 << 30
MAX_PROBES = 16
# If movers invalidate more of the paths than this, path tracing costs no more and may have less noise.
MAX_INVALIDATED = 0.75


@dataclass(frozen=True, eq=False)
class IncrementalImage(PathImage):
    """Images of an incremental frame, and what its denoiser needs.

    Attributes:
        filtered: Radiance for the denoiser, float32 [h, w, 3]: `hdr` with smooth mover edges, without isolated
            outliers, and with uniform noise.
        base: The base.
        factors: float32 [groups, 3], intensity of each light group.
        static_mask: float32 [h, w, 1], 1 where no mover is visible, else 0.
        changed_regions: Rectangles that contain everything that differs much from the base image.
    """

    filtered: NDArray[np.float32]
    base: IncrementalBase
    factors: NDArray[np.float32]
    static_mask: NDArray[np.float32]
    changed_regions: Sequence[Region]


class IncrementalPass:
    """Renders radiance of a DeviceScene in which some instances move, before a static camera.

    Args:
        paths: Path tracer of the image size.
        memory_limit: Limit of the cached paths' memory, bytes; if necessary fewer paths per pixel are cached.
        images: Disk cache of base images; None: none.
        progress: Called with the name of a stage and its completed fraction, 0..1.
    """

    def __init__(
        self,
        paths: PathPass,
        *,
        memory_limit: int = CACHE_BYTES,
        images: BaseImageCache | None = None,
        progress: ProgressCallback = no_progress,
    ) -> None:
        self.scene = paths.scene
        self.width, self.height = paths.width, paths.height
        self._memory_limit = memory_limit
        self._images, self._progress = images, progress
        self._paths = paths
        self._bases: dict[tuple[Any, ...], IncrementalBase] = {}  # least recently used first
        self._probes: LRUCache[tuple[Any, ...], ProbePaths] = LRUCache(MAX_PROBES)
        self._scratch: FrameScratch | None = None
        self._selection = PathSelection()
        self._retracer = PathRetracer(self._paths)
        self._path_state: PathState | None = None

    @property
    def cached_bytes(self) -> int:
        """Memory of all cached paths."""
        return sum(base.bytes for base in self._bases.values())

    def prepare(
        self,
        view: View,
        placement: Placement,
        moving: NDArray[np.bool_],
        *,
        seed: int,
        spp: int,
        max_depth: int,
        base_spp: int,
        near_spp: int = 0,
    ) -> None:
        """Make the base of the static scene, unless it is in memory. Afterwards the frame must be placed again.

        The base is a function of the arguments alone.

        Args:
            view: Camera and image size.
            placement: Placement of a frame.
            moving: bool [n], the instances that are not in the base.
            seed: Seed of the random numbers.
            spp: Cached paths per pixel.
            max_depth: Largest number of segments of a path.
            base_spp: Samples per pixel of the base image.
            near_spp: Further cached paths per pixel, for pixels in which a mover will be visible.
        """
        key = self._key(view, placement, moving, seed, spp, max_depth, base_spp, near_spp)
        base = self._bases.pop(key, None)
        if base is None:
            static = base_placement(placement, moving)
            image = render_base_image(
                self._paths, self._images, self._progress, view, static, seed=seed, spp=base_spp, max_depth=max_depth
            )
            self._progress("paths", 0.0)
            self.scene.place(static)
            lights = BaseLights(self.scene, placement.light_groups)
            self._state(max(spp, near_spp))  # one allocation for both caches
            keys = frame_key(seed, CACHED_PATHS_FRAME), frame_key(seed, MOVER_OPACITY_FRAME)
            cache = self._cache_paths(view, lights, keys, spp, max_depth, self._memory_limit)
            extra_cache, remaining = None, self._memory_limit - cache.bytes
            if near_spp and remaining > cache.bytes // cache.spp:
                keys = frame_key(seed, EXTRA_PATHS_FRAME), frame_key(seed, EXTRA_OPACITY_FRAME)
                extra_cache = self._cache_paths(view, lights, keys, near_spp, max_depth, remaining)
            coverage = MoverCoverage(self.scene, view, cache.order, cache.pixels)
            base = IncrementalBase(lights, image, cache, coverage, extra_cache)
            self._progress("paths", 1.0)
            while self._bases and self.cached_bytes + base.bytes > self._memory_limit:
                self._bases.pop(next(iter(self._bases)))
        self._bases[key] = base
        # For all bases in memory: one that returns may need more room than the one made last.
        caches = [cache for each in self._bases.values() for cache in each.caches]
        rows = max(each.coverage.max_rows for each in self._bases.values())
        if self._scratch is None or not self._scratch.fits(caches, rows):
            self._scratch = FrameScratch(caches, rows)

    def is_cheaper(
        self, view: View, placement: Placement, moving: NDArray[np.bool_], *, seed: int, max_depth: int
    ) -> bool:
        """Return whether movers leave enough paths valid for an incremental frame to cost less than path tracing.

        A function of the arguments alone, which are those of `prepare`; it uses random numbers of no image. Places the
        frame's instances at CURRENT. `prepare` need not be called before.
        """

        def new() -> ProbePaths:
            self.scene.place(base_placement(placement, moving))
            return ProbePaths(self._paths, self._paths.scene_arrays(), view, seed, max_depth)

        probes = self._probes.get(self._key(view, placement, moving, seed, max_depth), new)
        self.scene.place(placement)
        self._retracer.place_movers(moving)
        self._retracer.test(probes.block.rays, probes.block.rows, probes.scratch)
        return probes.invalidated_fraction() <= MAX_INVALIDATED

    def render(self, moving: NDArray[np.bool_]) -> IncrementalImage:
        """Render what the scene has placed at CURRENT, over the base prepared last.

        Args:
            moving: bool [n], the instances that are not in the base, as for `prepare`.

        Raises:
            ArgumentError: If no base is prepared.
        """
        base, scratch = self._prepared()
        self._retracer.place_movers(moving)
        factors = self.scene.placement.light_factors
        scene = self._paths.scene_arrays(base.lights.scaled(factors))
        for block in base.cache.blocks:
            self._retracer.retrace(scene, base.cache, block, base.cache.pixels, factors, scratch)
        use_coverage = base.mover_spp < SUBPIXELS and base.coverage.sharp and self._paths.pixel_filter_name == "box"
        covered = self._count_covered(use_coverage)
        if base.extra_cache:
            near = np.flatnonzero(covered.ravel()[base.cache.order] != NO_MOVER_NEAR)
            for block, pixels in self._selection.blocks(base.extra_cache, near):
                with self._paths.restricted_to(pixels):
                    self._retracer.retrace(scene, base.extra_cache, block, pixels, factors, scratch, base.cache.spp)
        hdr, denoiser_input, albedo, normal = (np.empty((self.height, self.width, 3), np.float32) for _ in range(4))
        static_mask = np.empty((self.height, self.width, 1), np.float32)
        kernels.compose(
            self.width, self.height, covered, int(use_coverage), scratch.correction, scratch.mover_sums, factors,
            base.mean, base.image, base.noise_matched, hdr, denoiser_input, albedo, normal, static_mask,
        )  # fmt: skip
        filtered = filter_outliers(scratch.correction, denoiser_input)
        regions = changed_regions(scratch.correction, denoiser_input, filtered, static_mask)
        return IncrementalImage(hdr, albedo, normal, filtered, base, factors, static_mask, regions)

    def _key(self, view: View, placement: Placement, moving: NDArray[np.bool_], *numbers: int) -> tuple[Any, ...]:
        """Return what distinguishes the static scene before a camera from others, with further numbers."""
        still = placement.present[CURRENT] & ~moving
        return (view.rows()[CURRENT].tobytes(), *static_scene_key(self.scene, placement, still), *numbers)

    def _prepared(self) -> tuple[IncrementalBase, FrameScratch]:
        if self._scratch is None:
            raise ArgumentError("no base image is prepared: call prepare() first")
        return next(reversed(self._bases.values())), self._scratch

    def _count_covered(self, all_subpixels: bool) -> NDArray[np.int32]:
        base, scratch = self._prepared()
        return base.coverage.count(
            lambda rays, count: self._retracer.test(rays, count, scratch), scratch.blocked, all_subpixels
        )

    def _cache_paths(
        self, view: View, lights: BaseLights, keys: tuple[int, int], spp: int, max_depth: int, limit: int
    ) -> PathCache:
        """Cache `spp` paths per pixel; halve their number until they fit into `limit` bytes."""
        scenes = [scene_under_group(self._paths, group, lights) for group in range(lights.groups)]
        key, mover_key = keys

        def cache(spp: int) -> PathCache:
            samples = PathSamples(spp, index_bits(spp), key)
            return PathCache(
                self._paths, scenes, view, self._state(spp), samples=samples, mover_key=mover_key, max_depth=max_depth
            )

        steps = scenes[0].steps(max_depth)
        # A segment takes 88 bytes, the shadow ray of a group 44.
        upper_bound = (88 + 44 * lights.groups) * steps * self.width * self.height
        if spp > 1 and spp * upper_bound > limit:
            bytes_per_sample = cache(1).bytes
            while spp > 1 and spp * bytes_per_sample > limit:
                spp = -(-spp // 2)
        return cache(spp)

    def _state(self, spp: int) -> PathState:
        """Return path state arrays for a block, shared by all caches."""
        size = state_size(self.width * self.height, spp)
        if self._path_state is None or self._path_state.size < size:
            self._path_state = PathState(size)
        return self._path_state
