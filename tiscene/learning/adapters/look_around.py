# SPDX-License-Identifier: Apache-2.0
"""LookAround-v0: a Gymnasium environment in which an agent turns and moves the camera, and asks for labels.

Importing this module registers it::

    env = gymnasium.make("tiscene.learning.adapters.look_around:LookAround-v0", scenario="my_scenario.json")

The scenario goes on by one frame with each action. The agent is rewarded for each category that it is told for the
first time in an episode, and pays for each question. `reset` starts at frame 0 again, so episodes with equal actions
in one scenario are equal to the byte.
"""

from __future__ import annotations

import inspect
import math
import os
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from dynamics import argument_checks
from dynamics.rotation import matrix_from_quaternion
from tiscene.errors import ArgumentError, ArgumentTypeError, requires_extra
from tiscene.render.view import View
from tiscene.scenario.scenario import Scenario
from tiscene.scene.camera import Camera, quaternion_from_matrix
from tiscene.scene.walking import Axes, walked_axes
from tiscene.stream.stream import STREAM_ARGUMENTS, Stream

with requires_extra("gymnasium"):
    import gymnasium

ACTIONS = ("stay", "forward", "left", "right", "up", "down", "ask")
BUFFERS = ("rgb", "semantic", "instance", "depth")
UNUSED = {  # arguments of `Stream` that change nothing here, and why
    "buffers": f"an agent sees the observation; the frames have {', '.join(BUFFERS)}",
    "frames": "pass `length`, the frames of an episode",
    "prefetch": "frames depend on the actions, and cannot be rendered ahead",
    "batch": "frames depend on the actions, and cannot be rendered ahead",
}
SETTINGS = tuple(name for name in STREAM_ARGUMENTS if name not in UNUSED)
MAX_PITCH = math.radians(80.0)


