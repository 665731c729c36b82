# SPDX-License-Identifier: Apache-2.0
"""Environment: one world, one clock, and the agents that look at it. All that SAILenv's Unity program did.

Agents share the scene, its objects and lights; each has its own place, size, background and views. The clock is in
lock step: it goes on by one frame, 1 / fps seconds, when an agent asks for a frame and has had the current one; an
agent that has not is shown the current one. So a lone agent sees every frame, several agents that ask in turn see the
same frames, and one that is slow misses some, as it did when SAILenv ran in real time. What an agent does to the world
shows in the frame after the current one, which is then its next.

Everything here is in Unity's space, as `tiscene.sailenv.unity_coordinates` explains. Nothing here waits, or knows of threads.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

import tiscene.scenario.objects as native_objects
import tiscene.scenario.scenario as native
from tiscene.device import runtime
from tiscene.errors import ArgumentError, ScenarioError, TisceneError
from tiscene.render.film.tone_map import radiance_shown_as
from tiscene.render.renderer import quality_named
from tiscene.render.view import SKY, View
from tiscene.sailenv import asset_names, frame_views, json_messages
from tiscene.sailenv.agent_camera import AgentCamera
from tiscene.sailenv.json_messages import bounded
from tiscene.sailenv.light_controls import Color8, LightControls, clipped, linear, whole
from tiscene.sailenv.scene_profile import SceneProfile
from tiscene.sailenv.unity_coordinates import euler_of, mirrored, mirrored_euler, quaternion_of
from tiscene.sailenv.uploaded_models import Uploads
from tiscene.scene.camera import Camera, Vector3
from tiscene.scene.description import Light
from tiscene.stream.stream import Stream
from tiscene.validation import integer, positive

MAX_SIDE, MAX_PIXELS = 8192, 3840 * 2160
STILL_FRAMES = 25
_SENT = "file:"


class Environment:
    """A world that agents share.

    scene: its first scene, SAILenv's name or tiscene's. The others as of `Stream`.
    clock: the number of the current frame, -1 before the first.
    """

    def __init__(
        self,
        scene: str | None = None,
        *,
        fps: float = 25.0,
        quality: str = "preview",
        spp: int | None = None,
        max_depth: int | None = None,
        denoise: bool | None = None,
        seed: int = 0,
        arch: str | None = None,
    ) -> None:
        self.fps = positive("fps", fps)
        # The world is made when it is needed; what cannot be is said now, before clients come.
        parts = {"spp": spp, "max_depth": max_depth, "denoise": denoise}
        quality_named(quality, **parts)
        integer("seed", seed, 0, 2**32 - 1)
        runtime.start(arch)
        self.clock = -1
        self.viewers: dict[int, AgentCamera] = {}
        self._first_scene = scene or asset_names.first_scene()
        asset_names.scene_of(self._first_scene)
        self._settings: dict[str, Any] = {"fps": self.fps, "quality": quality, **parts, "seed": seed, "arch": arch}
        self.uploads = Uploads()
        self._stream: Stream | None = None
        self._ambient: Color8 = (0, 0, 0)
        self._changed = 0  # the frame since which nothing was done to the world
        self._seen: dict[Any, dict[str, NDArray[Any]]] = {}  # what was rendered of the current frame, by view
        self._walls: tuple[AgentCamera, native_objects.Frustum] | None = None  # whose view has walls, and what kind
        self._walls_camera: Camera | None = None  # where they are
        self._next_id = 0

    # Agents.

    def register(self, width: int, height: int) -> AgentCamera:
        """A new agent, where those of the scene begin. Raises ArgumentError for a size out of bounds."""
        if not (0 < width <= MAX_SIDE and 0 < height <= MAX_SIDE and width * height <= MAX_PIXELS):
            raise ArgumentError(
                f"{width}x{height} px: a side must be from 1 to {MAX_SIDE}, and all at most {MAX_PIXELS} pixels"
            )
        viewer = AgentCamera(self._next_id, width, height)
        self._next_id += 1
        self.viewers[viewer.id] = viewer
        if self._stream is not None:
            self._put_at_start(viewer)
        return viewer

    def delete(self, viewer: AgentCamera) -> None:
        """The agent is gone. What it spawned stays."""
        self.viewers.pop(viewer.id, None)

    def behind(self, viewer: AgentCamera) -> list[AgentCamera]:
        """The other agents that take frames and have not had the current one, if this one's next is not that."""
        if not self._next_is_new(viewer):
            return []
        others = (each for each in self.viewers.values() if each is not viewer and each.stepping)
        return [each for each in others if not self._next_is_new(each)]

    def frame(self, viewer: AgentCamera, wanted: Sequence[str]) -> tuple[dict[str, NDArray[Any]], float]:
        """The views named (keys of `views.VIEWS`), and the seconds since the agent's last frame."""
        stream = self._world()
        if self._next_is_new(viewer):
            self.clock += 1
            self._carry_walls(stream)
            stream.seek(self.clock + 1)
            self._seen.clear()
        steps = self.clock - viewer.taken if viewer.taken >= 0 else 1
        camera = self._camera(viewer, self.clock)
        background = SKY if viewer.background is None else radiance_shown_as(viewer.background, stream.exposure)
        view = View(
            viewer.last_camera or camera,
            camera,
            camera,
            viewer.width,
            viewer.height,
            self._ambient_radiance(),
            background,
        )
        if camera != viewer.last_camera:
            viewer.still_since = self.clock
        buffers = self._buffers(stream, view, viewer, wanted)
        viewer.taken, viewer.acted, viewer.stepping, viewer.last_camera = self.clock, False, True, camera
        numbers = np.array([self._place.number(name) for _, name in sorted(stream.categories.items())], np.uint8)
        result = {name: frame_views.VIEWS[name].of(buffers, numbers) for name in wanted}
        if viewer.background is not None and "main" in result:
            frame_views.clear(result["main"], buffers["instance"], viewer.background)
        return result, steps / self.fps

    def position(self, viewer: AgentCamera) -> Vector3:
        """m."""
        self._world()
        return self._pose(viewer)[0]

    def rotation(self, viewer: AgentCamera) -> Vector3:
        """Euler degrees: as they were set, or in 0..360."""
        self._world()
        return self._pose(viewer)[1]

    def place(self, viewer: AgentCamera, position: Vector3 | None = None, rotation: Vector3 | None = None) -> None:
        """Put an agent somewhere or turn it, from its next frame on. Raises ArgumentError."""
        self._world()
        here, turned = self._pose(viewer)
        viewer.position = here if position is None else bounded(position)
        viewer.rotation = turned if rotation is None else bounded(rotation)
        viewer.placed = True
        viewer.follows_since = None

    def toggle_follow(self, viewer: AgentCamera) -> None:
        """Join the scene's camera track at its beginning, or leave it and stay there."""
        self._world()
        if viewer.follows_since is None:
            viewer.follows_since = self.clock + 1
        else:
            viewer.position, viewer.rotation = self._pose(viewer)
            viewer.follows_since, viewer.placed = None, True

    def clear(self, viewer: AgentCamera, color: Sequence[int]) -> None:
        """What an agent sees where nothing is: an 8-bit color; with a negative part, the sky."""
        color = whole(color)
        viewer.background = None if min(color) < 0 else clipped(color)

    # The world.

    def scenes(self) -> list[str]:
        """The scenes there are."""
        return asset_names.scenes()

    def spawnable(self) -> list[str]:
        """What can be spawned."""
        return asset_names.spawnable()

    def categories(self) -> dict[int, str]:
        """Names by the numbers that `category` views hold: the scene's, then those of all else that can be spawned."""
        for category in self._world().categories.values():
            self._place.number(category)
        return {number: name for name, number in self._place.numbers.items() if number != frame_views.NO_CATEGORY}

    @property
    def lights(self) -> LightControls:
        """The scene's lights; changes show from the next frame on."""
        self._world()
        return self._lights

    @property
    def ambient(self) -> Color8:
        """Light that comes from nowhere and reaches every surface alike, 8-bit sRGB; none at first."""
        return self._ambient

    def set_ambient(self, color: Sequence[int]) -> None:
        """Values beyond 0..255 count as those."""
        self._ambient = clipped(color)
        self._seen.clear()

    def change_scene(self, name: str) -> None:
        """Begin anew in a scene; agents begin where those of the scene do. Raises SceneNotFound, StageError."""
        self._enter(asset_names.scene_of(name))
        for viewer in self.viewers.values():
            self._put_at_start(viewer)

    def load(self, viewer: AgentCamera, content: Mapping[str, Any]) -> tuple[list[str], list[str]]:
        """Begin anew with a scenario: for each of its objects the id, "" if it cannot be; and what is wrong with those.

        Agents that were put somewhere stay there. Raises a TisceneError, changing nothing, if all of it is wrong.
        """
        scene = asset_names.scene_of(str(content.get("scene_name")))
        contents = content.get("objects") or []
        if not isinstance(contents, list) or not all(isinstance(each, dict) for each in contents):
            raise ScenarioError("objects: must be a list of objects")
        ids = json_messages.object_ids(contents)
        objects, problems = [], []
        for id, each in zip(ids, contents, strict=True):
            try:
                made = json_messages.object_of(each, id)
                objects.append(replace(made, template=self._template(made.template)))
            except TisceneError as error:
                problems.append(str(error))
        timings = json_messages.timings_of(content.get("timings"), ids, {each.id for each in objects})
        # Early clients that load scenarios call it otherwise.
        frustum = json_messages.frustum_of(content.get("frustum", content.get("spawn_frustum")))
        scenario = native.Scenario(
            scene, objects, timings, frustum
        )  # finds what contradicts itself, before anything changes
        self._enter(scene, scenario, viewer)
        for each in self.viewers.values():
            if not each.placed:
                self._put_at_start(each)
        numbers = {row.name: str(row.id) for row in self._world().world.objects(0) if row.template}
        return [numbers.get(id, "") for id in ids], problems

    def spawn(
        self,
        viewer: AgentCamera,
        name: str,
        position: Vector3,
        rotation: Vector3,
        *,
        scale: Vector3 = (1.0, 1.0, 1.0),
        frustum_limited: bool = True,
        dynamic: tuple[str, Mapping[str, Any]] | None = None,
    ) -> str:
        """Let an object appear; its id. dynamic: type and description. Raises ScenarioError, TemplateNotFound."""
        self._acted(viewer)
        return str(
            self._world().world.spawn(
                self._template(name),
                mirrored(bounded(position)),
                mirrored_euler(bounded(rotation)),
                None if dynamic is None else json_messages.dynamic_of(*dynamic),
                scale=scale,
                frustum_limited=frustum_limited,
            )
        )

    def despawn(self, viewer: AgentCamera, number: int) -> None:
        """Let an object be gone. Raises ObjectNotFound."""
        self._world().world.despawn(number)
        self._acted(viewer)

    def move(self, viewer: AgentCamera, number: int, position: Vector3, rotation: Vector3) -> None:
        """Put an object elsewhere. Raises ObjectNotFound, ScenarioError."""
        self._world().world.move(number, mirrored(bounded(position)), mirrored_euler(bounded(rotation)))
        self._acted(viewer)

    def set_frustum_walls(self, viewer: AgentCamera) -> None:
        """Walls at the sides of an agent's view, up to its far plane; they go where it goes."""
        self._world()
        self._walls, self._walls_camera = (viewer, native_objects.Frustum()), None
        self._acted(viewer)

    def close(self) -> None:
        """Forget what was sent."""
        self.uploads.close()

    # How.

    def _acted(self, viewer: AgentCamera) -> None:
        """An agent has done something to the world: its next frame is a new one, which shows that."""
        viewer.acted, self._changed = True, self.clock + 1

    def _carry_walls(self, stream: Stream) -> None:
        """Put the walls where their agent is in the current frame, if that is elsewhere than before."""
        if self._walls is None:
            return
        viewer, frustum = self._walls
        camera = self._camera(viewer, self.clock)
        if camera != self._walls_camera:
            stream.world.set_frustum_walls(frustum, camera, viewer.width / viewer.height)
            self._walls_camera = camera

    def _next_is_new(self, viewer: AgentCamera) -> bool:
        return self.clock < 0 or viewer.acted or viewer.taken == self.clock

    def _world(self) -> Stream:
        """The stream, which is made when it is needed first."""
        if self._stream is None:
            self._enter(asset_names.scene_of(self._first_scene))
            for viewer in self.viewers.values():
                self._put_at_start(viewer)
        assert self._stream is not None
        return self._stream

    def _enter(self, scene: str, scenario: native.Scenario | None = None, viewer: AgentCamera | None = None) -> None:
        """Begin anew in a scene, with what its author lets happen or with a scenario that an agent has loaded."""
        stream = self._stream
        if stream is None or stream.scenario.scene != scene:
            stream = Stream(native.Scenario.load(scene), width=64, height=48, **self._settings)
            self._place = SceneProfile.of(stream)
        self._walls = self._walls_camera = None
        if scenario is None or viewer is None:
            stream.restart(self._place.authored)
        else:
            camera = self._camera(viewer, 0) if viewer.placed else self._place.start
            stream.restart(replace(scenario, camera=camera), width=viewer.width, height=viewer.height)
            if scenario.frustum is not None:
                self._walls, self._walls_camera = (viewer, scenario.frustum), camera
        stream.seek(0)
        listed = asset_names.relied_on()["lights"].get(scene, ["Directional Light"])
        self._lights = LightControls(stream.world.stage.lights, listed, self._relight)
        self._stream = stream
        self._ambient = (0, 0, 0)
        self._seen.clear()
        self.clock, self._changed = -1, 0
        for each in self.viewers.values():
            each.taken, each.acted, each.last_camera, each.still_since = -1, False, None, 0
            each.follows_since = None if each.follows_since is None else 0

    def _put_at_start(self, viewer: AgentCamera) -> None:
        start = self._place.start
        viewer.position, viewer.rotation = mirrored(start.position), euler_of(start.rotation)
        viewer.placed, viewer.follows_since = False, None

    def _pose(self, viewer: AgentCamera) -> tuple[Vector3, Vector3]:
        """Position and Euler angles at the agent's frame."""
        if viewer.follows_since is None:
            return viewer.position, viewer.rotation
        camera = self._camera(viewer, max(self.clock, viewer.follows_since))
        return mirrored(camera.position), euler_of(camera.rotation)

    def _camera(self, viewer: AgentCamera, frame: int) -> Camera:
        """What an agent sees by, at a frame."""
        if viewer.follows_since is None:
            return self._place.start.with_pose(mirrored(viewer.position), quaternion_of(viewer.rotation))
        since = (frame - viewer.follows_since) / Fraction(str(self.fps))
        return self._place.start.with_pose(*self._place.track.pose(since))

    def _buffers(
        self, stream: Stream, view: View, viewer: AgentCamera, wanted: Sequence[str]
    ) -> dict[str, NDArray[Any]]:
        """The frame's buffers that views are made of; those of an equal view are not rendered again."""
        needed = {buffer for name in wanted for buffer in frame_views.VIEWS[name].buffers}
        if viewer.background is not None and "main" in wanted:
            needed.add("instance")
        # What stands still before a camera that does is worth a picture of its own; later frames differ little from it.
        still = self.clock - max(viewer.still_since, self._changed) >= STILL_FRAMES
        key = (view.cameras, view.width, view.height, viewer.background, still)
        seen = self._seen.setdefault(key, {})
        missing = sorted(needed - set(seen))
        if missing:
            seen.update(stream.render_view(self.clock, view, missing, incremental=still).buffers)
        return seen

    def _template(self, name: str) -> str:
        """tiscene's name of what SAILenv calls `name`, or the file of what was sent to this world."""
        name = str(name)  # what agents in process ask for may be anything
        if name.startswith(_SENT):
            return self.uploads.template(name.removeprefix(_SENT))
        return asset_names.template_of(name)

    def _relight(self, row: int, light: Light) -> None:
        self._world().relight(row, light)
        self._seen.clear()
        self._changed = self.clock + 1

    def _ambient_radiance(self) -> tuple[float, float, float]:
        """What makes a white surface as bright as the ambient color, at the world's exposure."""
        if not any(self._ambient):
            return (0.0, 0.0, 0.0)
        r, g, b = (part * 2.0 ** -self._world().exposure for part in linear(self._ambient))
        return (r, g, b)
