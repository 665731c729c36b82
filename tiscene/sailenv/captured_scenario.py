# SPDX-License-Identifier: Apache-2.0
"""SAILenv scripts and scenarios as scenarios of tiscene, which can be rendered with all buffers and at any frame.

A script is run once, without rendering: its agent gets black views. Its scenario, its edits of the world and the path
of its agent are kept. What a scenario cannot hold is named: colors of lights, ambient light, clear flags.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from dynamics import Keyframes, Waypoint
from tiscene.errors import ScenarioError, StageWarning
from tiscene.sailenv.agent_camera import AgentCamera
from tiscene.sailenv.environment import Environment
from tiscene.sailenv.script_runner import FrameLimitReached, ScriptAgent, agent_class, run_source
from tiscene.scenario.scenario import Scenario
from tiscene.scene.camera import Camera

CHANNELS = {"main": 3, "object": 3, "flow": 2}


@dataclass(eq=False)
class Capture:
    """What a run of a script has shown so far.

    Attributes:
        agent: The id of the agent that is captured, the first that asks for a frame; None before.
        size: Width and height of its image, px.
        fps: Frames per second.
        cameras: Its camera in each frame.
        scenario: The scenario with all edits so far.
        lost: Names of edits that a scenario cannot hold.
    """

    agent: int | None = None
    size: tuple[int, int] = (0, 0)
    fps: float = 0.0
    cameras: list[Camera] = field(default_factory=list)
    scenario: Scenario | None = None
    lost: set[str] = field(default_factory=set)

    def finished(self) -> Scenario:
        """Return the scenario with the agent's camera."""
        if self.scenario is None:
            raise ScenarioError("the script has not asked for any frame")
        first = self.cameras[0]
        if any(camera != first for camera in self.cameras):
            times = [number / self.fps for number in range(len(self.cameras))]
            path = Keyframes(times, [Waypoint(each.position, each.rotation) for each in self.cameras])
            first = replace(first, dynamic=path)
        return replace(self.scenario, camera=first)


class CapturedAgent(ScriptAgent):
    """An agent of a script that is captured."""

    capture: ClassVar[Capture]

    def _render(
        self, environment: Environment, camera: AgentCamera, views: Sequence[str]
    ) -> tuple[dict[str, NDArray[Any]], float]:
        capture = self.capture
        if capture.agent is None:
            capture.agent, capture.size, capture.fps = camera.id, (camera.width, camera.height), environment.fps
        _, seconds = super()._render(environment, camera, ())
        if camera.id == capture.agent:
            if environment.clock < len(capture.cameras):
                capture.lost.add("frames after a change of the scene")
                raise FrameLimitReached(0)
            assert camera.last_camera is not None
            capture.cameras += [camera.last_camera] * (environment.clock + 1 - len(capture.cameras))
            capture.scenario = environment.stream.scenario
            if camera.background is not None:
                capture.lost.add("clear flags")
            if any(environment.ambient):
                capture.lost.add("ambient light")
        return {name: _black(name, camera) for name in views}, seconds

    def _set_light(self, quantity: str, name: str, value: Any) -> None:
        self.capture.lost.add(f"{quantity.replace('_', ' ')} of lights")
        super()._set_light(quantity, name, value)


def capture_scenario(path: Path, frames: int, *, fps: float) -> tuple[Scenario, tuple[int, int], int]:
    """Return a script or a scenario in SAILenv's JSON as a scenario.

    Args:
        path: The script (.py) or scenario (.json).
        frames: The number of frames after which the script is ended.
        fps: Frames per second.

    Returns:
        The scenario, seen by the script's agent; the size of its image, px; the number of frames that it received.

    Raises:
        TisceneError: The file does not exist, is no scenario, or asks for no frame.
    """
    capture = Capture()
    agent = agent_class(CapturedAgent, capture=capture, limit=frames, settings={"fps": fps, "incremental": False})
    run_source(path, (), agent, size=(256, 192))
    scenario = capture.finished()
    if capture.lost:
        text = (
            f"{path.name}: not part of a scenario: {', '.join(sorted(capture.lost))}; `tiscene sailenv record` keeps it"
        )
        warnings.warn(StageWarning(text), stacklevel=2)
    return scenario, capture.size, len(capture.cameras)


def _black(name: str, camera: AgentCamera) -> NDArray[Any]:
    """Return an empty view."""
    channels = (CHANNELS[name],) if name in CHANNELS else ()
    kind = np.float32 if name == "flow" else np.uint8
    return np.full((camera.height, camera.width, *channels), 255 if name == "category" else 0, kind)
