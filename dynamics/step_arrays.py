# SPDX-License-Identifier: Apache-2.0
"""Arrays of a stepped simulation, and calls of its kernel.

Columns of bodies are those of `dynamics.body_layout`. Sphere proxies are uploaded once, at the first substep;
bodies are host arrays, which Taichi copies for each launch.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from dynamics import body_layout as at
from dynamics.colliding_bodies import Array, CollisionState, Contact, Mover
from dynamics.contact import MAX_TOUCHES, MOVER, OBSTACLE, TOUCH_COLUMNS, WALL
from dynamics.obstacles import Obstacles
from dynamics.step_kernel import substep
from dynamics.sweep_walls import WALLS

KINDS = {OBSTACLE: "obstacle", MOVER: "mover", WALL: "wall"}


class StepArrays:
    """The state of some movers, and the arrays that the kernel needs besides.

    Args:
        numbers: Numbers of the movers, by row.
        movers: The movers.

    Attributes:
        numbers: Numbers of the movers, by row.
        bodies: float64 [n, FLOAT_COLUMNS].
        integers: int32 [n, INTEGER_COLUMNS].
    """

    def __init__(self, numbers: tuple[int, ...], movers: Sequence[Mover]) -> None:
        self.numbers = numbers
        self._count = len(movers)
        rows = max(1, self._count)
        self._groups: list[tuple[int, int, int]] = []
        self._spheres: list[NDArray[np.float32]] = []
        self._bounding: list[NDArray[np.float32]] = []
        first = 0
        for row, mover in enumerate(movers):
            if mover.shape is not None:
                shape = mover.shape
                self._groups += [(row, first + a, b - a) for a, b in pairwise(shape.first)]
                self._spheres.append(shape.spheres)
                self._bounding.append(shape.groups)
                first += len(shape.spheres)
        self.bodies: Array = np.zeros((rows, at.FLOAT_COLUMNS))
        self.integers: NDArray[np.int32] = np.zeros((rows, at.INTEGER_COLUMNS), dtype=np.int32)
        self._has_shape = np.array([mover.shape is not None for mover in movers], dtype=np.bool_)
        self._limited = np.array([mover.limited for mover in movers], dtype=np.bool_)

    @cached_property
    def _proxies(self) -> tuple[Any, ...]:
        """Sphere groups, spheres and bounding spheres of the groups."""
        none = np.zeros((1, 4), np.float32)
        return (
            _uploaded(np.array(self._groups or [(0, 0, 0)], dtype=np.int32)),
            _uploaded(np.concatenate(self._spheres) if self._spheres else none),
            _uploaded(np.concatenate(self._bounding) if self._bounding else none),
        )

    @cached_property
    def _frozen(self) -> tuple[Any, ...]:
        """Centers of spheres, groups and bodies at the start of the substep; neighbors of each body."""
        groups, spheres, _ = self._proxies
        rows = len(self.bodies)
        return (
            ti.ndarray(ti.f32, (spheres.shape[0], 3)),
            ti.ndarray(ti.f32, (groups.shape[0], 3)),
            ti.ndarray(ti.f32, (rows, 3)),
            ti.ndarray(ti.i32, (rows, rows + 1)),
        )

    @cached_property
    def _scratch(self) -> tuple[Any, ...]:
        """Touches, times and touch counts of each group."""
        groups = self._proxies[0].shape[0]
        return (
            ti.ndarray(ti.f32, (groups * MAX_TOUCHES, TOUCH_COLUMNS)),
            ti.ndarray(ti.f32, groups),
            ti.ndarray(ti.i32, groups),
        )

    def restore(self, bodies: Array, integers: NDArray[np.int32]) -> None:
        """Overwrite the state of all movers."""
        self.bodies[:], self.integers[:] = bodies, integers

    def state(self) -> tuple[Array, NDArray[np.int32]]:
        """Return copies of both arrays of the state."""
        return self.bodies.copy(), self.integers.copy()

    def begin_frame(self, targets: Array, present: list[bool]) -> None:
        """Reset what is recorded per frame.

        Args:
            targets: float64 [n, 7], current poses on the paths.
            present: Which movers exist.
        """
        bodies, integers = self.bodies[: self._count], self.integers[: self._count]
        bodies[:, at.TARGET : at.TARGET + 7] = targets
        bodies[:, at.LOST_TIME] = 0.0
        integers[:, [at.BLOCKED, at.CONTACT_COUNT]] = 0
        integers[:, at.COLLIDES] = self._has_shape & np.array(present, dtype=np.bool_)

    def obstacles_changed(self) -> None:
        """Invalidate the times for which motions are known to meet no obstacle."""
        self.bodies[:, at.FREE_TIME] = 0.0

    def substep(self, targets: Array, active: Array, walls: Array | None, length: float, obstacles: Obstacles) -> None:
        """Advance all movers by one substep.

        Args:
            targets: float64 [n, 7], poses on the paths at its end.
            active: float64 [n], seconds during which each body's clock runs.
            walls: Planes [6, 4] at its end; None for no walls.
            length: Its duration, seconds.
            obstacles: Static triangles.
        """
        self.integers[: self._count, at.LIMITED] = self._limited & (walls is not None)
        planes = np.zeros((WALLS, 4), np.float32) if walls is None else np.ascontiguousarray(walls, dtype=np.float32)
        arrays = (*self._frozen, planes, targets, active, length, *self._scratch)
        substep(self.bodies, self.integers, *self._proxies, *arrays, *obstacles.arguments())

    def set_poses(self, poses: dict[int, Array]) -> None:
        """Teleport movers, given by row, to poses [7]."""
        for row, pose in poses.items():
            self.bodies[row, at.POSITION : at.ROTATION + 4] = pose
            self.bodies[row, at.FREE_TIME] = 0.0

    def collision_state(self, frame_time: float = 1.0) -> CollisionState:
        """Return the poses, and what happened since `begin_frame`, `frame_time` seconds ago."""
        bodies, integers = self.bodies[: self._count], self.integers[: self._count]
        lost = (integers[:, at.KIND] == at.BOUNCES) & (bodies[:, at.LOST_TIME] > 0.5 * frame_time)
        contacts = [
            self._contact(row, KINDS[int(integers[row, k])], int(integers[row, k + 1]))
            for row in np.flatnonzero(integers[:, at.CONTACT_COUNT]).tolist()
            for k in range(at.FIRST_CONTACT, at.FIRST_CONTACT + 2 * int(integers[row, at.CONTACT_COUNT]), 2)
        ]
        poses = bodies[:, at.POSITION : at.ROTATION + 4].copy()
        return CollisionState(self.numbers, poses, poses, (integers[:, at.BLOCKED] > 0) | lost, tuple(contacts))

    def _contact(self, row: int, kind: str, other: int) -> Contact:
        return Contact(self.numbers[row], kind, self.numbers[other] if kind == KINDS[MOVER] else other)


def _uploaded(values: NDArray[Any]) -> Any:
    array = ti.ndarray(ti.i32 if values.dtype == np.int32 else ti.f32, values.shape)
    array.from_numpy(np.ascontiguousarray(values))
    return array
