# SPDX-License-Identifier: Apache-2.0
"""The running scene of an environment: its stream, profile and lights.

Sessions of one SceneStreams share the stages that were read last and their trees, so that coming back to one is quick.
Starting another scene frees the memory of the one before.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from tiscene.sailenv import asset_names
from tiscene.sailenv.category_numbers import CategoryNumbers
from tiscene.sailenv.light_controls import LightControls
from tiscene.sailenv.scene_profile import SceneProfile
from tiscene.scenario.scenario import Scenario
from tiscene.scene.camera import Camera
from tiscene.scene.description import Light
from tiscene.stream.stream import Stream

DEFAULT_SIZE = 64, 48  # px; of the stream while no agent's scenario runs; agents have their own sizes


class SceneStreams:
    """Streams with the same settings, one for each scene that runs; and the profiles of all scenes.

    Args:
        settings: Arguments of `Stream`.

    Attributes:
        profiles: Profiles by the scene's name in the catalog.
    """

    def __init__(self, settings: Mapping[str, Any]) -> None:
        self.profiles: dict[str, SceneProfile] = {}
        self._settings = settings
        self._streams: list[Stream] = []
        self._idle: list[Stream] = []

    def take(self, scenario: Scenario) -> Stream:
        """Return a stream that no other session uses; `scenario` is what a new one shows."""
        if self._idle:
            return self._idle.pop()
        if self._streams:
            made: Stream = self._streams[0].another(scenario)
        else:
            made = Stream(scenario, width=DEFAULT_SIZE[0], height=DEFAULT_SIZE[1], **self._settings)
        self._streams.append(made)
        return made

    def give_back(self, stream: Stream) -> None:
        """Free a stream's memory, but for what the pool shares, and let other sessions take it."""
        stream.close(keep_trees=True)
        self._idle.append(stream)

    def close(self) -> None:
        """Free the memory of all streams, and what they share."""
        for each in self._streams:
            each.close()


class SceneSession:
    """The running scene.

    Attributes:
        stream: The stream that simulates and renders it. Raises AttributeError before the first scene, as the others.
        profile: Its profile.
        lights: Its lights by SAILenv's names.
        category_numbers: Numbers of its categories, and of those of all templates.
        pool: Where its stream comes from.
    """

    stream: Stream
    profile: SceneProfile
    lights: LightControls
    category_numbers: CategoryNumbers

    def __init__(self, pool: SceneStreams) -> None:
        """Start nothing.

        Args:
            pool: Where the stream comes from.
        """
        self.pool = pool
        self._opened: Stream | None = None
        self._light_edits: dict[int, Light] = {}  # by row in `stage.lights`

    @property
    def is_running(self) -> bool:
        """Whether a scene has been started."""
        return "stream" in vars(self)

    def profile_of(self, scene: str) -> SceneProfile:
        """Return the profile of a scene; the running scene is not affected.

        Args:
            scene: Its name in the catalog.

        Raises:
            StageError: The scene cannot be read.
        """
        if scene not in self.pool.profiles:
            authored = Scenario.load(scene)
            stream = self._stream_for(authored)
            stage = stream.stages.stage(authored)
            background = asset_names.background(scene)
            self.pool.profiles[scene] = SceneProfile.of(authored, stage, stream.fps, background)
        return self.pool.profiles[scene]

    def start(self, scene: str, scenario: Scenario | None = None, size: tuple[int, int] = DEFAULT_SIZE) -> None:
        """Start a scene at frame 0.

        Args:
            scene: Its name in the catalog.
            scenario: A scenario in that scene; None for the motion that the author of the stage has defined.
            size: Width and height of the image of the scenario's camera, px.

        Raises:
            TisceneError: The scene or the scenario is invalid; nothing has changed then.
        """
        profile = self.profile_of(scene)
        stream = self._stream_for(profile.scenario)
        width, height = size
        stream.restart(scenario or profile.scenario, width=width, height=height)
        if profile.start.exposure is None:
            profile = self.pool.profiles[scene] = _metered(stream, profile)
            exposed = profile.scenario
            if scenario is not None:
                assert isinstance(scenario.camera, Camera)
                exposed = replace(scenario, camera=replace(scenario.camera, exposure=profile.start.exposure))
            stream.restart(exposed, width=width, height=height)
        names = asset_names.sailenv_names()["lights"].get(scene, ["Directional Light"])
        categories = (
            *(each.category for each in stream.world.stage.objects),
            *asset_names.template_categories().values(),
        )
        self.category_numbers = CategoryNumbers(categories)
        self._light_edits.clear()
        self.lights = LightControls(stream.world.stage.lights, names, self._light_edits.__setitem__)
        self.stream, self.profile = stream, profile

    def apply_light_edits(self) -> None:
        """Make the edits of `lights` show in all frames that are rendered from now on."""
        for row, light in self._light_edits.items():
            self.stream.set_light(row, light)
        self._light_edits.clear()

    def _stream_for(self, scenario: Scenario) -> Stream:
        """Return the session's stream; `scenario` is what a new one shows."""
        if self._opened is None:
            self._opened = self.pool.take(scenario)
        return self._opened

    def close(self) -> None:
        """End the scene; its stream goes back to the pool."""
        if self._opened is not None:
            self.pool.give_back(self._opened)
            self._opened = None


def _metered(stream: Stream, profile: SceneProfile) -> SceneProfile:
    """Return a profile with the exposure that its start camera meters; restarts the stream."""
    width, height = DEFAULT_SIZE
    stream.restart(profile.scenario, width=width, height=height)
    start = replace(profile.start, exposure=stream.exposure)
    return replace(profile, start=start, scenario=replace(profile.scenario, camera=start))
