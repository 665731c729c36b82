# SPDX-License-Identifier: Apache-2.0
"""The path pass: radiance by path tracing with next-event estimation, as a wavefront of kernels over batches of paths.

`PathPass.render` is the whole integrator. `start`, `advance` and `cast_shadows` are its steps, which the incremental
renderer calls one by one.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.memory import device_array, upload
from tiscene.device.vector_mode import vector_mode
from tiscene.errors import ArgumentError
from tiscene.render.bsdfs.energy_tables import energy_tables
from tiscene.render.integrators.path import wavefront_kernels as kernels
from tiscene.render.integrators.path.frame_stack import FrameStack
from tiscene.render.integrators.path.last_segment import finish_at_lights
from tiscene.render.integrators.path.path_image import PathImage, developed
from tiscene.render.integrators.path.path_scene import PathScene
from tiscene.render.integrators.path.path_state import CHUNK, FILM_COLUMNS, PathSamples, PathState, check_numbers
from tiscene.render.integrators.path.shading import shade
from tiscene.render.integrators.path.shadow_rays import continue_shadow_rays
from tiscene.render.intersect.ray_queue import tiled_order, tiled_ranks, upload_pixels, upload_rows
from tiscene.render.intersect.trace import closest, occluded, trees_at
from tiscene.render.lights.intersect import WEIGHTED
from tiscene.render.sampling.pixel_filter import pixel_filter as pixel_filter_named
from tiscene.render.sampling.sobol import frame_key, index_bits
from tiscene.render.view import SKY, CubeView, View, check_image_size
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.lights.light_table import LightArrays
from tiscene.scene.placement import CURRENT

# Paths in flight. Smaller batches would fit a CPU's cache, but threads would wait for each other more often: 2^15 was
# measured to take a third longer.
BATCH_SIZE = 1 << 20

StartCallback = Callable[[PathState, int, int], None]  # see `PathPass.sums`


class PathPass:
    """Path tracer for a DeviceScene as placed at CURRENT.

    Args:
        scene: The scene.
        width: Image width, pixels.
        height: Image height, pixels.
        batch_size: Paths in flight; None: BATCH_SIZE. It does not affect results.
        pixel_filter: A name from `PIXEL_FILTERS`.
        clamp: Limit of the largest channel of a path's radiance, W/m²/sr. It removes energy. None: no limit.

    Attributes:
        background: Radiance of camera rays that hit nothing, or SKY; that of the view rendered last.
        film: f32 [at least as many as `pixels`, FILM_COLUMNS] on the device, sums over the samples of each.
        nonfinite: Number of infinite or NaN samples in the last image. They are left out of the means.

    Raises:
        ArgumentError: If the image is empty or too large.
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
        check_image_size(width, height)
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
        self._pixels: Any = None
        self.film: Any = None
        self._stack = FrameStack.single()
        self._energy: Any = None
        self._energy_key: tuple[Any, ...] | None = None

    @property
    def pixels(self) -> Any:
        """The pixels that are traced, on the device, see `upload_pixels`."""
        if self._pixels is None:
            self._pixels = upload_pixels(tiled_order(self.width, self.height), self.width, self.height)
        return self._pixels

    def render(
        self,
        view: View,
        *,
        frame_index: int,
        seed: int,
        spp: int,
        max_depth: int,
        mis: int = WEIGHTED,
        progress: Callable[[float], None] | None = None,
        sample_range: tuple[int, int] | None = None,
        scene: PathScene | None = None,
    ) -> PathImage:
        """Render one image, a pure function of the scene, the view, frame_index, seed, spp and max_depth.

        Args:
            view: Camera and image size.
            frame_index: Frame number; with `seed` it selects the random numbers.
            seed: Seed of the random numbers.
            spp: Samples per pixel. Powers of two are stratified best.
            max_depth: Largest number of segments of a path, as in Mitsuba's `path`: 1 shows emission only, 2 adds
                direct lighting, n adds n - 2 further bounces. Passing an alpha-rejected surface does not count.
            mis: Which emission counts that paths find, see `lights.intersect`.
            progress: Called after each batch with the completed fraction, 0..1.
            sample_range: First sample and number of samples to trace now, of the `spp` samples. A range that starts at
                0 clears the film and the following ranges continue the same image; the scene and the view may change
                in between. None: all samples.
            scene: Scene data; None: `scene_arrays()`.

        Raises:
            ArgumentError: If a number is out of range or the view has another size.
        """
        self._check(view, spp, max_depth)
        samples = PathSamples(sample_range[1] if sample_range else spp, index_bits(spp), frame_key(seed, frame_index))
        first_sample = sample_range[0] if sample_range else 0
        self._trace(
            view, self.width * self.height, samples, max_depth, mis=mis, progress=progress, first_sample=first_sample,
            scene=scene,
        )  # fmt: skip
        return self.developed(sum(sample_range) if sample_range else spp)

    def sums(
        self,
        view: View | CubeView,
        pixels: NDArray[np.int32],
        *,
        spp: int,
        key: int,
        max_depth: int,
        scene: PathScene | None = None,
        on_start: StartCallback | None = None,
    ) -> NDArray[np.float32]:
        """Trace `spp` paths through each of some pixels and return their film rows, float32 [n, FILM_COLUMNS].

        Args:
            view: Camera and image size, which may be another than that of the pass.
            pixels: i32 [n], pixel numbers y * width + x; traced tile by tile, see `tiled_order`.
            spp: Samples per pixel.
            key: Key of the random numbers, see `frame_key`.
            max_depth: See `render`.
            scene: Scene data; None: `scene_arrays()`.
            on_start: Called when the camera rays of a batch of paths are generated, with the paths, the number of the
                first and their count. It may replace the rays.
        """
        check_numbers(len(pixels), spp, max_depth)
        order = np.argsort(tiled_ranks(pixels, view.width, view.height)).astype(np.int32)
        ordered = pixels[order]
        with self.restricted_to(upload_rows(ordered, view.places(ordered))):
            self._trace(
                view, len(pixels), PathSamples(spp, index_bits(spp), key), max_depth, scene=scene, on_start=on_start
            )
        rows = np.empty((len(pixels), FILM_COLUMNS), np.float32)
        kernels.read_film(self.film, order, rows)
        return rows

    def warm_up(self, view: View, emission: Callable[[], bool]) -> Iterator[None]:
        """Compile the kernels without tracing a path; yields between parts.

        Args:
            view: Camera and image size.
            emission: Called last: whether the scene has emissive surfaces, which selects the variant of `shade`.
        """
        scene, state, samples = self.scene_arrays(), PathState(CHUNK), PathSamples(1, 0, 0)
        self._make_film(self.width * self.height)
        self._trace_batch(scene, view, state, 0, 0, samples, max_depth=0)
        closest(self.scene, CURRENT, state.rays, state.queue, 0, state.hits, state.hit_ids)
        self.cast_shadows(scene, state, 0, 0, 0, samples)
        self.developed(1)
        yield
        self.advance(replace(scene, any_emission=emission()), state, 0, 0, 0, samples, max_depth=1)

    @contextlib.contextmanager
    def restricted_to(self, pixels: Any) -> Iterator[None]:
        """Number paths by these pixels, made by `upload_pixels`, instead of by all pixels of the image."""
        all_pixels, self._pixels = self._pixels, pixels
        try:
            yield
        finally:
            self._pixels = all_pixels

    def start(self, view: View | CubeView, state: PathState, first: int, count: int, samples: PathSamples) -> None:
        """Generate the camera rays of paths first .. first + count - 1 and queue them."""
        spp, bits, key = samples
        with self.vector_mode():
            kernels.start_paths(
                self._stack.cameras_of(view), self.pixel_filter, self.pixels, view.width, view.height, first, count,
                spp, bits, key, state.rays, state.state, state.status, state.queue, state.first_sample,
                *self._stack.arguments,
            )  # fmt: skip

    def advance(
        self,
        scene: PathScene,
        state: PathState,
        live: int,
        first: int,
        step: int,
        samples: PathSamples,
        max_depth: int,
        mis: int = WEIGHTED,
        segments: int = 1,
    ) -> tuple[int, int]:
        """Intersect and shade one segment of the first `live` paths of the queue, or several.

        Args:
            scene: Scene data.
            state: The paths; its queue is compacted.
            live: Number of paths to advance.
            first: Number of the path in row 0.
            step: Number of times the paths were advanced before.
            samples: Random numbers of the paths.
            max_depth: See `render`.
            mis: See `render`.
            segments: See `PathScene.segments_at_once`. All shadow rays but the last are traced too.

        Returns:
            Numbers of paths that continue, at the head of the queue, and of shadow rays to cast, in `shadow_queue`.
        """
        spp, bits, key = samples
        if scene.ends_at_lights and step == max_depth - 1 > 0:
            with self.vector_mode():
                finish_at_lights(
                    *scene.textures, *scene.lights, mis, state.queue, live, state.rays, state.shadow_rays,
                    state.occluded, state.state, state.status, scene.any_links,
                )  # fmt: skip
        else:
            rays = state.rays, state.queue
            closest(self.scene, scene.tree, *rays, live, state.hits, state.hit_ids, step == 0, self._stack.paths)
            unread = scene.lights.nodes, state.hits, scene.geometry.instance_info, 0
            tree = trees_at(self.scene, scene.tree) if self._shades_segments else unread
            with self.vector_mode():
                shade(
                    *scene.arrays, *scene.cache_arguments(max_depth), self.pixels, first, spp, bits, key, step,
                    max_depth, mis, *scene.background_of(self.background), state.queue, live, segments, *tree,
                    state.rays, state.hits, state.hit_ids, state.shadow_rays, state.occluded, state.state,
                    state.features, state.status, state.first_sample, scene.any_emission, scene.any_extended,
                    scene.any_links, self._shades_segments, *self._stack.arguments,
                )  # fmt: skip
        return kernels.compact(state, live)

    def cast_shadows(
        self,
        scene: PathScene,
        state: PathState,
        count: int,
        first: int,
        step: int,
        samples: PathSamples,
        tree: int | None = None,
    ) -> None:
        """Trace the first `count` shadow rays of the shadow queue and set `state.occluded`.

        Args:
            scene: Scene data.
            state: The paths.
            count: Number of shadow rays.
            first: Number of the path in row 0.
            step: Number of times the paths were advanced before.
            samples: Random numbers of the paths, used by partially opaque surfaces.
            tree: MOVERS for movers only; None: that of `scene`.
        """
        tree = scene.tree if tree is None else tree
        rays = state.shadow_rays, state.shadow_queue
        if not (scene.any_coverage or scene.any_shadow_links):
            occluded(self.scene, tree, *rays, count, state.occluded, self._stack.trees)
            return
        spp, _, key = samples
        hits, hit_ids = state.shadow_hits
        for layer in range(scene.shadow_layers):
            closest(self.scene, tree, *rays, count, hits, hit_ids, False, self._stack.paths)
            continued = continue_shadow_rays(
                *scene.arrays, self.pixels, first, spp, key, step, layer, state.shadow_queue, count,
                state.shadow_rays, hits, hit_ids, state.occluded, state.first_sample, scene.any_shadow_links,
                *self._stack.arguments,
            )  # fmt: skip
            if not continued:
                break

    @property
    def _shades_segments(self) -> bool:
        """Whether `shade` may trace paths further, see `advance`."""
        return self.scene.traversal == "bvh8" and not self._stack.paths

    def vector_mode(self) -> contextlib.AbstractContextManager[None]:
        """Return the context in which kernels whose vector operations permit it compile faster."""
        return vector_mode() if self.scene.traversal == "bvh8" else contextlib.nullcontext()

    def scene_arrays(self, lights: LightArrays | None = None) -> PathScene:
        """Return the scene's data as it is now; BSDF energy tables are recomputed when glass materials change.

        Args:
            lights: Lights to sample; None: all lights of the scene.
        """
        scene, materials = self.scene, self.scene.materials
        key = (*materials.glass_iors, materials.any_extended)
        if key != self._energy_key:
            self._energy = upload(energy_tables(materials.glass_iors, extended=materials.any_extended))
            self._energy_key = key
        return PathScene.of(scene, lights or scene.lights.arrays(scene.textures), self._energy)

    def _check(self, view: View, spp: int, max_depth: int) -> None:
        check_numbers(self.width * self.height, spp, max_depth)
        if (view.width, view.height) != (self.width, self.height):
            raise ArgumentError(
                f"view of {view.width}x{view.height} pixels: must have the image size, {self.width}x{self.height}"
            )

    def _trace(
        self,
        view: View | CubeView,
        pixel_count: int,
        samples: PathSamples,
        max_depth: int,
        *,
        mis: int = WEIGHTED,
        progress: Callable[[float], None] | None = None,
        first_sample: int = 0,
        scene: PathScene | None = None,
        on_start: StartCallback | None = None,
    ) -> None:
        """Trace paths through the first `pixel_count` of `self.pixels`, in batches, and add them to the film."""
        self._make_film(pixel_count)
        total = pixel_count * samples.spp
        size = min(self._batch_size, -(-total // CHUNK) * CHUNK)
        if self._state is None or self._state.size < size:
            self._state = PathState(size)
        self._state.first_sample = first_sample
        self.background = view.background
        scene = scene or self.scene_arrays()
        for first in range(0, total, size):
            count = min(size, total - first)
            self._trace_batch(scene, view, self._state, first, count, samples, max_depth, mis, on_start)
            if progress:
                progress(min(1.0, (first + size) / total))

    def _make_film(self, pixel_count: int) -> None:
        if self.film is None or self.film.shape[0] < pixel_count:
            self.film = device_array(ti.f32, (pixel_count, FILM_COLUMNS))

    def _trace_batch(
        self,
        scene: PathScene,
        view: View | CubeView,
        state: PathState,
        first: int,
        count: int,
        samples: PathSamples,
        max_depth: int,
        mis: int = WEIGHTED,
        on_start: StartCallback | None = None,
    ) -> None:
        """Trace the paths first .. first + count - 1 to their ends and add them to the film."""
        spp, bits, key = samples
        self.start(view, state, first, count, samples)
        if on_start:
            on_start(state, first, count)
        live, step, steps = count, 0, scene.steps(max_depth)
        while live and step < steps:
            segments = scene.segments_at_once(live, steps - step) if self._shades_segments else 1
            live, shadows = self.advance(scene, state, live, first, step, samples, max_depth, mis, segments)
            if shadows:
                self.cast_shadows(scene, state, shadows, first, step, samples)
            step += segments
        kernels.accumulate(
            self.pixel_filter, self._clamp, self.pixels, first, count, spp, bits, key, state.status,
            state.occluded, state.state, state.features, self.film, state.first_sample, *self._stack.arguments,
        )  # fmt: skip

    def developed(self, spp: int) -> PathImage:
        """Return the film as images."""
        image, self.nonfinite = developed(self.film, self.pixels, (self.height, self.width), spp)
        return image
