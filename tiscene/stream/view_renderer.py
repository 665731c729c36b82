# SPDX-License-Identifier: Apache-2.0
"""ViewRenderer: renders views of one world; owns everything that lives on the device."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynamics.lru_cache import LRUCache
from dynamics.whole_changes import WholeChanges, as_a_whole
from tiscene.device import runtime
from tiscene.frame.buffers import COLORS, complete, rendered_buffers
from tiscene.frame.frame import Frame, FrameCamera
from tiscene.render.annotations.object_measurements import Measurer
from tiscene.render.integrators.incremental.base_image import ProgressCallback
from tiscene.render.integrators.labels.point_pass import PointPass, SurfacePoints
from tiscene.render.integrators.path.path_image import PathImage
from tiscene.render.render_settings import RenderSettings
from tiscene.render.renderer import Renderer, ShutterSample
from tiscene.render.view import View
from tiscene.scene.bvh.obstacle_tree import MeshTrees
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT, Placement
from tiscene.scene.walking import Axes
from tiscene.stream.shutter import shutter_samples
from tiscene.world.world import World
from tiscene.world.world_state import CameraStep, WorldState

Labels = Mapping[str, NDArray[Any]]  # label buffers by name
MAX_RENDERERS = 4  # image sizes whose arrays are kept


@dataclass(frozen=True)
class Prepared:
    """What has been rendered of one view of a frame, together with other frames.

    Attributes:
        labels: label buffers.
        light: what the path tracer found; None: it has not run.
    """

    labels: Labels = field(default_factory=dict)
    light: PathImage | None = None


@dataclass(frozen=True)
class Pixels:
    """The part of a frame that takes time to render.

    Attributes:
        buffers: arrays by name.
        instance: the `instance` buffer, if it was rendered.
        spp: samples per pixel of the color buffers.
    """

    buffers: Mapping[str, NDArray[Any]]
    instance: NDArray[np.int32] | None
    spp: float

    @classmethod
    def of(cls, frame: Frame) -> Pixels:
        """Return the pixels of a frame."""
        return cls(frame.buffers, frame.buffers.get("instance"), frame.spp)


class ViewRenderer(WholeChanges):
    """Renders frames of a world from any camera, in any size.

    Args:
        settings: what the path tracer may cost.
        seed: of the rendering's random numbers.
        shutter: opening and closing time in frames relative to each frame; None: as the cameras say.
        cache_bytes: memory limit of kept paths.
        progress: receives what is being prepared and how much of it is done, 0..1.
    """

    def __init__(
        self,
        settings: RenderSettings,
        *,
        seed: int,
        shutter: tuple[float, float] | None,
        cache_bytes: int,
        progress: ProgressCallback,
    ) -> None:
        self.settings = settings
        self._seed = seed
        self._shutter = shutter
        self._cache_bytes = cache_bytes
        self._progress = progress
        self._session = runtime.session()
        self._renderers: LRUCache[tuple[int, int], Renderer] = LRUCache(MAX_RENDERERS)
        self._metered: tuple[int, float] | None = None  # edits of frame 0 before the metering; stops

    def check_session(self) -> None:
        """Raise DeviceError if this process is a fork, or if the user's code has restarted Taichi."""
        runtime.check_session(self._session)

    def set_world(self, world: World, stage_trees: MeshTrees | None) -> None:
        """Render a world. The scene's arrays are made when they are needed.

        Args:
            world: the world.
            stage_trees: trees of its stage's meshes, if they are known.
        """
        self.world = world
        world.trajectories.progress = self._progress
        scene = DeviceScene(stage_trees=stage_trees)
        self._compensation = world.scenario.exposure_compensation
        self._measurer, self._points = Measurer(scene), PointPass(scene)
        self._descriptions, self._scene = world.descriptions, scene

    def close(self) -> None:
        """Drop all arrays now. The world refers back to this object, so they would wait for the cyclic collector.

        Frames that are kept can still be measured: they refer to the measurer and to the world's trajectories.
        """
        with runtime.ONE_THREAD:  # not in the middle of a frame or of a measurement
            self._measurer.close()
            self.world.trajectories.close()
        vars(self).clear()

    @as_a_whole
    def mesh_trees(self) -> MeshTrees:
        """Return the bounding volume hierarchies of the meshes, which serve collisions too."""
        self._upload_descriptions()
        return self._scene.trees

    def stage_trees(self) -> MeshTrees | None:
        """Return the trees of the stage's meshes alone; None if they were not needed, or Taichi was restarted."""
        is_built = self._session is runtime.session() and self._scene.descriptions and not self._is_outdated
        return self._scene.copied_stage_trees() if is_built else None

    @as_a_whole
    def exposure(self, width: int, height: int) -> float:
        """Return the main camera's exposure in stops, with the scenario's compensation.

        If it has none, it is metered at frame 0, as the camera frames images of that size.

        It is metered at frame 0 whatever frame is rendered first, so that a seek changes no pixel, and again after
        edits of frame 0, as a replay of them does.
        """
        world = self.world
        if world.camera.exposure is not None:
            return world.camera.exposure + self._compensation
        if self._metered is None or self._metered[0] != world.start_edits:
            # To move the camera, or to dim a light, must not change how bright the scene is otherwise.
            placement, cameras = world.planned_start()
            self._upload_descriptions()
            view = View(*cameras, width=width, height=height)
            stops = self._renderer(view).auto_exposure(view, placement, seed=self._seed)
            self._metered = world.start_edits, stops
        return self._metered[1] + self._compensation

    @as_a_whole
    def render(
        self,
        state: WorldState,
        view: View,
        buffers: Sequence[str],
        *,
        main_size: tuple[int, int],
        camera_row: int | None = None,
        since: int | None = None,
        incremental: bool | None = None,
        pixels: Pixels | None = None,
        prepared: Prepared | None = None,
    ) -> Frame:
        """Render one view of a world state.

        Args:
            state: of the world, at the frame to render.
            view: the camera at frames k - 1, k and k + 1, and the image size.
            buffers: names of the buffers to compute.
            main_size: width and height of the images of the main camera, px, which say what it is metered on.
            camera_row: the world's camera that this is, whose path the shutter follows; None: the view's cameras are
                interpolated.
            since: frame from which `backward_flow` is measured; None: the one before.
            incremental: overrides the stream's setting for this frame.
            pixels: what another process has rendered; None: rendered here.
            prepared: what `render_batch` has rendered of it.

        Returns:
            The frame, in the exposure of the world's main camera unless the view's camera has its own.
        """
        self.check_session()
        if since is not None and since != state.frame - 1:
            state = replace(state, placement=state.placement.since(self.world.state(since).placement))
        self._upload_descriptions()
        if pixels is None:
            pixels = self._pixels(state, view, buffers, main_size, camera_row, incremental, prepared or Prepared())
        step = CameraStep(view.previous, view.current, view.next)
        return Frame(
            index=state.frame,
            time=state.frame / self.world.fps,
            camera=FrameCamera(view.current, view.width, view.height),
            buffers=pixels.buffers,
            objects=self._measurer.table(state.placement, view, state.objects, pixels.instance),
            categories=self.world.categories,
            materials=self._scene.materials.labels,
            spp=pixels.spp,
            events=state.events(step, view.width / view.height),
            room=state.room_of(view.current),
            _novelty=self.world.view_history.of_frame(state.frame, camera_row or 0, view.current),
        )

    def _pixels(
        self,
        state: WorldState,
        view: View,
        buffers: Sequence[str],
        main_size: tuple[int, int],
        camera_row: int | None,
        incremental: bool | None,
        prepared: Prepared,
    ) -> Pixels:
        """Render the buffers of one view that are not prepared; arguments as of `render`."""
        names, buffers = buffers, rendered_buffers(buffers)
        labels = prepared.labels
        missing = [name for name in buffers if name not in labels]
        if not missing:
            return Pixels(complete(names, labels), labels.get("instance"), 0.0)
        colored = not COLORS.isdisjoint(buffers)
        samples, moving = None, None
        if colored and prepared.light is None:
            samples, moving = self._shared_light(state, view, camera_row, incremental)
        own = [each.exposure for each in (view.current, state.cameras[0].current) if each.exposure is not None]
        if own:
            exposure = own[0] + self._compensation
        else:
            exposure = self.exposure(*main_size) if "rgb" in buffers else 0.0
        renderer = self._renderer(view)
        rendered = renderer.render(
            view,
            state.placement,
            missing,
            frame_index=state.frame,
            seed=self._seed,
            exposure=exposure,
            moving=moving,
            shutter_samples=samples or (),
            light=prepared.light,
        )
        rendered = {name: labels[name] if name in labels else rendered[name] for name in buffers}
        return Pixels(complete(names, rendered), rendered.get("instance"), renderer.spp if colored else 0.0)

    @as_a_whole
    def surface_points(
        self, placement: Placement, view: View, x: NDArray[np.int64], y: NDArray[np.int64]
    ) -> SurfacePoints:
        """Place instances, and return the points of surfaces at pixels; see `PointPass.choose`."""
        self.check_session()
        self._upload_descriptions()
        self._scene.place(placement, (CURRENT,))
        return self._points.choose(view, x, y)

    @as_a_whole
    def follow(
        self, points: SurfacePoints, placement: Placement, view: View
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Place instances, and return where points are, and whether they are hidden; see `PointPass.follow`."""
        self.check_session()
        self._upload_descriptions()
        self._scene.place(placement, (CURRENT,))
        return self._points.follow(points, view)

    @as_a_whole
    def render_batch(
        self, states: Sequence[WorldState], buffers: Sequence[str], width: int, height: int
    ) -> list[tuple[WorldState, list[Prepared]]]:
        """Render labels and light of several frames at once, where that is possible.

        Args:
            states: of the world, at the frames to render.
            buffers: names of the buffers of the frames.
            width: image width, px.
            height: image height, px.

        Returns:
            For each state, itself and what is rendered of each camera; the rest is to be rendered one by one.
        """
        self.check_session()
        self._upload_descriptions()
        buffers = rendered_buffers(buffers)
        names = [name for name in buffers if name not in COLORS]
        placements = [state.placement for state in states]
        found: list[list[Prepared]] = [[] for _ in states]
        for row in range(len(states[0].cameras)):
            views = [self.view(state, row, buffers, width, height) for state in states]
            renderer = self._renderer(views[0])
            labels = renderer.render_labels(views, placements, names) or [{} for _ in states]
            light: Sequence[PathImage | None] = [None] * len(states)
            shared = (self._shared_light(*each, row) for each in zip(states, views, strict=True))
            if len(names) < len(buffers) and all(part is None for parts in shared for part in parts):
                indices = [state.frame for state in states]
                light = renderer.trace_frames(views, placements, indices, seed=self._seed) or light
            for each, drawn, image in zip(found, labels, light, strict=True):
                each.append(Prepared(drawn, image))
        return list(zip(states, found, strict=True))

    def view(self, state: WorldState, row: int, buffers: Sequence[str], width: int, height: int) -> View:
        """Return the view of one of the world's cameras.

        Args:
            state: of the world, at the frame to render.
            row: the camera.
            buffers: names of the buffers to render: where it walks is found for color that frames share.
            width: image width, px.
            height: image height, px.
        """
        is_shared = self.settings.incremental and not COLORS.isdisjoint(rendered_buffers(buffers))
        walks = self.world.camera_walks(state.frame, row) if is_shared else Axes()
        is_dynamic, zooms = self.world.camera_is_dynamic(state.frame, row), self.world.camera_zooms(row)
        return View(*state.cameras[row], width, height, is_dynamic=is_dynamic, walks=walks, zooms=zooms)

    def _shared_light(
        self, state: WorldState, view: View, camera_row: int | None, incremental: bool | None = None
    ) -> tuple[Iterator[ShutterSample] | None, NDArray[np.bool_] | None]:
        """Return what the light of a view shares with other times or frames; arguments as of `render`.

        Returns:
            The times at which the shutter is open, if it is; else the movers, if the frame may be rendered
            incrementally. Two times None: the frame is path traced by itself.
        """
        samples = shutter_samples(
            self.world, state, view, self._shutter, spp=self.settings.spp, seed=self._seed, camera_row=camera_row
        )
        incremental = self.settings.incremental if incremental is None else incremental
        # Frames share light if theirs is that of the stream's start. This depends on the frame alone.
        if incremental and samples is None and state.starting_lights and self._renderer(view).shares_light(view):
            return None, state.movers
        return samples, None

    def _upload_descriptions(self) -> None:
        """Add the world's stage and templates to the device scene, as far as they are not there."""
        if self._is_outdated:
            self._start_over()
        for description in self.world.descriptions[len(self._scene.descriptions) :]:
            self._scene.add(description)

    @property
    def _is_outdated(self) -> bool:
        """Whether an exception has ended a change of the scene, the rendering of a frame, or an edit of the world."""
        is_other_world = self._descriptions is not self.world.descriptions
        return self.is_unfinished or self._scene.is_unfinished or is_other_world

    def _start_over(self) -> None:
        """Make all that is on the device anew. Frames that are kept measure with a scene of their own."""
        self._renderers.drop(lambda _size: True)
        self._measurer.close()
        self.world.trajectories.use_trees(self.mesh_trees)
        self.set_world(self.world, None)
        self.is_unfinished = False

    def _renderer(self, view: View) -> Renderer:
        """Return the renderer of an image size."""
        size = view.width, view.height
        return self._renderers.get(
            size,
            lambda: Renderer(self._scene, *size, self.settings, cache_bytes=self._cache_bytes, progress=self._progress),
        )


def render_all_cameras(
    renderer: ViewRenderer,
    state: WorldState,
    buffers: Sequence[str],
    width: int,
    height: int,
    pixels: Sequence[Pixels] | None = None,
    prepared: Sequence[Prepared] | None = None,
) -> Frame:
    """Render a frame from each of the world's cameras; the first holds the others as `views`.

    Args:
        renderer: of the world.
        state: of the world, at the frame to render.
        buffers: names of the buffers to compute.
        width: image width, px.
        height: image height, px.
        pixels: what another process has rendered, one for each camera; None: rendered here.
        prepared: what `ViewRenderer.render_batch` has rendered, for each camera.
    """
    first, *others = [
        renderer.render(
            state,
            renderer.view(state, row, buffers, width, height),
            buffers,
            main_size=(width, height),
            camera_row=row,
            pixels=None if pixels is None else pixels[row],
            prepared=None if prepared is None else prepared[row],
        )
        for row in range(len(state.cameras))
    ]
    return replace(first, _other_views=tuple(others)) if others else first
