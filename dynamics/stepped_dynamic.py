# SPDX-License-Identifier: Apache-2.0
"""Stepped: a trajectory written in plain Python, one small step after another.

Users subclass `Stepped`. `SteppedStates` runs such a dynamic for one body and keeps checkpoints of its states, so that
any time can be reached in any order.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np

from dynamics import argument_checks
from dynamics.checkpoints import Checkpoints
from dynamics.dynamic import Array, Dynamic, Pose
from dynamics.errors import ArgumentError, ArgumentTypeError
from dynamics.lru_cache import LRUCache
from dynamics.rotation import quaternion
from dynamics.waypoints import Waypoint

CHECKPOINT = 64  # initial number of steps between checkpoints
MAX_CHECKPOINTS = 1024


class Stepped(Dynamic):
    """A trajectory without a closed form: a state that is advanced step by step.

    Subclass it as a frozen dataclass::

        @dataclass(frozen=True)
        class Fall(ts.Stepped):
            gravity: float = 9.81

            def begin(self, start):
                return start.position, 0.0

            def advance(self, state, number):
                (x, y, z), speed = state
                return (x, y + speed * self.step, z), speed - self.gravity * self.step

            def pose(self, state):
                return ts.Waypoint(state[0])

    All methods must be pure functions of the fields and their arguments: states are recomputed at any time, so that any
    frame is the same in any order. Draw random numbers from `np.random.default_rng((seed, number))`. The motion is a
    path, as that of waypoints: colliding bodies slide along obstacles and return to it.

    Attributes:
        step: Seconds of the body's clock per step; a subclass may set it. Between steps the body moves linearly.
    """

    step: ClassVar[float] = 0.01

    @property
    def loop_time(self) -> float:
        return math.inf

    @abstractmethod
    def begin(self, start: Pose) -> Any:
        """Return the state before the first step of a body placed at `start`."""

    @abstractmethod
    def advance(self, state: Any, number: int) -> Any:
        """Return the state after step `number` (0, 1, ...) as a new value; `state` itself must not change."""

    @abstractmethod
    def pose(self, state: Any) -> Waypoint:
        """Return the pose of a body in this state."""


class SteppedStates:
    """The states of one body's Stepped dynamic: checkpoints, from which all others are recomputed."""

    def __init__(self, dynamic: Stepped, start: Pose, name: str) -> None:
        """Compute the state at the start.

        Args:
            dynamic: The dynamic.
            start: Where the body is placed.
            name: Name of the body, for error messages.
        """
        self._dynamic = dynamic
        self._name = f"{type(dynamic).__name__} of {name!r}"
        self._step = argument_checks.positive(dynamic.step, f"step of {type(dynamic).__name__}")
        self._checkpoints: Checkpoints[Any] = Checkpoints(CHECKPOINT, MAX_CHECKPOINTS)
        self._latest = (0, dynamic.begin(start))
        self._checkpoints.add(*self._latest)
        self._poses: LRUCache[int, Array] = LRUCache(CHECKPOINT)

    @property
    def checkpoint_count(self) -> int:
        """Number of states that are kept."""
        return len(self._checkpoints)

    def pose_at(self, clock: float) -> Array:
        """Return the pose [7] when the body's clock shows `clock` seconds."""
        number = int(clock / self._step)
        part = clock / self._step - number
        before, after = self._pose(number), self._pose(number + 1)
        position = before[:3] + part * (after[:3] - before[:3])
        near = after[3:] if before[3:] @ after[3:] >= 0.0 else -after[3:]
        rotation = before[3:] + part * (near - before[3:])
        return np.concatenate([position, rotation / np.linalg.norm(rotation)])

    def _pose(self, number: int) -> Array:
        return self._poses.get(number, lambda: self._new_pose(number))

    def _new_pose(self, number: int) -> Array:
        time, cure = f"after {number * self._step:g} s", "if the simulation diverges, a smaller `step` helps"
        try:
            pose = self._dynamic.pose(self._state(number))
        except ArgumentError as error:  # of a Waypoint that is not finite, or beyond single precision
            raise ArgumentError(f"{self._name}: pose() {time}: {error}; {cure}") from error
        if not isinstance(pose, Waypoint):
            raise ArgumentTypeError(f"{self._name}: pose() returned {pose!r}: must be a Waypoint(position, rotation)")
        if max(map(abs, pose.position)) > argument_checks.MAX_POSITION:
            limit = f"more than {argument_checks.MAX_POSITION:g} m away"
            raise ArgumentError(f"{self._name}: pose() is at {pose.position} m {time}, {limit}; {cure}")
        return np.array([*pose.position, *quaternion(pose.rotation)])

    def _state(self, number: int) -> Any:
        reached, state = self._latest
        if not reached <= number < reached + self._checkpoints.interval:
            reached = max(kept for kept in self._checkpoints if kept <= number)
            state = self._checkpoints[reached]
        while reached < number:
            state = self._dynamic.advance(state, reached)
            reached += 1
            self._checkpoints.add(reached, state)
        self._latest = reached, state
        return state
