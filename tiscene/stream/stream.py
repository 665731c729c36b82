# SPDX-License-Identifier: Apache-2.0
"""Stream: an endless or finite sequence of labeled frames, by iteration or by index.

Frame k depends only on (scenario, render settings, seed, k): not on the number of frames, on what was rendered before,
or on the process. So `stream[k]` equals the k-th frame of iterating, byte for byte.
"""

from __future__ import annotations

import inspect
import operator
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from types import TracebackType
from typing import Any, overload

from dynamics.argument_checks import brief, distinct_names, flag, integer, number, positive
from tiscene import catalog
from tiscene.device import memory, runtime
from tiscene.errors import ArgumentError, ArgumentTypeError
from tiscene.frame.buffers import COLORS, buffer_names, rendered_buffers
from tiscene.frame.frame import Frame
from tiscene.render.integrators.incremental.base_image import ProgressCallback
from tiscene.render.integrators.incremental.incremental_pass import CACHE_BYTES
from tiscene.render.render_settings import RenderSettings, preset
from tiscene.render.view import MAX_SIZE, View, image_size
from tiscene.scenario.scenario import Scenario
from tiscene.scene.camera import Camera
from tiscene.scene.description import Light
from tiscene.stream.fixed_settings import FixedSettings
from tiscene.stream.frame_batches import FrameBatches
from tiscene.stream.frame_slice import FrameSlice
from tiscene.stream.loaders.loader_methods import LoaderMethods
from tiscene.stream.progress import ProgressBar
from tiscene.stream.render_ahead import RenderAhead
from tiscene.stream.saved_state import SavedState
from tiscene.stream.shutter import shutter_times
from tiscene.stream.stage_cache import StageCache
from tiscene.stream.stream_output import StreamOutput
from tiscene.stream.view_renderer import Pixels, ViewRenderer, render_all_cameras
from tiscene.usd.core.limits import Limits
from tiscene.world.category_ids import CategoryIds
from tiscene.world.lights import warn_if_dark
from tiscene.world.world import World

DEFAULT_BUFFERS = ("rgb", "semantic", "instance", "depth", "forward_flow")


