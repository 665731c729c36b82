# SPDX-License-Identifier: Apache-2.0
"""The replay pass: a frame as a base image and what its movers change of the light.

One base image of all that stands still, at many samples a pixel, and a few paths a pixel through the same, kept. In a
frame the same paths bring the same light but where a mover is in the way of a ray: only there is a path traced again,
with the same random numbers, and the difference added. The expectation is that of path tracing, for any one frame, with
no memory of others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.kernel_types import float8
from tiscene.device.memory import device_array, upload
from tiscene.errors import ArgumentError
from tiscene.render.integrators.incremental import retrace_kernels as kernels
from tiscene.render.integrators.incremental.base_image import (
    IncrementalBase,
    ProgressCallback,
    base_image,
    standing,
    under_group,
)
from tiscene.render.integrators.incremental.base_image_cache import BaseImageCache, digest_of
from tiscene.render.integrators.incremental.base_lights import BaseLights
from tiscene.render.integrators.incremental.changed_regions import Region, changed_regions
from tiscene.render.integrators.incremental.cost_estimate import Probe
from tiscene.render.integrators.incremental.mover_coverage import NO_MOVER_NEAR, SUBPIXELS, MoverCoverage
from tiscene.render.integrators.incremental.mover_culling import find_near
from tiscene.render.integrators.incremental.outlier_filter import filter_outliers
from tiscene.render.integrators.incremental.path_cache import Block, PathCache, room_for
from tiscene.render.integrators.incremental.selected_paths import Selection
from tiscene.render.integrators.path.path_pass import PathImage, PathPass, PathScene
from tiscene.render.integrators.path.path_state import PathState, chunks_for
from tiscene.render.intersect.trace import occluded
from tiscene.render.sampling.sobol import frame_key, index_bits
from tiscene.render.view import View
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT, MOVERS, Placement

# What stands for the frame in the keys of random numbers.
CACHED_PATHS_FRAME, MOVER_OPACITY_FRAME, EXTRA_PATHS_FRAME, EXTRA_OPACITY_FRAME = -2, -3, -5, -6
SINGLE_PIXEL_SPP = 1 << 30  # as many samples a pixel: the row alone tells rays apart
BOXES = 8  # rays are tested against so many boxes about the movers before they are traced
EMPTY_BOUND = 1e30
CACHE_BYTES = 1 << 30
MAX_PROBES = 16
# Where movers cut more of the paths than this, a picture from nothing is as cheap and may have less noise.
MAX_INVALIDATED = 0.75


@dataclass(frozen=True, eq=False)
class IncrementalImage(PathImage):
    """even: for the denoiser, `hdr` without lone spikes, the edges of movers smooth, and as much noise everywhere as
    becomes it. base: what it is a difference to.
    factors: float32 [groups, 3], how much of its light each group of the base's lights gives.
    unmoved: float32 [h, w, 1], 1 where no mover has come into the pixel itself, else 0. bounding_regions: rows and columns of
    rectangles outside of which little has changed.
    """

    filtered: NDArray[np.float32]
    base: IncrementalBase
    factors: NDArray[np.float32]
    static_mask: NDArray[np.float32]
    changed_regions: Sequence[Region]


class IncrementalPass:
    """Renders radiance of a DeviceScene in which only some instances move, seen by a camera that stands still."""

    def __init__(
        self,
        scene: DeviceScene,
        width: int,
        height: int,
        *,
        memory_limit: int = CACHE_BYTES,
        images: BaseImageCache | None = None,
        progress: ProgressCallback | None = None,
        paths: PathPass | None = None,
    ) -> None:
        """memory_limit: bytes that the kept paths may take; where it is tight there are fewer a pixel.

        images: where base images are kept between runs; None: nowhere. progress: called with what is being made and how
        much of it is done, 0..1. paths: the path pass to use, of the same size.
        """
        self.scene = scene
        self.width, self.height = width, height
        self.memory_limit = memory_limit
        self._images = images
        self._progress = progress or (lambda doing, done: None)
        self._paths = paths or PathPass(scene, width, height)
        self._bases: dict[tuple[Any, ...], IncrementalBase] = {}  # the one used last at the end
        self._probes: dict[tuple[Any, ...], tuple[Probe, _Scratch]] = {}  # the one used last at the end
        self._scratch: _Scratch | None = None
        self._selection = Selection()
        self._boxes = device_array(float8, 6)
        self._paths_on_way: PathState | None = None

    @property
    def cached_bytes(self) -> int:
        """What all kept paths take of memory."""
        return sum(base.bytes for base in self._bases.values())

    @property
    def cached_spp(self) -> int:
        """How many paths a pixel are kept of the base that was prepared last."""
        return next(reversed(self._bases.values())).cache.numbers[0] if self._bases else 0

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
        """Make the base image and the paths of what does not move, unless they are at hand.

        They depend on the arguments alone. Places what it needs: the frame's instances are to be placed afterwards.
        moving: bool [n], which instances are not in the base. spp: paths per pixel to keep; base_spp: to make the base
        image of. near_spp: how many more to keep for the pixels in which a mover will be seen.
        """
        still = placement.present[CURRENT] & ~moving
        key = (*self._key(view, placement, still), seed, spp, max_depth, base_spp, near_spp)
        base = self._bases.pop(key, None)
        if base is None:
            left = standing(placement, moving)
            image = base_image(
                self._paths, self._images, self._progress, view, left, seed=seed, spp=base_spp, max_depth=max_depth
            )
            self._progress("paths", 0.0)
            self.scene.place(left)
            lights = BaseLights(self.scene, placement.light_groups)
            self._state(max(spp, near_spp))  # enough for both
            keys = frame_key(seed, CACHED_PATHS_FRAME), frame_key(seed, MOVER_OPACITY_FRAME)
            cache = self._kept_paths(view, lights, keys, spp, max_depth, self.memory_limit)
            near, rest = None, self.memory_limit - cache.bytes
            if near_spp and rest > cache.bytes // cache.numbers[0]:
                keys = frame_key(seed, EXTRA_PATHS_FRAME), frame_key(seed, EXTRA_OPACITY_FRAME)
                near = self._kept_paths(view, lights, keys, near_spp, max_depth, rest)
            looks = MoverCoverage(self.scene, view, cache.order, cache.pixels)
            base = IncrementalBase(lights, image, cache, looks, near)
            self._progress("paths", 1.0)
            while self._bases and self.cached_bytes + base.bytes > self.memory_limit:
                self._bases.pop(next(iter(self._bases)))
            for each in (cache, near):
                if each and (self._scratch is None or not self._scratch.fits(each, looks.rows)):
                    self._scratch = _Scratch(each, looks.rows)
        self._bases[key] = base

    def pays(self, view: View, placement: Placement, moving: NDArray[np.bool_], *, seed: int, max_depth: int) -> bool:
        """Whether the movers leave enough paths alone for a difference to cost less than a picture from nothing.

        It depends on the arguments alone, and on no number that a picture is made of. Arguments as of `prepare`, which
        is not needed before. Places the frame's instances at CURRENT.
        """
        still = placement.present[CURRENT] & ~moving
        key = (*self._key(view, placement, still), seed, max_depth)
        probe = self._probes.pop(key, None)
        if probe is None:
            self.scene.place(standing(placement, moving))
            cache = Probe(self._paths, self._paths.scene_arrays(), view, seed, max_depth)
            probe = cache, _Scratch(cache.cache)
        self._probes[key] = probe
        if len(self._probes) > MAX_PROBES:
            del self._probes[next(iter(self._probes))]
        self.scene.place(placement)
        paths, scratch = probe
        self._test(paths.block.rays, paths.block.rows, self._groups(moving), scratch)
        return paths.cut_share(scratch.cut) <= MAX_INVALIDATED

    def render(self, moving: NDArray[np.bool_]) -> IncrementalImage:
        """The picture of what the scene has placed at CURRENT, which was prepared for.

        moving: bool [n], which instances are not in the base.
        """
        scratch = self._scratch
        if scratch is None:
            raise ArgumentError("nothing is prepared; call prepare() first")
        base = next(reversed(self._bases.values()))
        cache = base.cache
        groups = self._groups(moving)
        lit = self.scene.placement.light_groups
        factors = np.ones((1, 3), np.float32) if lit is None else lit.factors
        scene = self._paths.scene_arrays(base.lights.shining(factors))
        for block in cache.blocks:
            self._replay(scene, cache, block, cache.pixels, factors, scratch, groups)
        by_looks = base.spp < SUBPIXELS and base.looks.sharp and self._paths.pixel_filter_name == "box"
        looks = base.looks.covered(lambda rays, count: self._test(rays, count, groups, scratch), scratch.cut, by_looks)
        if base.near:
            near = np.flatnonzero(looks.ravel()[cache.order] != NO_MOVER_NEAR)
            for block, pixels in self._selection.blocks(base.near, near):
                with self._paths.restricted_to(pixels):
                    self._replay(scene, base.near, block, pixels, factors, scratch, groups, cache.numbers[0])
        hdr, drawn, albedo, normal = (np.empty((self.height, self.width, 3), np.float32) for _ in range(4))
        unmoved = np.empty((self.height, self.width, 1), np.float32)
        kernels.combine(
            self.width, self.height, looks, int(by_looks), scratch.change, scratch.met, factors,
            base.mean, base.image, base.rough, hdr, drawn, albedo, normal, unmoved,
        )  # fmt: skip
        even = filter_outliers(scratch.change, drawn)
        bounding_regions = changed_regions(scratch.change, drawn, even, unmoved)
        return IncrementalImage(hdr, albedo, normal, even, base, factors, unmoved, bounding_regions)

    def _key(self, view: View, placement: Placement, still: NDArray[np.bool_]) -> tuple[Any, ...]:
        """What tells the bases of one scene apart."""
        materials, groups = self.scene.materials, placement.light_groups
        lights = self.scene.lights.lights if placement.lights is None else placement.lights
        return (
            view.rows()[CURRENT].tobytes(),
            np.flatnonzero(still).tobytes(),
            placement.mesh[still].tobytes(),
            placement.world_from_object[CURRENT, still].tobytes(),
            digest_of(lights if groups is None else [groups.lights, groups.group]),
            materials.any_coverage,
            materials.any_emission,
        )

    def _groups(self, moving: NDArray[np.bool_]) -> Any:
        """Boxes about what moves, of what is placed at CURRENT; its tree is built."""
        self._boxes.from_numpy(cluster_boxes(self.scene.place_movers(moving)).T.copy())
        return self._boxes

    def _test(self, rays: Any, count: int, groups: Any, scratch: _Scratch) -> int:
        """Whether a mover is in the way of each of the rays: scratch.cut. Returns how many came near one."""
        with self._paths.vector_mode():
            near = find_near(rays, count, groups, scratch.cut, scratch.candidates, scratch.row_chunks)
        if near:
            occluded(self.scene, MOVERS, rays, scratch.candidates, near, scratch.cut)
        return int(near)

    def _look_through(self, scene: PathScene, cache: PathCache, block: Block, near: int, scratch: _Scratch) -> None:
        """Let light through movers that are only partly there.

        The base let it through what stands still; the movers' own chances are drawn apart from that.
        """
        s = cache.state
        count = kernels.find_cut_shadows(
            scratch.candidates, near, block.rays, scratch.cut, scratch.shadow_rows, scratch.row_chunks
        )
        for begin in range(0, count, s.size):
            rays = min(s.size, count - begin)
            kernels.copy_rays(scratch.shadow_rows, begin, rays, block.rays, s.shadow_rays, s.shadow_queue)
            self._paths.cast_shadows(
                scene, s, rays, begin, block.number, (SINGLE_PIXEL_SPP, 0, cache.movers_key), tree=MOVERS
            )
            kernels.note_answers(scratch.shadow_rows, begin, rays, s.occluded, scratch.cut)

    def _replay(
        self,
        scene: PathScene,
        cache: PathCache,
        block: Block,
        pixels: Any,
        factors: NDArray[np.float32],
        scratch: _Scratch,
        groups: Any,
        others: int = 0,
    ) -> None:
        """Add what the movers change of a block's pixels to scratch.change, the mean of so many other paths."""
        s, first = cache.state, block.first
        steps = cache.steps
        near = self._test(block.rays, block.rows, groups, scratch)
        if scene.any_coverage and near:
            self._look_through(scene, cache, block, near, scratch)
        starts = np.zeros(steps + 1, np.int32)
        kernels.settle(
            block.count, steps, block.offsets, block.rays, block.light, factors, block.restore, scratch.cut,
            s.rays, s.state, s.features, s.status,
            scratch.difference, scratch.cut_at, scratch.path_chunks, scratch.entering, starts,
        )  # fmt: skip
        live = 0
        for step in range(steps):
            begin, end = int(starts[step]), int(starts[step + 1])
            kernels.join(scratch.entering, begin, end, s.queue, live)
            live += end - begin
            if live:
                live, casts = self._paths.advance(scene, s, live, first, step, cache.numbers, cache.max_depth, 1)
                if casts:
                    self._paths.cast_shadows(scene, s, casts, first, step, cache.numbers)
        kernels.collect(
            pixels, first, block.count, cache.numbers[0], scratch.cut_at, block.restore, block.features,
            s.status, s.occluded, s.state, s.features, scratch.difference, others, scratch.change, scratch.met,
        )  # fmt: skip

    def _kept_paths(
        self, view: View, lights: BaseLights, keys: tuple[int, int], spp: int, max_depth: int, limit: int
    ) -> PathCache:
        """As many paths a pixel as are asked for, or half of them and so on until they fit. limit: bytes."""
        scenes = [under_group(self._paths, group, lights) for group in range(lights.groups)]
        key, movers_key = keys

        def cache(spp: int) -> PathCache:
            numbers = (spp, index_bits(spp), key)
            return PathCache(
                self._paths, scenes, view, self._state(spp), numbers=numbers, movers_key=movers_key, max_depth=max_depth
            )

        steps = scenes[0].steps(max_depth)
        most = (1 + lights.groups) * steps * 80 * self.width * self.height  # no path can take more
        if spp > 1 and spp * most > limit:
            each = cache(1).bytes
            while spp > 1 and spp * each > limit:
                spp = -(-spp // 2)
        return cache(spp)

    def _state(self, spp: int) -> PathState:
        """Room for a block of paths on their way; all caches use the same."""
        size = room_for(self.width * self.height, spp)
        if self._paths_on_way is None or self._paths_on_way.size < size:
            self._paths_on_way = PathState(size)
        return self._paths_on_way


class _Scratch:
    """Arrays of a frame, which all blocks use one after another."""

    def __init__(self, cache: PathCache, looks: int = 0) -> None:
        rows = self.rows = max(cache.most_rows, looks)
        self.steps, self.size = cache.steps, cache.state.size
        paths = cache.state.size
        self.cut = device_array(ti.i32, (rows,))
        self.candidates = device_array(ti.i32, (rows,))
        self.shadow_rows = device_array(ti.i32, (rows,))
        self.row_chunks = device_array(ti.i32, (chunks_for(rows),))
        self.difference = device_array(ti.f32, (paths, 3))
        self.cut_at = device_array(ti.i32, (paths, 2))
        self.path_chunks = device_array(ti.i32, (chunks_for(paths), cache.steps))
        self.entering = device_array(ti.i32, (paths,))
        pixels = int(cache.mean.shape[0])
        self.change = upload(np.zeros((pixels, kernels.CORRECTION_COLUMNS), np.float32))
        self.met = upload(np.zeros((pixels, kernels.MOVER_COLUMNS), np.float32))

    def fits(self, cache: PathCache, looks: int) -> bool:
        """Whether there is room for the blocks of another cache of pictures of this size."""
        return self.rows >= max(cache.most_rows, looks) and self.steps >= cache.steps and self.size >= cache.state.size


def cluster_boxes(boxes: NDArray[np.float64]) -> NDArray[np.float32]:
    """BOXES boxes that hold all of the boxes [n, 6]: neighbors along the axis on which they are spread most.

    They are a little larger than what they hold, as float32 [BOXES, 6]; those that are left over hold nothing.
    """
    result = np.repeat(np.array([[EMPTY_BOUND] * 3 + [-EMPTY_BOUND] * 3], np.float32), BOXES, axis=0)
    if len(boxes):
        centers = 0.5 * (boxes[:, :3] + boxes[:, 3:])
        axis = int(np.argmax(np.ptp(centers, axis=0)))
        order = np.argsort(centers[:, axis], kind="stable")
        margin = 1e-5 * np.abs(boxes).max() + 1e-6
        for row, group in enumerate(np.array_split(order, min(BOXES, len(boxes)))):
            result[row, :3] = boxes[group, :3].min(axis=0) - margin
            result[row, 3:] = boxes[group, 3:].max(axis=0) + margin
    return result
