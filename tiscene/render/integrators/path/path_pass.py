# SPDX-License-Identifier: Apache-2.0
"""The path pass: radiance by path tracing with next-event estimation, in waves of kernels over batches of paths."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.device.memory import upload
from tiscene.device.vector_mode import vector_mode
from tiscene.errors import ArgumentError
from tiscene.render.bsdfs.energy_tables import energy_tables
from tiscene.render.integrators.path import wavefront_kernels as kernels
from tiscene.render.integrators.path.last_segment import finish
from tiscene.render.integrators.path.path_state import CHUNK, FILM_COLUMNS, PathState
from tiscene.render.integrators.path.shading import SceneArrays, shade
from tiscene.render.integrators.path.shadow_rays import pass_shadows
from tiscene.render.intersect.ray_queue import tiled_order, upload_pixels
from tiscene.render.intersect.surface_interaction import geometry_of
from tiscene.render.intersect.trace import closest, occluded
from tiscene.render.sampling.pixel_filter import pixel_filter as pixel_filter_named
from tiscene.render.sampling.sobol import frame_key, index_bits
from tiscene.render.view import SKY, View
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.lights.light_table import LightArrays
from tiscene.scene.placement import CURRENT

FloatImage = NDArray[np.float32]

# Paths in flight. Fewer would stay in a CPU's cache, but threads then wait for each other more often: measured, 2^15
# takes a third longer than this.
BATCH_SIZE = 1 << 20
# A path passes through so many partly absent surfaces for nothing; each further one costs it a bounce.
FREE_PASSES = 16


@dataclass(frozen=True, eq=False)
class PathImage:
    """Float32 [height, width, 3] images, means over the samples of each pixel.

    hdr: scene-linear Rec.709 radiance. albedo (0..1), normal (world, unit before the mean): of the first thing seen
    that is not a mirror or clear glass, for the denoiser.
    """

    hdr: FloatImage
    albedo: FloatImage
    normal: FloatImage


class PathPass:
    """Renders radiance of what a DeviceScene has placed at CURRENT.

    background: what camera rays see where nothing is, that of the view rendered last.
    nonfinite: how many samples of the last picture were infinite or not numbers; they are left out of the means.
    """

    def __init__(
        self,
        scene: DeviceScene,
        width: int,
        height: int,
        batch_size: int | None = None,
        *,
        pixel_filter: str = "box",
        clamp: float | None = None,
    ) -> None:
        """batch_size: paths in flight; no effect on any byte of the result. pixel_filter: of `PIXEL_FILTERS`.

        clamp: the most that a path brings in any channel, W/m²/sr, which takes light away; None: all of it.
        """
        if width < 1 or height < 1:
            raise ArgumentError(f"a picture of {width}x{height} pixels: both must be at least 1")
        self.scene = scene
        self.width = width
        self.height = height
        self.nonfinite = 0
        self.background = SKY
        self._batch_size = batch_size or BATCH_SIZE
        self._state: PathState | None = None
        self.pixel_filter_name = pixel_filter
        self.pixel_filter = upload(pixel_filter_named(pixel_filter).table())
        self._clamp = math.inf if clamp is None else clamp
        self._pixels = upload_pixels(tiled_order(width, height), width, height)
        self._film = upload(np.zeros((width * height, FILM_COLUMNS), np.float32))
        self._energy: Any = None
        self._energy_iors: tuple[float, ...] | None = None

    def render(
        self,
        view: View,
        *,
        frame_index: int,
        seed: int,
        spp: int,
        max_depth: int,
        mis: bool = True,
        progress: Callable[[float], None] | None = None,
        part: tuple[int, int] | None = None,
        scene: SceneForPaths | None = None,
    ) -> PathImage:
        """One picture; a pure function of the scene, the view and the four numbers.

        spp: paths per pixel, any number; powers of two are stratified best. max_depth: how many edges a path may have,
        as in Mitsuba's `path`: 1 shows what emits light, 2 adds direct light, n adds n - 2 bounces more. Passing
        through a partly absent surface is no bounce. mis=False samples lights alone, for tests.
        progress: called now and then with how much is done, 0..1.
        part: the number of the first sample and how many are traced now, of the spp; the first part has the number 0,
        and the others go on with the same picture: the scene and the view may move between them.
        scene: what is told about what is placed; by default `scene_arrays()`.
        Raises ArgumentError for numbers out of range or a view of another size.
        """
        self._check(view, spp, max_depth)
        self._expose(
            view,
            self.width * self.height,
            spp,
            frame_key(seed, frame_index),
            max_depth,
            mis,
            progress or (lambda _: None),
            part,
            scene,
        )
        if part is not None:
            spp = sum(part)
        return self._developed(spp)

    def _developed(self, spp: int) -> PathImage:
        shape = (self.height, self.width)
        hdr, albedo, normal = (np.empty((*shape, 3), np.float32) for _ in range(3))
        dropped = np.empty(shape, np.int32)
        kernels.develop(self._film, self.width, self.height, spp, hdr, albedo, normal, dropped)
        self.nonfinite = int(dropped.sum())
        return PathImage(hdr, albedo, normal)

    def rehearse(self, view: View, emission: Callable[[], bool]) -> Iterator[None]:
        """Compile the kernels, without a path. At last shading, as scenes need it in which surfaces emit or do not."""
        scene, s, numbers = self.scene_arrays(), PathState(CHUNK), (1, 0, 0)
        self._trace(scene, view, s, 0, 0, numbers, 0, 1)
        closest(self.scene, CURRENT, s.rays, s.queue, 0, s.hits, s.hit_ids)
        self.cast_shadows(scene, s, 0, 0, 0, numbers)
        self._developed(1)
        yield
        self.advance(replace(scene, any_emission=emission()), s, 0, 0, 0, numbers, 1, 1)

    def sums(self, view: View, pixels: NDArray[np.int32], *, spp: int, key: int, max_depth: int) -> NDArray[np.float32]:
        """`spp` paths through each of some pixels (rows y * width + x): the film's rows, float32 [n, FILM_COLUMNS].

        key: of their random numbers, see `frame_key`.
        """
        self._check(view, spp, max_depth)
        with self.through(upload_pixels(pixels, self.width, self.height)):
            self._expose(view, len(pixels), spp, key, max_depth, True, lambda _: None)
        rows: NDArray[np.float32] = self._film.to_numpy()[pixels]
        return rows

    @contextlib.contextmanager
    def through(self, pixels: Any) -> Iterator[None]:
        """Number paths by these pixels, as `upload_pixels` makes them, in the place of all."""
        every, self._pixels = self._pixels, pixels
        try:
            yield
        finally:
            self._pixels = every

    def _check(self, view: View, spp: int, max_depth: int) -> None:
        if spp < 1 or max_depth < 1:
            raise ArgumentError(f"spp={spp}, max_depth={max_depth}: both must be at least 1")
        if (view.width, view.height) != (self.width, self.height):
            raise ArgumentError(f"a view of {view.width}x{view.height} pixels for a {self.width}x{self.height} picture")
        if self.width * self.height * spp >= 1 << 31:
            raise ArgumentError(f"{self.width}x{self.height} pixels at spp={spp}: more than 2^31 paths in one frame")

    def _expose(
        self,
        view: View,
        pixels: int,
        spp: int,
        key: int,
        max_depth: int,
        mis: bool,
        progress: Callable[[float], None],
        part: tuple[int, int] | None = None,
        scene: SceneForPaths | None = None,
    ) -> None:
        """Trace the paths of the first so many of `self._pixels` onto the film."""
        first_sample, samples = part or (0, spp)
        total = pixels * samples
        size = min(self._batch_size, -(-total // CHUNK) * CHUNK)
        if self._state is None or self._state.size < size:
            self._state = PathState(size)
        self._state.first_sample = first_sample
        self.background = view.background
        scene = scene or self.scene_arrays()
        numbers = (samples, index_bits(spp), key)
        for first in range(0, total, size):
            self._trace(scene, view, self._state, first, min(size, total - first), numbers, max_depth, int(mis))
            progress(min(1.0, (first + size) / total))

    def _trace(
        self,
        scene: SceneForPaths,
        view: View,
        s: PathState,
        first: int,
        count: int,
        numbers: tuple[int, int, int],
        max_depth: int,
        mis: int,
    ) -> None:
        """Trace the paths first .. first + count - 1 to their ends and add them to the film."""
        spp, bits, key = numbers
        self.start(view, s, first, count, numbers)
        live = count
        for step in range(scene.steps(max_depth)):
            live, shadows = self.advance(scene, s, live, first, step, numbers, max_depth, mis)
            if shadows:
                self.cast_shadows(scene, s, shadows, first, step, numbers)
            if not live:
                break
        kernels.expose(
            self.pixel_filter, self._clamp, self._pixels, first, count, spp, bits, key,
            s.status, s.occluded, s.state, s.features, self._film, s.first_sample,
        )  # fmt: skip

    def start(self, view: View, s: PathState, first: int, count: int, numbers: tuple[int, int, int]) -> None:
        """Put the paths first .. first + count - 1 at the head of the queue, where the camera sends them."""
        spp, bits, key = numbers
        with self.vector_mode():
            kernels.start_paths(
                view.array(), self.pixel_filter, self._pixels, self.width, self.height, first, count, spp, bits, key,
                s.rays, s.state, s.status, s.queue, s.first_sample,
            )  # fmt: skip

    def advance(
        self,
        scene: SceneForPaths,
        s: PathState,
        live: int,
        first: int,
        step: int,
        numbers: tuple[int, int, int],
        max_depth: int,
        mis: int,
    ) -> tuple[int, int]:
        """Take the first `live` paths of the queue to their next vertex.

        Returns how many go on, then the first of the queue, and how many of `s.shadow_queue` sampled a light there.
        """
        spp, bits, key = numbers
        if scene.ends_at_lights and step == max_depth - 1 > 0:
            with self.vector_mode():
                finish(
                    *scene.arrays.lighting, mis,
                    s.queue, live, s.rays, s.shadow_rays, s.occluded, s.state, s.status,
                )  # fmt: skip
        else:
            closest(self.scene, CURRENT, s.rays, s.queue, live, s.hits, s.hit_ids, together=step == 0)
            with self.vector_mode():
                shade(
                    *scene.arrays, self._pixels, first, spp, bits, key, step, max_depth, mis, *self.background,
                    s.queue, live, s.rays, s.hits, s.hit_ids, s.shadow_rays, s.occluded, s.state, s.features, s.status,
                    s.first_sample, scene.any_emission,
                )  # fmt: skip
        both = kernels.compact(s.status, s.queue, live, s.next_queue, s.shadow_queue, s.chunks)
        live, shadows = both & 0xFFFFFFFF, both >> 32
        s.swap()
        return live, shadows

    def vector_mode(self) -> contextlib.AbstractContextManager[None]:
        """For kernels whose vectors allow it: they compile sooner."""
        return vector_mode() if self.scene.traversal == "wide" else contextlib.nullcontext()

    def cast_shadows(
        self,
        scene: SceneForPaths,
        s: PathState,
        count: int,
        first: int,
        step: int,
        numbers: tuple[int, int, int],
        tree: int = CURRENT,
    ) -> None:
        """Find out which of the shadow rays reach their lights, past all instances at CURRENT or the MOVERS alone."""
        if not scene.any_coverage:
            occluded(self.scene, tree, s.shadow_rays, s.shadow_queue, count, s.occluded)
            return
        spp, _, key = numbers
        hits, hit_ids = s.shadow_hits
        for layer in range(FREE_PASSES):
            closest(self.scene, tree, s.shadow_rays, s.shadow_queue, count, hits, hit_ids)
            going_on = pass_shadows(
                *scene.arrays, self._pixels, first, spp, key, step, layer, s.shadow_queue, count,
                s.shadow_rays, hits, hit_ids, s.occluded, s.first_sample,
            )  # fmt: skip
            if not going_on:
                break

    def scene_arrays(self, lights: LightArrays | None = None) -> SceneForPaths:
        """The scene's arrays as they are now; tables that depend on the materials are made when those change.

        lights: what is sampled, by default all lights that are placed.
        """
        scene = self.scene
        iors = tuple(scene.materials.glass_iors)
        if iors != self._energy_iors:
            self._energy = upload(energy_tables(iors))
            self._energy_iors = iors
        arrays = SceneArrays(
            *geometry_of(scene),
            *scene.materials.arrays(),
            *scene.textures.arrays(),
            *(lights or scene.lights.arrays(scene.textures)),
            self._energy,
        )
        materials = scene.materials
        ends_at_lights = not (materials.any_coverage or materials.any_emission)
        return SceneForPaths(arrays, materials.any_coverage, materials.any_emission, ends_at_lights)


@dataclass(frozen=True, eq=False)
class SceneForPaths:
    """What the kernels of one picture are told about the scene."""

    arrays: SceneArrays
    any_coverage: bool
    any_emission: bool
    ends_at_lights: bool  # no surface emits, and every path is as long as it has steps

    def steps(self, max_depth: int) -> int:
        """How often a path may be advanced."""
        return max_depth + (FREE_PASSES if self.any_coverage else 0)
