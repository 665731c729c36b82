# SPDX-License-Identifier: Apache-2.0
"""The stream: one frame after another, or any frame by its number, always the same bytes."""

from __future__ import annotations

import hashlib
import json
import operator
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any, overload

from tiscene import catalog
from tiscene.device import runtime
from tiscene.errors import ArgumentError
from tiscene.frame.buffers import COLORS, buffer_names
from tiscene.frame.frame import Frame, FrameCamera
from tiscene.render.annotations.object_measurements import Measurer
from tiscene.render.integrators.incremental.base_image import ProgressCallback
from tiscene.render.integrators.incremental.incremental_pass import CACHE_BYTES
from tiscene.render.renderer import Renderer, RenderSettings, quality_named
from tiscene.render.view import View
from tiscene.scenario.scenario import Scenario
from tiscene.scene.bvh.obstacle_tree import MeshTrees
from tiscene.scene.camera import Camera
from tiscene.scene.description import Light, Template
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import Placement
from tiscene.stream.frame_slice import FrameSlice
from tiscene.stream.incremental import is_fixed, moving, pays
from tiscene.stream.loading import load
from tiscene.stream.progress import ProgressBar
from tiscene.stream.shutter import moments
from tiscene.usd.core.layers import scene_digests
from tiscene.usd.read.template import read_template
from tiscene.usd.scenario.bake import write_motion
from tiscene.validation import integer, number, positive, shutter_times
from tiscene.world.lights import warn_if_dark
from tiscene.world.world import World

DEFAULT_BUFFERS = ("rgb", "semantic", "instance", "depth", "forward_flow")
MAX_SIZE = 16384
MAX_RENDERERS = 4  # sizes of pictures whose arrays are kept
ON_DEVICE = ("world", "_scene", "_measurer", "_loaded", "_renderers")


