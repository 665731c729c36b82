"""The arrays of a stepped simulation on Taichi's device, and the launches of its kernels."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from dynamics import columns as at
from dynamics.contact import MOVER, OBSTACLE, TOUCH_COLUMNS, TOUCHES, WALL
from dynamics.movers import Array, Contact, Moment, Mover
from dynamics.obstacles import Obstacles
from dynamics.stepping import begin_frame, begin_substep, give_up, step
from dynamics.sweep import RESULT_COLUMNS, RESULT_INTEGERS, measure

MOST_TRIES = 24  # of motions in one substep
KINDS = {OBSTACLE: "obstacle", MOVER: "mover", WALL: "wall"}


class StepDevice:
    """The arrays of a simulation on Taichi's device, and the launches."""

    def __init__(self, movers: Sequence[Mover], obstacles: Obstacles) -> None:
        self.count = len(movers)
        rows = max(1, self.count)
        groups, spheres, bounding = [], [], []
        first = 0
        for row, mover in enumerate(movers):
            if mover.shape is not None:
                shape = mover.shape
                starts = shape.first
                groups += [(row, first + a, b - a) for a, b in pairwise(starts)]
                spheres.append(shape.spheres)
                bounding.append(shape.groups)
                first += len(shape.spheres)
        self.shapes = len(groups) > 0
        groups_array = np.array(groups or [(0, 0, 0)], dtype=np.int32)
        self.bodies = ti.ndarray(ti.f64, (rows, at.FLOATS))
        self.integers = ti.ndarray(ti.i32, (rows, at.INTEGERS))
        self.groups = _uploaded(groups_array)
        self.spheres = _uploaded(np.concatenate(spheres) if spheres else np.zeros((1, 4), np.float32))
        self.bounding = _uploaded(np.concatenate(bounding) if bounding else np.zeros((1, 4), np.float32))
        self.clearance = ti.ndarray(ti.f32, (max(1, first), 1))
        self.frozen = ti.ndarray(ti.f32, (max(1, first), 3))
        self.frozen_groups = ti.ndarray(ti.f32, (len(groups_array), 3))
        self.near = ti.ndarray(ti.i32, (rows, rows + 1))
        self.touches = ti.ndarray(ti.f32, (len(groups_array) * TOUCHES, TOUCH_COLUMNS))
        self.result = ti.ndarray(ti.f32, (len(groups_array), RESULT_COLUMNS))
        self.result_rows = ti.ndarray(ti.i32, (len(groups_array), RESULT_INTEGERS))
        self.obstacles = obstacles
        self.shaped = np.array([mover.shape is not None for mover in movers], dtype=np.bool_)

    def restore(self, bodies: Array, integers: NDArray[np.int32]) -> None:
        self.bodies.from_numpy(bodies)
        self.integers.from_numpy(integers)

    def state(self) -> tuple[Array, NDArray[np.int32]]:
        return self.bodies.to_numpy(), self.integers.to_numpy()

    def begin_frame(self, targets: list[Array], there: list[bool], length: float) -> None:
        integers = self.integers.to_numpy()
        integers[: self.count, at.COLLIDES] = self.shaped & np.array(there, dtype=np.bool_)
        self.integers.from_numpy(integers)
        begin_frame(self.bodies, self.integers, targets[0])
        bodies = self.bodies.to_numpy()
        # How far it is worth looking: about what can be covered in this frame. It changes no result.
        path = sum(np.linalg.norm(b[:, :3] - a[:, :3], axis=1) for a, b in pairwise(targets))
        own = bodies[: self.count]
        speeds = own[:, at.SPEED] + own[:, at.ANGULAR_SPEED] * own[:, at.RADIUS]
        own[:, at.SIGHT] = 1.2 * speeds * length + 2.0 * path + 0.02
        self.bodies.from_numpy(bodies)
        if self.shapes:
            tree = self.obstacles
            measure(
                self.bodies,
                self.integers,
                self.groups,
                self.spheres,
                self.bounding,
                self.clearance,
                self.touches,
                tree.nodes,
                tree.triangles,
                tree.instances,
                tree.roots,
                tree.root,
            )

    def substep(self, targets: Array, active: Array, planes: Array, length: float) -> None:
        tree = self.obstacles
        planes = np.ascontiguousarray(planes, dtype=np.float32)
        moving = begin_substep(
            self.bodies,
            self.integers,
            self.groups,
            self.spheres,
            self.bounding,
            self.frozen,
            self.frozen_groups,
            self.near,
            planes,
            targets,
            active,
            length,
        )
        for _ in range(MOST_TRIES):
            if not moving:
                return
            moving = step(
                self.bodies,
                self.integers,
                self.groups,
                self.spheres,
                self.bounding,
                self.clearance,
                self.frozen,
                self.frozen_groups,
                self.near,
                planes,
                self.touches,
                self.result,
                self.result_rows,
                tree.nodes,
                tree.triangles,
                tree.instances,
                tree.roots,
                tree.root,
            )
        if moving:
            give_up(self.bodies, self.integers)

    def put(self, poses: dict[int, Array]) -> None:
        """Put bodies elsewhere, by row."""
        bodies, integers = self.state()
        for row, pose in poses.items():
            bodies[row, at.POSITION : at.ROTATION + 4] = pose
            integers[row, at.ON_PATH] = 0
        self.restore(bodies, integers)

    def moment(self, length: float = 1.0) -> Moment:
        bodies, integers = self.state()
        bodies, integers = bodies[: self.count], integers[: self.count]
        lost = (integers[:, at.KIND] == at.BOUNCES) & (bodies[:, at.LOST] > 0.5 * length)
        contacts = [
            Contact(row, KINDS[int(integers[row, k])], int(integers[row, k + 1]))
            for row in range(self.count)
            for k in range(at.CONTACT, at.CONTACT + 2 * int(integers[row, at.CONTACTS]), 2)
        ]
        poses = bodies[:, at.POSITION : at.ROTATION + 4].copy()
        return Moment(poses, poses, (integers[:, at.BLOCKED] > 0) | lost, tuple(contacts))


def _uploaded(values: NDArray[Any]) -> Any:
    array = ti.ndarray(ti.i32 if values.dtype == np.int32 else ti.f32, values.shape)
    array.from_numpy(np.ascontiguousarray(values))
    return array
