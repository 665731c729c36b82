# SPDX-License-Identifier: Apache-2.0
"""The running scene of an environment: its stream, profile and lights.

One stream serves all scenes, so that starting another scene frees the memory of the one before, and the stages that
were read last are not read again.
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


class SceneSession:
    """The running scene.

    Attributes:
        stream: The stream that simulates and renders it. Raises AttributeError before the first scene, as the others.
        profile: Its profile.
        lights: Its lights by SAILenv's names.
        category_numbers: Numbers of its categories, and of those of all templates.
    """

    stream: Stream
    profile: SceneProfile
    lights: LightControls
    category_numbers: CategoryNumbers

    def __init__(self, settings: Mapping[str, Any]) -> None:
        """Start nothing.

        Args:
            settings: Arguments of `Stream` for all scenes.
        """
        self._settings = settings
        self._opened: Stream | None = None
        self._profiles: dict[str, SceneProfile] = {}
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
        if scene not in self._profiles:
            authored = Scenario.load(scene)
            if self._opened is None:
                width, height = DEFAULT_SIZE
                self._opened = Stream(authored, width=width, height=height, **self._settings)
            stage = self._opened.stages.stage(authored)
            self._profiles[scene] = SceneProfile.of(authored, stage, self._opened.fps, asset_names.background(scene))
        return self._profiles[scene]

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
        assert self._opened is not None
        stream = self._opened
        width, height = size
        stream.restart(scenario or profile.scenario, width=width, height=height)
        if profile.start.exposure is None:
            profile = self._profiles[scene] = _metered(stream, profile)
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

    def close(self) -> None:
        """Free the memory of the running scene."""
        if self._opened is not None:
            self._opened.close()


def _metered(stream: Stream, profile: SceneProfile) -> SceneProfile:
    """Return a profile with the exposure that its start camera meters; restarts the stream."""
    width, height = DEFAULT_SIZE
    stream.restart(profile.scenario, width=width, height=height)
    start = replace(profile.start, exposure=stream.exposure)
    return replace(profile, start=start, scenario=replace(profile.scenario, camera=start))