class Stream(FixedSettings, LoaderMethods, StreamOutput, SavedState, Iterator[Frame]):
    """An endless or finite, exactly repeatable sequence of labeled frames.

    A stream is an iterator with a position, as an open file is: a second `for` continues where the first stopped,
    `seek` moves it, `state_dict` saves it, `stream[k]` and `stream[a:b]` leave it. `with` and `close` free memory.

    `stream.world.spawn(...)`, `.despawn(...)` and `.move(...)` edit the frames to come, from the next one on. Edits
    become part of `stream.scenario`, so that they replay.

    Args:
        source: a scene name ("room_02"), a USD file, a Scenario, or a scenario file (.json). A stage plays its own
            motion: time samples, or the schema TisceneMotionAPI.
        width: image width, px; None: that of the stage's RenderSettings, else 256.
        height: image height, px; None: that of the stage's RenderSettings (in proportion to `width`), else 192.
        fps: frame k shows time k / fps.
        frames: number of frames; None for an endless stream. It never changes a frame.
        buffers: names of the buffers to render (`tiscene list` names all); others cost nothing.
        quality: preset: "fast", "preview", "standard" or "photo". The next seven arguments override its parts.
        spp: samples per pixel; with `relative_error` their maximum, below which 16 are taken all the same.
        max_depth: maximum path depth, in segments.
        denoise: whether `rgb` and `denoised` are denoised.
        relative_error: sample each pixel until the standard error of its luminance is estimated to be at most this
            fraction (0.02: 2 %).
        clamp: maximum radiance per sample and channel, W/m²/sr. Removes fireflies; biased.
        pixel_filter: "box", "triangle", "gaussian", "mitchell" or "blackman-harris".
        incremental: whether frames with a static camera and the lights of the start are rendered as a base image of the
            static scene plus what movers change, and with "fast" and "preview" those whose camera turns or walks over
            panoramas. None: as the preset says ("fast", "preview": yes). The first such frame waits for the image.
        base_spp: samples per pixel of base images; None: by the preset.
        seed: of the rendering's random numbers; trajectories have their own.
        camera: a Camera, or the name or prim path of one on the stage, in place of the scenario's. Several: all watch
            one simulation; the frame is that of the first, `frame.views` has all.
        shutter: when the shutter opens and closes, in frames relative to each frame, such as (0, 0.5), for motion blur
            of color. Labels are of the frame's own time. None: as the cameras say.
        time_code: show the stage as it is at this time code, without motion; None: it plays.
        variants: variant selections by prim and set, {"/Prim{set}": "variant"}; added to the scenario's.
        taxonomy: taxonomy of the semantic labels; None for "class", else "category", else the first by name.
        categories: names of the categories that have the ids 1, 2, ... in `semantic`, in this order; everything else
            has 0, as the background. None: all categories, with ids that are the same in all scenes (`ts.categories`).
        root: folder that all of the stage's files must be in; None: anywhere.
        untrusted: read the stage in a process with limits, for files that may be damaged or hostile. Reads no motion.
        strict: refuse a stage with a broken part, such as a missing file or a mesh that contradicts itself. False: the
            part is left out and named in a StageWarning.
        subdivision: triangles that all subdivision surfaces of the stage together are refined to at most; 0: none is
            refined; None: 3,000,000.
        limits: time and memory that reading a stage may take, `ts.Limits(seconds=, memory=)`; None: unlimited, unless
            it is untrusted.
        arch: "cpu" or "cuda"; None: what this process runs on, else the environment variable TISCENE_ARCH, else "cpu".
        cache_bytes: memory limit of what incremental rendering keeps.
        prefetch: number of frames that a worker process renders ahead while iterating; 0: none. The bytes are the same.
            Scripts then need `if __name__ == "__main__":`.
        batch: number of frames that are rendered at once while iterating, where nothing is shared between them; more
            than 1 is meant for GPUs. The bytes are the same.
        progress: called with what is being prepared and how much of it is done, 0..1; None: a bar on a terminal.

    Raises:
        TisceneError: for every invalid argument, scene, template or stage.
    """

    def __init__(
        self,
        source: str | os.PathLike[str] | Scenario,
        *,
        width: int | None = None,
        height: int | None = None,
        fps: float = 25.0,
        frames: int | None = None,
        buffers: Sequence[str] = DEFAULT_BUFFERS,
        quality: str = "standard",
        spp: int | None = None,
        max_depth: int | None = None,
        denoise: bool | None = None,
        relative_error: float | None = None,
        clamp: float | None = None,
        pixel_filter: str | None = None,
        incremental: bool | None = None,
        base_spp: int | None = None,
        seed: int = 0,
        camera: Camera | str | Sequence[Camera | str] | None = None,
        shutter: tuple[float, float] | None = None,
        time_code: float | None = None,
        variants: Mapping[str, str] | None = None,
        taxonomy: str | None = None,
        categories: Sequence[str] | None = None,
        root: str | os.PathLike[str] | None = None,
        untrusted: bool = False,
        strict: bool = False,
        subdivision: int | None = None,
        limits: Limits | None = None,
        arch: str | None = None,
        cache_bytes: int = CACHE_BYTES,
        prefetch: int = 0,
        batch: int = 1,
        progress: ProgressCallback | None = None,
    ) -> None:
        width = None if width is None else integer(width, "width", 1, MAX_SIZE)
        height = None if height is None else integer(height, "height", 1, MAX_SIZE)
        self.frames = None if frames is None else integer(frames, "frames", 1, sys.maxsize)
        self.seed = integer(seed, "seed", 0, 2**32 - 1)
        self.fps = positive(fps, "fps")
        self.buffers = buffer_names(buffers)
        self.render_settings: RenderSettings = preset(
            quality,
            spp=spp,
            max_depth=max_depth,
            denoise=denoise,
            relative_error=relative_error,
            clamp=clamp,
            pixel_filter=pixel_filter,
            incremental=incremental,
            base_spp=base_spp,
        )
        self.shutter = None if shutter is None else shutter_times(shutter)
        if relative_error is not None and self.shutter is not None and self.shutter[0] < self.shutter[1]:
            raise ArgumentError(f"relative_error={relative_error}: not with {shutter=}; give spp= instead")
        self.time_code = None if time_code is None else number(time_code, "time_code")
        self.taxonomy = taxonomy
        self._selected_categories = None if categories is None else distinct_names(categories, "categories")
        self._cache_bytes = integer(cache_bytes, "cache_bytes", 1, sys.maxsize)
        self._ahead = RenderAhead(integer(prefetch, "prefetch", 0, 10_000))
        self._batches = FrameBatches(integer(batch, "batch", 1, 1024))
        self._progress = progress or ProgressBar()
        self.stages = StageCache(
            self.buffers,
            self.render_settings,
            arch=arch,
            untrusted=untrusted,
            taxonomy=taxonomy,
            time_code=self.time_code,
            root=root,
            strict=strict,
            subdivision=None if subdivision is None else integer(subdivision, "subdivision", 0, sys.maxsize),
            limits=limits,
        )
        if not isinstance(source, Scenario):
            still = untrusted or time_code is not None
            source = Scenario.load(source, variants=variants, still=still, limits=limits, camera=camera)
            source = self.stages.without_empty_objects(source)
        else:
            source = source if variants is None else replace(source, variants={**source.variants, **variants})
            source = source if camera is None else replace(source, camera=camera)
        self.width, self.height = image_size(width, height, self.stages.stage(source).resolution)
        self.restart(source)
        self.world.category_ids.warn_of_absent(each.category for each in catalog.templates().values())
        if not COLORS.isdisjoint(rendered_buffers(self.buffers)):
            warn_if_dark(source.scene, self.world.descriptions)

    @runtime.one_thread_at_a_time
    def restart(self, scenario: Scenario, *, width: int | None = None, height: int | None = None) -> None:
        """Start again at frame 0 with another scenario, of the same scene or of another one.

        A scene that was read recently is not read again, nor are its trees built again, unless one of its layers or
        textures has changed: with `untrusted` or `limits`, unless its own file has.

        Args:
            scenario: the scenario; its scene and variants may differ.
            width: image width, px; None: as before.
            height: image height, px; None: as before.

        Raises:
            TisceneError: the scenario, its stage or a template is invalid; nothing has changed then.
        """
        if not isinstance(scenario, Scenario):
            raise ArgumentError(f"scenario={brief(scenario)}: must be a Scenario; Scenario.load reads one")
        width, height = image_size(self.width if width is None else width, self.height if height is None else height)
        stage, settings, cache_bytes = self.stages.stage(scenario), self.render_settings, self._cache_bytes
        renderer = ViewRenderer(
            settings, seed=self.seed, shutter=self.shutter, cache_bytes=cache_bytes, progress=self._progress
        )
        load_template = partial(self.stages.template, scenario=scenario, stage=stage)
        ids = CategoryIds(catalog.categories(), catalog.FIRST_UNREGISTERED_ID, self._selected_categories)
        trees, lock = renderer.mesh_trees, runtime.ONE_THREAD
        world = World(scenario, stage, load_template, self.fps, width / height, trees, ids, self.seed, lock)
        self._release()
        renderer.set_world(world, self.stages.trees.get(world.stage))
        self.world, self._renderer = world, renderer
        self.width, self.height = width, height
        self._digest = None

    def close(self, *, keep_trees: bool = False) -> None:
        """Free the memory of the device and of caches. `restart` makes the stream usable again.

        Args:
            keep_trees: keep the trees of its stages, for `restart` and for the streams that `another` returned.
        """
        self._release()
        if not keep_trees:
            self.stages.trees.clear()
        memory.free_deleted_arrays()

    def _release(self) -> None:
        """End the present world; the trees of its stage are kept."""
        vars(self).pop("world", None)  # first: a thread that iterates meanwhile would start another worker
        self._ahead.close()
        self._batches.clear()
        renderer = vars(self).pop("_renderer", None)
        if renderer is not None:
            self.stages.trees.keep(renderer)
            renderer.close()

    def __enter__(self) -> Stream:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def __getattr__(self, name: str) -> Any:
        if name in ("world", "_renderer"):
            raise ArgumentError("this stream is closed; make a new one, or restart it with a scenario")
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    def __repr__(self) -> str:
        if "world" not in vars(self):
            return "<Stream, closed>"
        return f"<Stream of {self.scenario.scene} at frame {self.position}: {', '.join(self.buffers)}>"

    @property
    def arch(self) -> str | None:
        """The architecture that kernels run on: "cpu" or "cuda"."""
        return self.stages.arch

    @property
    def scenario(self) -> Scenario:
        """The scenario with all edits so far; a stream of it gives the same frames."""
        return self.world.scenario

    @property
    def categories(self) -> dict[int, str]:
        """Names of the ids in `semantic`: of the scene so far, or those selected; 0 is the background."""
        return self.world.categories

    @property
    def position(self) -> int:
        """The index of the frame that `next` returns."""
        return self.world.next_frame

    @runtime.one_thread_at_a_time
    def seek(self, index: int) -> Stream:
        """Make frame `index` the next one; costs nothing. Returns the stream."""
        self.world.next_frame = integer(index, "index", 0, self.frames or sys.maxsize)
        return self

    def __iter__(self) -> Stream:
        return self

    def __next__(self) -> Frame:
        return self._ahead.next_frame(self) if self._ahead.count else self._next()

    @runtime.one_thread_at_a_time  # so that edits of other threads come before the frame or after it
    def _next(self, pixels: Sequence[Pixels] | None = None) -> Frame:
        """Return the frame at the position, and move on. `pixels` are those of its cameras, if they are rendered."""
        index, end = self.position, self.frames or sys.maxsize
        if index >= end:
            raise StopIteration
        frame = self._batches.first_of(self, range(index, end)) if pixels is None else self._render(index, pixels)
        self.seek(index + 1)
        return frame

    def __len__(self) -> int:
        if self.frames is None:
            raise TypeError("an endless stream has no length; make it with frames=N")
        return self.frames

    @overload
    def __getitem__(self, index: int) -> Frame: ...

    @overload
    def __getitem__(self, index: slice) -> FrameSlice: ...

    def __getitem__(self, index: int | slice) -> Frame | FrameSlice:
        end = self.frames or sys.maxsize
        if isinstance(index, slice):
            bounds = index.start, index.stop, index.step if index.start is None else None  # backwards from the end
            if self.frames is None and any(bound is not None and bound < 0 for bound in bounds):
                raise ArgumentError(f"{index}: an endless stream cannot be counted from its end")
            return FrameSlice(self, range(end)[index], partial(self._batches.first_of, self))
        place = operator.index(index)
        if place < 0 and self.frames is not None:
            place += self.frames
        if not 0 <= place < end:
            outside = "negative" if self.frames is None and index < 0 else f"outside 0..{end - 1}"
            raise IndexError(f"frame {index} is {outside}")
        return self._render(place)

    @runtime.one_thread_at_a_time
    def _render(self, index: int, pixels: Sequence[Pixels] | None = None) -> Frame:
        self._renderer.check_session()  # before the simulation uses its arrays
        state = self.world.state(index)
        return render_all_cameras(self._renderer, state, self.buffers, self.width, self.height, pixels)

    @runtime.one_thread_at_a_time
    def render_view(
        self,
        index: int,
        view: View | Camera | str,
        buffers: Sequence[str] | None = None,
        *,
        since: int | None = None,
        incremental: bool | None = None,
    ) -> Frame:
        """Render frame `index` from another camera or in another size, in the exposure of the stream's own camera.

        A look from elsewhere: the stream's position, its cameras and its scenario stay as they are.

        Args:
            index: frame number.
            view: a Camera, or the name or prim path of one on the stage. It stands still where it is, and its image has
                the stream's size. A View has the camera at frames index - 1, index and index + 1, and the image size.
            buffers: names of buffers; None: the stream's.
            since: the frame of `view.previous`, from which `backward_flow` is measured; None: index - 1.
            incremental: overrides the stream's setting for this frame.

        Raises:
            TisceneError: an argument is invalid.
        """
        names = self.buffers if buffers is None else buffer_names(buffers)
        size = self.width, self.height
        self._renderer.check_session()
        if isinstance(view, str):
            view = self.world.stage.camera(view)
        if isinstance(view, Camera):
            view = View(view, view, view, *size)
        if not isinstance(view, View):
            raise ArgumentTypeError(f"view={brief(view)}: must be a Camera, the name of one on the stage, or a View")
        incremental = None if incremental is None else flag(incremental, "incremental")
        state = self.world.state(index)
        return self._renderer.render(state, view, names, main_size=size, since=since, incremental=incremental)

    @property
    @runtime.one_thread_at_a_time
    def exposure(self) -> float:
        """Stops by which `rgb` is exposed: the camera's, else metered at frame 0 by the main camera."""
        return self._renderer.exposure(self.width, self.height)

    @runtime.one_thread_at_a_time
    def set_light(self, row: int, light: Light) -> None:
        """Replace the light in a row of `world.stage.lights` by another of the same kind, for all frames from now on.

        Unlike edits of the world, this is not part of the scenario, nor replayed. Automatic exposure does not follow.
        Copies of the stream have the light too. `restart` ends it.

        Raises:
            ArgumentError: there is no such light, it is of another kind, or frames are rendered ahead.
        """
        self._ahead.check_no_worker("set_light")
        self.world.set_light(row, light)


STREAM_ARGUMENTS = tuple(inspect.signature(Stream).parameters)[1:]  # without the source
