# SPDX-License-Identifier: Apache-2.0
"""Stepped: a dynamic that somebody writes in plain Python, one small step after another."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np

from dynamics import argument_checks
from dynamics.dynamic import Array, Dynamic, Pose
from dynamics.errors import ArgumentTypeError
from dynamics.rotation import quaternion
from dynamics.waypoints import Waypoint

CHECKPOINT = 64  # steps between kept states, until there are too many
MAX_CHECKPOINTS = 1024


class Stepped(Dynamic):
    """What has no formula: a state that is carried from step to step. Subclass it as a frozen dataclass::

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

    step: s of the body's clock that one step takes; between two steps the body moves straight. A subclass may set it.

    Everything must be a function of the fields and the arguments alone: states are kept and computed again at will, so
    that any frame is the same whoever asks, and when. Draw random numbers from `np.random.default_rng((seed, number))`.
    The motion is a path, as that of waypoints: bodies that collide slide along what is in their way and return to it.
    """

    step: ClassVar[float] = 0.01

    @property
    def loop_time(self) -> float:
        return math.inf

    @abstractmethod
    def begin(self, start: Pose) -> Any:
        """The state before the first step, of a body that was placed at `start`."""

    @abstractmethod
    def advance(self, state: Any, number: int) -> Any:
        """The state after step `number` (0, 1, ...), as a new value: `state` itself must stay as it is."""

    @abstractmethod
    def pose(self, state: Any) -> Waypoint:
        """Where a body in this state is."""


class SteppedStates:
    """The states of one body's Stepped dynamic: some are kept, the others computed again from the one before."""

    def __init__(self, dynamic: Stepped, start: Pose, name: str) -> None:
        """name: of the body, for what its dynamic does wrong."""
        self._dynamic = dynamic
        self._name = f"{type(dynamic).__name__} of {name!r}"
        self._step = argument_checks.positive(dynamic.step, f"step of {type(dynamic).__name__}")
        self._kept: dict[int, Any] = {0: dynamic.begin(start)}
        self._interval = CHECKPOINT
        self._reached = 0
        self._last = (0, self._kept[0])
        self._poses: dict[int, Array] = {}

    def at(self, clock: float) -> Array:
        """The pose [7] when the body's clock shows so many seconds."""
        number = int(clock / self._step)
        part = clock / self._step - number
        before, after = self._pose(number), self._pose(number + 1)
        position = before[:3] + part * (after[:3] - before[:3])
        near = after[3:] if before[3:] @ after[3:] >= 0.0 else -after[3:]
        rotation = before[3:] + part * (near - before[3:])
        return np.concatenate([position, rotation / np.linalg.norm(rotation)])

    def _pose(self, number: int) -> Array:
        if number not in self._poses:
            while len(self._poses) >= CHECKPOINT:
                self._poses.pop(next(iter(self._poses)))
            pose = self._dynamic.pose(self._state(number))
            if not isinstance(pose, Waypoint):
                raise ArgumentTypeError(
                    f"{self._name}: pose() returned {pose!r}: must be a Waypoint(position, rotation)"
                )
            self._poses[number] = np.array([*pose.position, *quaternion(pose.rotation)])
        return self._poses[number]

    def _state(self, number: int) -> Any:
        reached, state = self._last
        if not reached <= number < reached + self._interval:
            reached = max(kept for kept in self._kept if kept <= number)
            state = self._kept[reached]
        while reached < number:
            state = self._dynamic.advance(state, reached)
            reached += 1
            if reached % self._interval == 0 and reached not in self._kept:
                self._keep(reached, state)
        self._last = reached, state
        return state

    def _keep(self, number: int, state: Any) -> None:
        self._kept[number] = state
        if len(self._kept) > MAX_CHECKPOINTS:
            self._interval *= 2
            self._kept = {each: state for each, state in self._kept.items() if each % self._interval == 0}