class Stream(Iterator[Frame]):
    """An endless or finite, exactly repeatable sequence of labeled frames.

    source: a scene name ("room_02"), a USD file, a Scenario, or a scenario file (.json). A stage whose author made its
        things move (`tiscene.usd.core.schema`, or time samples of their transforms) plays.
    width, height: px. fps: frame k shows time k / fps. frames: how many; None for an endless stream.
    buffers: which of `tiscene.frame.buffers.BUFFERS` each frame holds; the others cost nothing.
    quality: "fast", "preview", "standard" or "photo"; spp, max_depth and denoise replace its parts.
    error: paths go through each pixel until its error is estimated to be that part of its luminance (0.02: 2 %), spp of
        them at most (by default 1024). clamp: the most that one path brings in a channel, W/m²/sr: less glaring noise,
        and light that is missing. pixel_filter: "box", "triangle", "gaussian", "mitchell" or "blackman-harris".
    seed: of the rendering's random numbers (trajectories have their own).
    camera: a Camera, or the name of one on the stage, in the place of the scenario's. Several: one simulation that all
        of them watch; `frame` is what the first sees, `frame.views` has a frame of each by the camera's name.
    time_code: shows the stage as it is then, still; None: it plays. variants: {"/Prim{set}": "variant"}.
    arch: "cpu" or "cuda".
    shutter: when the shutter opens and closes, in frames from each frame, such as (0, 0.5): what moves meanwhile is
        blurred in `rgb` and `hdr`, labels are of the frame's own time. None: as the cameras say; (0, 0): no blur.
    taxonomy: of the semantic labels; None for "class", else "category", else any.
    root: the folder that all of the stage's files must be in. untrusted: read a stage that may be damaged or hostile in
        a process of its own; no motion is read from it then.
    incremental: whether frames with the camera and the lights of frame 0 are made as differences to an image of what
        never moves, which takes time once and then leaves little to trace (docs/incremental.md). None: if there are
        frames enough for that to pay. base_spp: paths per pixel of that image; None: by the quality.
    cache_bytes: what that may keep in memory. progress: is called with what is being made for it, and how much of that
        is done, 0..1; by default a terminal shows it.

    A stream is an iterator with a position, as an open file is: a second `for` goes on where the first stopped, `seek`
    moves it, and `state_dict` saves it. `stream[k]` and `stream[a:b]` leave the position alone.

    `stream.world.spawn(...)`, `.despawn(...)` and `.move(...)` edit what is to come, from the next frame on; the edits
    become part of `stream.scenario`.

    Raises a TisceneError that says what is wrong for every bad argument, scene, template or stage.
    """

    def __init__(
        self,
        source: str | os.PathLike[str] | Scenario,
        *,
        width: int = 256,
        height: int = 192,
        fps: float = 25.0,
        frames: int | None = None,
        buffers: Sequence[str] = DEFAULT_BUFFERS,
        quality: str = "standard",
        spp: int | None = None,
        max_depth: int | None = None,
        denoise: bool | None = None,
        error: float | None = None,
        clamp: float | None = None,
        pixel_filter: str | None = None,
        seed: int = 0,
        camera: Camera | str | Sequence[Camera | str] | None = None,
        shutter: tuple[float, float] | None = None,
        time_code: float | None = None,
        variants: Mapping[str, str] | None = None,
        taxonomy: str | None = None,
        root: str | os.PathLike[str] | None = None,
        untrusted: bool = False,
        arch: str | None = None,
        incremental: bool | None = None,
        base_spp: int | None = None,
        cache_bytes: int = CACHE_BYTES,
        progress: ProgressCallback | None = None,
    ) -> None:
        self.width = integer("width", width, 1, MAX_SIZE)
        self.height = integer("height", height, 1, MAX_SIZE)
        self.frames = None if frames is None else integer("frames", frames, 1, sys.maxsize)
        self.seed = integer("seed", seed, 0, 2**32 - 1)
        self.fps = positive("fps", fps)
        self.buffers = buffer_names(buffers)
        parts = {"max_depth": max_depth, "denoise": denoise, "clamp": clamp, "pixel_filter": pixel_filter}
        self.quality: RenderSettings = quality_named(quality, spp=spp, error=error, base_spp=base_spp, **parts)
        if not isinstance(source, Scenario):
            source = Scenario.load(source, variants=variants, still=untrusted or time_code is not None)
        scenario = source
        if camera is not None:
            scenario = replace(scenario, camera=camera)
        if incremental and not self.quality.allows_incremental:
            raise ArgumentError("incremental=True: not with error=, clamp= or pixel_filter='mitchell'")
        pays_here = self.quality.allows_incremental and pays(self.frames)
        self.incremental = pays_here if incremental is None else incremental
        self._cache_bytes = integer("cache_bytes", cache_bytes, 1, sys.maxsize)
        self._progress = progress or ProgressBar()
        self.shutter = None if shutter is None else shutter_times(shutter)
        self.time_code = None if time_code is None else number("time_code", time_code)
        self.taxonomy = taxonomy
        options = {
            "time_code": self.time_code,
            "variants": variants,
            "lifted": [each.template for each in scenario.objects if catalog.is_prim_path(each.template)],
            "taxonomy": taxonomy,
            "root": root,
        }
        file = catalog.find_scene(scenario.scene)
        self._stage, self.arch = load(file, self.buffers, self.quality, arch, untrusted, **options)
        self.variants = dict(variants or {})
        self.restart(scenario)
        if not COLORS.isdisjoint(self.buffers):
            warn_if_dark(scenario.scene, self.world.descriptions)

    def restart(self, scenario: Scenario, *, width: int | None = None, height: int | None = None) -> None:
        """Begin again at frame 0 with another scenario of the same scene, which is not read again.

        width, height: px; None: as before. Raises ScenarioError and the like, changing nothing.
        """
        width, height = width or self.width, height or self.height

        def load_template(name: str) -> Template:
            file, variants = catalog.find_template(name, scene=scenario.scene), catalog.template_variants(name)[1]
            return read_template(file, up_axis=self._stage.up_axis, taxonomy=self.taxonomy, variants=variants)

        self.world = World(scenario, self._stage, load_template, self.fps, width / height, self._mesh_trees)
        self.width, self.height = width, height
        self._scene = DeviceScene()
        self._measurer = Measurer(self._scene)
        self._loaded = 0  # how many of the world's descriptions are on the device
        self._renderers: dict[tuple[int, int], Renderer] = {}
        self._exposure = self.world.camera.exposure
        self._position = 0

    def __getstate__(self) -> dict[str, Any]:
        """For worker processes: all but what is on the device, which is put there anew, and but who is told of it."""
        kept = {name: value for name, value in vars(self).items() if name not in ON_DEVICE}
        return kept | {"_progress": ProgressBar(), "scenario": self.scenario}

    def __setstate__(self, state: dict[str, Any]) -> None:
        scenario, position = state.pop("scenario"), state["_position"]
        vars(self).update(state)
        runtime.start(self.arch)
        self.restart(scenario)
        self.seek(position)

    def __repr__(self) -> str:
        return f"<Stream of {self.scenario.scene} at frame {self._position}: {', '.join(self.buffers)}>"

    @property
    def scenario(self) -> Scenario:
        """What was asked for, and the edits: a stream made of it does the same at the same frames."""
        return self.world.scenario

    @property
    def categories(self) -> dict[int, str]:
        """What the ids of the `semantic` buffer mean; 0 is the background."""
        return self.world.categories

    @property
    def position(self) -> int:
        """The index of the frame that `next` gives."""
        return self._position

    def seek(self, index: int) -> Stream:
        """Make frame `index` the next one, at once. Returns the stream."""
        self._position = integer("index", index, 0, self.frames if self.frames is not None else sys.maxsize)
        self.world.next_frame = self._position
        return self

    def __iter__(self) -> Stream:
        return self

    def __next__(self) -> Frame:
        if self.frames is not None and self._position >= self.frames:
            raise StopIteration
        frame = self._render(self._position)
        self.seek(self._position + 1)
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
        end = sys.maxsize if self.frames is None else self.frames
        if isinstance(index, slice):
            parts = index.start, index.stop, index.step if index.start is None else None  # backwards from the end
            if self.frames is None and any(part is not None and part < 0 for part in parts):
                raise ArgumentError(f"{index}: an endless stream cannot be counted from its end")
            return FrameSlice(self, range(end)[index])
        index = operator.index(index)
        if index < 0 and self.frames is not None:
            index += self.frames
        if not 0 <= index < end:
            outside = "negative" if self.frames is None and index < 0 else f"outside 0..{end - 1}"
            raise IndexError(f"frame {index} is {outside}")
        return self._render(index)

    def state_dict(self) -> dict[str, Any]:
        """Where the stream stands and what it shows, as JSON-ready values below 1 kB."""
        return {"version": 1, "position": self._position, "settings": self.settings()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Go on where `state_dict` was taken; raises ArgumentError, changing nothing, if that was another stream."""
        is_state = isinstance(state, Mapping) and isinstance(state.get("settings"), Mapping) and "position" in state
        if not is_state or state.get("version") != 1:
            raise ArgumentError("this is not a state_dict of this version of tiscene (version 1)")
        theirs, ours = state["settings"], self.settings()
        if different := [name for name in ours if theirs.get(name) != ours[name]]:
            listing = ", ".join(f"{name}: {theirs.get(name)!r} there, {ours[name]!r} here" for name in different)
            raise ArgumentError(f"the state is of another stream, or of this one with other edits ({listing})")
        self.seek(state["position"])

    def settings(self) -> dict[str, Any]:
        """Everything that a frame depends on beside its index, JSON-ready; the scenario as its SHA-256 digest."""
        canonical = json.dumps(self.scenario.to_json(), sort_keys=True, separators=(",", ":"))
        return {
            "scenario": hashlib.sha256(canonical.encode()).hexdigest(),
            "width": self.width,
            "height": self.height,
            "fps": self.fps,
            "seed": self.seed,
            "spp": self.quality.spp,
            "max_depth": self.quality.max_depth,
            "error": self.quality.error,
            "clamp": self.quality.clamp,
            "pixel_filter": self.quality.pixel_filter,
            "downscale": self.quality.downscale,
            "denoiser": self.quality.denoiser if self.quality.denoise else None,
            "shutter": None if self.shutter is None else list(self.shutter),
            "time_code": self.time_code,
            "variants": self.variants,
            "taxonomy": self.taxonomy,
            "incremental": [*self.quality.of_differences, self._cache_bytes] if self.incremental else None,
        }

    def file_digests(self) -> dict[str, str]:
        """SHA-256 of every file that the scene and the scenario's templates are made of.

        Keys: the path relative to the scene's folder; of a template, its name, a colon and the path in its folder.
        """
        on_stage = {template.name for template in self.world.stage.templates}
        return scene_digests(self.scenario.scene, {life.spec.template for life in self.scenario.lives()} - on_stage)

    def to_usd(self, path: str | os.PathLike[str], frames: int | Iterable[int] | None = None) -> None:
        """Write the motion as a USD layer over the scene (.usda, .usdc, .usd), to be played in any USD program.

        frames: how many, from 0 on, or their numbers; by default all of the stream's. Time code k is frame k.
        Objects are references to their templates, with time samples of pose and visibility; nothing is rendered.
        """
        frames = self.frames if frames is None else frames
        if frames is None:
            raise ArgumentError("frames=None: an endless stream cannot be written whole; say how many frames")
        write_motion(self.world, path, frames)

    @property
    def exposure(self) -> float:
        """Stops by which `rgb` is exposed: the camera's, else metered once by what the stream's own camera sees."""
        if self._exposure is None:
            # At frame 0 whatever frame is asked for first, so that a seek changes no pixel.
            view = View(*self.world.view(0), width=self.width, height=self.height)
            self._exposure = self._renderer(view).meter(view, self._placement(0), seed=self.seed)
        return self._exposure

    def render_view(
        self,
        index: int,
        view: View,
        buffers: Sequence[str],
        incremental: bool | None = None,
        camera_at: Callable[[Fraction], Camera] | None = None,
    ) -> Frame:
        """Frame `index` as other cameras see it, or in another size; in the exposure of the stream's own camera.

        incremental: whether color is a difference to an image that this view has of what never moves; None: as the
        stream's own frames are, if the camera is that of its frame 0. camera_at: where it is by so many frames from the
        index, while its shutter is open; None: it goes straight from one camera of the view to the next.
        """
        runtime.check_process()
        seen = None
        if not COLORS.isdisjoint(buffers):
            numbers = {"spp": self.quality.spp, "seed": self.seed}
            seen = moments(self.world, index, view, self.shutter, camera_at=camera_at, **numbers)
        if incremental is None:
            incremental = self.incremental and is_fixed(self.world, view.current)
        placement = self._placement(index)
        exposure = view.current.exposure
        if exposure is None:
            exposure = self.exposure if "rgb" in buffers else 0.0
        renderer = self._renderer(view)
        rendered = renderer.render(
            view,
            placement,
            buffers,
            frame_index=index,
            seed=self.seed,
            exposure=exposure,
            moving=moving(self.world, index) if incremental and seen is None else None,
            moments=seen or (),
        )
        return Frame(
            index=index,
            time=index / self.fps,
            camera=FrameCamera(view.current, view.width, view.height),
            buffers=rendered,
            objects=self._measurer.table(placement, view, self.world.objects(index), rendered.get("instance")),
            categories=self.categories,
            materials=self._scene.materials.labels,
            spp=renderer.spp if not COLORS.isdisjoint(buffers) else 0.0,
            events=tuple(self.world.events(index, (view.previous, view.current, view.next), view.width / view.height)),
        )

    def _render(self, index: int) -> Frame:
        first, *others = [
            self.render_view(
                index,
                View(*self.world.view(index, row), width=self.width, height=self.height),
                self.buffers,
                camera_at=lambda shift, row=row: self.world.camera_at(index, shift, row),  # type: ignore[misc]
            )
            for row in range(len(self.world.cameras))
        ]
        return replace(first, others=tuple(others)) if others else first

    def _renderer(self, view: View) -> Renderer:
        """One for each size; of those that were not used for longest nothing is kept."""
        size = view.width, view.height
        renderer = self._renderers.pop(size, None) or Renderer(
            self._scene, *size, self.quality, cache_bytes=self._cache_bytes, progress=self._progress
        )
        self._renderers[size] = renderer
        if len(self._renderers) > MAX_RENDERERS:
            del self._renderers[next(iter(self._renderers))]
        return renderer

    def relight(self, row: int, light: Light) -> None:
        """Put another light of the same kind in the place of the stage's in that row, for all frames from now on.

        What `world` edits is replayed; this is not: it is no part of the scenario.
        """
        self.world.relight(row, light)

    def _placement(self, index: int) -> Placement:
        """Where everything is; what the world has loaded since the last time goes to the device first."""
        placement = self.world.placement(index)
        self._load()
        return placement

    def _load(self) -> None:
        for description in self.world.descriptions[self._loaded :]:
            self._scene.add(description)
            self._loaded += 1

    def _mesh_trees(self) -> MeshTrees:
        """What rays walk through serves for collisions too."""
        self._load()
        return self._scene.trees
