# SPDX-License-Identifier: Apache-2.0
"""The arrays of a stepped simulation on the device, and what is asked of its kernel."""

from __future__ import annotations

from collections.abc import Sequence
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
from dynamics.sweep_bodies import WALLS

KINDS = {OBSTACLE: "obstacle", MOVER: "mover", WALL: "wall"}


class StepDevice:
    """The bodies' columns, host arrays of which the device has copies while it works; the rest is Taichi's."""

    def __init__(self, movers: Sequence[Mover]) -> None:
        self.count = len(movers)
        rows = max(1, self.count)
        groups, spheres, bounding = [], [], []
        first = 0
        for row, mover in enumerate(movers):
            if mover.shape is not None:
                shape = mover.shape
                groups += [(row, first + a, b - a) for a, b in pairwise(shape.first)]
                spheres.append(shape.spheres)
                bounding.append(shape.groups)
                first += len(shape.spheres)
        groups_array = np.array(groups or [(0, 0, 0)], dtype=np.int32)
        self.bodies: Array = np.zeros((rows, at.FLOAT_COLUMNS))
        self.integers: NDArray[np.int32] = np.zeros((rows, at.INTEGER_COLUMNS), dtype=np.int32)
        self._shaped = np.array([mover.shape is not None for mover in movers], dtype=np.bool_)
        self._limited = np.array([mover.limited for mover in movers], dtype=np.bool_)
        self._shapes = (
            _uploaded(groups_array),
            _uploaded(np.concatenate(spheres) if spheres else np.zeros((1, 4), np.float32)),
            _uploaded(np.concatenate(bounding) if bounding else np.zeros((1, 4), np.float32)),
        )
        # Where the spheres, groups and bodies were, who is near whom; touches, times and counts of every group.
        self._frozen = (
            ti.ndarray(ti.f32, (max(1, first), 3)),
            ti.ndarray(ti.f32, (len(groups_array), 3)),
            ti.ndarray(ti.f32, (rows, 3)),
            ti.ndarray(ti.i32, (rows, rows + 1)),
        )
        self._found = (
            ti.ndarray(ti.f32, (len(groups_array) * MAX_TOUCHES, TOUCH_COLUMNS)),
            ti.ndarray(ti.f32, len(groups_array)),
            ti.ndarray(ti.i32, len(groups_array)),
        )

    def restore(self, bodies: Array, integers: NDArray[np.int32]) -> None:
        self.bodies[:], self.integers[:] = bodies, integers

    def state(self) -> tuple[Array, NDArray[np.int32]]:
        return self.bodies.copy(), self.integers.copy()

    def begin_frame(self, targets: Array, there: list[bool]) -> None:
        """targets: where the paths have the bodies now. there: which of them exist."""
        bodies, integers = self.bodies[: self.count], self.integers[: self.count]
        bodies[:, at.TARGET : at.TARGET + 7] = targets
        bodies[:, at.LOST_TIME] = 0.0
        integers[:, [at.BLOCKED, at.CONTACT_COUNT]] = 0
        integers[:, at.COLLIDES] = self._shaped & np.array(there, dtype=np.bool_)

    def forget_obstacles(self) -> None:
        """They are others from now on: nobody knows any more what is ahead."""
        self.bodies[:, at.FREE_TIME] = 0.0

    def substep(self, targets: Array, active: Array, walls: Array | None, length: float, obstacles: Obstacles) -> None:
        """walls: planes [6, 4], None if there are none now. length: s."""
        self.integers[: self.count, at.LIMITED] = self._limited & (walls is not None)
        planes = np.zeros((WALLS, 4), np.float32) if walls is None else np.ascontiguousarray(walls, dtype=np.float32)
        arrays = (*self._frozen, planes, targets, active, length, *self._found)
        substep(self.bodies, self.integers, *self._shapes, *arrays, *obstacles.arguments())

    def put(self, poses: dict[int, Array]) -> None:
        """Put bodies elsewhere, by row."""
        for row, pose in poses.items():
            self.bodies[row, at.POSITION : at.ROTATION + 4] = pose
            self.bodies[row, at.FREE_TIME] = 0.0
            self.integers[row, at.ON_PATH] = 0

    def moment(self, length: float = 1.0) -> CollisionState:
        bodies, integers = self.bodies[: self.count], self.integers[: self.count]
        lost = (integers[:, at.KIND] == at.BOUNCES) & (bodies[:, at.LOST_TIME] > 0.5 * length)
        contacts = [
            Contact(row, KINDS[int(integers[row, k])], int(integers[row, k + 1]))
            for row in np.flatnonzero(integers[:, at.CONTACT_COUNT]).tolist()
            for k in range(at.FIRST_CONTACT, at.FIRST_CONTACT + 2 * int(integers[row, at.CONTACT_COUNT]), 2)
        ]
        poses = bodies[:, at.POSITION : at.ROTATION + 4].copy()
        return CollisionState(poses, poses, (integers[:, at.BLOCKED] > 0) | lost, tuple(contacts))


def _uploaded(values: NDArray[Any]) -> Any:
    array = ti.ndarray(ti.i32 if values.dtype == np.int32 else ti.f32, values.shape)
    array.from_numpy(np.ascontiguousarray(values))
    return array