class LookAround(gymnasium.Env):  # type: ignore[misc]  # gymnasium is not read
    """Look around in a running scenario.

    Observation: "rgb", uint8 [height, width, 3]; "label", the category id of the last answer, 0 before the first one
    and for the background.

    Actions: 0 stay, 1 forward, 2 to 5 turn left, right, up, down, 6 ask for the category at the image's center.

    Args:
        scenario: a Scenario, a scene's name or a file; or a function of a seed that returns a Scenario, for another
            one in each episode: `reset(seed=7)` shows that of seed 7, `reset()` one that is drawn. Pass `categories`
            then, since all episodes share the space of labels.
        width: image width, px.
        height: image height, px.
        length: frames of an episode, after which it is truncated.
        turn: degrees of a turn.
        stride: m of a step forward. A step that would end nearer than `clearance` to what is ahead is not made.
        clearance: m.
        question_cost: subtracted from the reward for each question.
        budget: questions of an episode; the environment does not answer more. None: unlimited.
        render_mode: None or "rgb_array".
        **settings: further arguments of `Stream`, such as quality="preview". `camera` is where the agent starts; it
            and `variants` are those of the scenarios that a function returns.

    Raises:
        ArgumentError: an argument is invalid, has no effect here, or there are several cameras to start from.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 25}  # noqa: RUF012  # Gymnasium's interface

    def __init__(
        self,
        scenario: Scenario | str | Callable[[int], Scenario] = "",
        *,
        width: int = 64,
        height: int = 48,
        length: int = 500,
        turn: float = 15.0,
        stride: float = 0.2,
        clearance: float = 0.3,
        question_cost: float = 0.1,
        budget: int | None = None,
        render_mode: str | None = None,
        **settings: Any,
    ) -> None:
        if not scenario:
            raise ArgumentError("scenario: pass a Scenario, a scene's name or a file")
        if render_mode not in (None, "rgb_array"):
            raise ArgumentError(f"render_mode={render_mode!r}: must be None or 'rgb_array'")
        for name in UNUSED.keys() & settings.keys():
            raise ArgumentError(f"{name}={settings[name]!r}: {UNUSED[name]}")
        own = (name for name in inspect.signature(LookAround).parameters if name != "settings")
        argument_checks.known_names(settings, dict.fromkeys((*own, *SETTINGS)), "LookAround")
        self.length = argument_checks.integer(length, "length", 1)
        self.turn = math.radians(argument_checks.positive(turn, "turn"))
        self.stride = argument_checks.positive(stride, "stride")
        self.clearance = argument_checks.not_negative(clearance, "clearance")
        self.question_cost = argument_checks.number(question_cost, "question_cost")
        self.budget = None if budget is None else argument_checks.integer(budget, "budget", 0)
        self.render_mode = render_mode
        self._scenario_of = scenario if callable(scenario) else None
        if self._scenario_of is not None:
            if settings.get("categories") is None:
                raise ArgumentError("categories: name them for all scenarios of the function: categories=('ball',)")
            for name in {"camera", "variants"} & settings.keys():
                raise ArgumentError(f"{name}={settings[name]!r}: give it to the scenarios that the function returns")
        first = scenario if self._scenario_of is None else self._drawn(0)
        if not isinstance(first, Scenario | str | os.PathLike):
            given = argument_checks.brief(first)
            raise ArgumentTypeError(f"scenario={given}: must be a Scenario, a scene's name, a file, or a function")
        self.stream = Stream(first, width=width, height=height, buffers=BUFFERS, **({"quality": "fast"} | settings))
        self._start = self._first_camera()
        numbers = len(self.stream.categories) and max(self.stream.categories) + 1
        self.observation_space = gymnasium.spaces.Dict(
            {
                "rgb": gymnasium.spaces.Box(0, 255, (height, width, 3), np.uint8),
                "label": gymnasium.spaces.Discrete(numbers),
            }
        )
        self.action_space = gymnasium.spaces.Discrete(len(ACTIONS))

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode at frame 0, with the scenario's camera.

        Args:
            seed: of the scenario, if they come from a function; None: it is drawn. Else nothing is drawn.
            options: none.

        Raises:
            ArgumentError: there are options.
        """
        super().reset(seed=seed)
        if options:
            raise ArgumentError(f"options={options!r}: LookAround has none; pass arguments to gymnasium.make")
        if self._scenario_of is not None:
            scenario = self._drawn(int(self.np_random.integers(2**31)) if seed is None else seed)
            if scenario != self.stream.scenario:
                self.stream.restart(scenario)
                self._start = self._first_camera()
        self._index, self._label, self._asked = 0, 0, 0
        self._known: set[int] = set()
        self._camera, self._walks = self._start, Axes()
        self._render_frame(self._camera)
        return self._observation(), self._info()

    def step(self, action: int) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Make an action and show the next frame. Returns observation, reward, False, truncated and info."""
        self._check_begun()
        if np.ndim(action):
            raise ArgumentTypeError(f"action={action!r}: must be one whole number, not an array")
        name = ACTIONS[argument_checks.integer(action, "action", 0, len(ACTIONS) - 1)]
        reward, before = 0.0, self._camera
        if name == "ask" and (self.budget is None or self._asked < self.budget):
            self._asked += 1
            height, width = self._frame.semantic.shape
            self._label = int(self._frame.semantic[height // 2, width // 2])
            reward = float(self._label != 0 and self._label not in self._known) - self.question_cost
            self._known.add(self._label)
        elif name != "ask":
            self._camera = self._moved(name)
        self._index += 1
        self._render_frame(before)
        return self._observation(), reward, False, self._index >= self.length, self._info()

    def render(self) -> Any:
        """Return the picture, uint8 [height, width, 3], with render_mode="rgb_array"."""
        self._check_begun()
        return self._frame.rgb.copy() if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Free the memory of the device."""
        self.stream.close()

    def _drawn(self, seed: int) -> Scenario:
        """Return the scenario of a seed."""
        assert self._scenario_of is not None  # at the places of the calls
        scenario = self._scenario_of(seed)
        if not isinstance(scenario, Scenario):
            given = argument_checks.brief(scenario)
            raise ArgumentTypeError(
                f"scenario: the function returned {given} of seed {seed}; it must return a Scenario"
            )
        return scenario

    def _first_camera(self) -> Camera:
        """Return the scenario's camera at frame 0."""
        cameras = self.stream.scenario.cameras
        if len(cameras) > 1:
            names = ", ".join(str(getattr(each, "name", each)) for each in cameras)
            self.close()
            raise ArgumentError(
                f"the agent looks through one camera, not {len(cameras)} ({names}): pass one as camera="
            )
        return self.stream.world.state(0).cameras[0].current

    def _check_begun(self) -> None:
        if not hasattr(self, "_frame"):
            raise ArgumentError("there is no episode yet: call reset() first")

    def _moved(self, name: str) -> Camera:
        camera = self._camera
        axes = matrix_from_quaternion(camera.rotation)
        if name == "forward":
            height, width = self._frame.depth.shape
            ahead = self._frame.depth[height // 4 : height - height // 4, width // 4 : width - width // 4].min()
            if ahead < self.stride + self.clearance:
                return camera
            direction = -axes[:, 2] * np.array([1.0, 0.0, 1.0])  # level, whatever the pitch
            length = np.linalg.norm(direction)
            step = direction / length * self.stride if length > 1e-6 else np.zeros(3)
            x, y, z = (np.array(camera.position) + step).tolist()
            return replace(camera, position=(x, y, z))
        if name in ("left", "right"):
            axes = _turn((0.0, 1.0, 0.0), self.turn if name == "left" else -self.turn) @ axes
        elif name in ("up", "down"):
            pitch = math.asin(float(np.clip(-axes[1, 2], -1.0, 1.0)))
            wanted = np.clip(pitch + (self.turn if name == "up" else -self.turn), -MAX_PITCH, MAX_PITCH)
            axes = _turn(tuple(axes[:, 0]), float(wanted) - pitch) @ axes
        return replace(camera, rotation=quaternion_from_matrix(axes))

    def _render_frame(self, before: Camera) -> None:
        self._walks |= walked_axes(before.position, self._camera.position)
        size = self.stream.width, self.stream.height
        view = View(before, self._camera, self._camera, *size, is_dynamic=True, walks=self._walks)
        self._frame = self.stream.render_view(self._index, view, BUFFERS)

    def _observation(self) -> dict[str, Any]:
        return {"rgb": self._frame.rgb.copy(), "label": np.int64(self._label)}

    def _info(self) -> dict[str, Any]:
        names = self.stream.categories
        return {
            "frame": self._index,
            "asked": self._asked,
            "category": names.get(self._label, ""),
            "known": sorted(names[each] for each in self._known if each),
            "position": self._camera.position,
            "rotation": self._camera.rotation,
        }


def _turn(axis: tuple[float, ...], angle: float) -> Any:
    """Return the rotation about a unit axis, 3x3."""
    half = 0.5 * angle
    x, y, z = (math.sin(half) * each for each in axis)
    return matrix_from_quaternion((math.cos(half), float(x), float(y), float(z)))


if "LookAround-v0" not in gymnasium.registry:
    gymnasium.register("LookAround-v0", entry_point=f"{__name__}:LookAround")
