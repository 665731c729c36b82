# SPDX-License-Identifier: Apache-2.0
"""Joints as a tree: each body hangs on at most one other, or on the world, by coordinates of its own.

Such joints hold exactly. A joint that closes a loop is left over; the engine holds it by forces. The roots are the
world, the movers, and the first body of what hangs on neither.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynamics.joint_loops import closing_joints
from dynamics.rotation import conjugate, multiply, rotate
from tiscene.scenario.joints import AXES, AxialJoint, DistanceJoint, Joint

Array = NDArray[np.float64]
WORLD = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])  # a pose, [7]


@dataclass(frozen=True, eq=False)
class PhysicsJoint:
    """A joint of a simulation.

    Attributes:
        number: Its number, which stays the same in all models.
        joint: Its kind and limits.
        body: Number of one body.
        parent: Number of the other; None: the world.
        frame: Its frame in the axes of the body, [7].
        parent_frame: Its frame in the axes of the other, or in the world, [7].
    """

    number: int
    joint: Joint
    body: int
    parent: int | None
    frame: Array
    parent_frame: Array


@dataclass(frozen=True, eq=False)
class Link:
    """How a body hangs on another.

    Attributes:
        joint: The joint.
        parent: Row of the other; None: the world.
        frame: Frame of the joint in the axes of the body that hangs, [7].
        parent_frame: The same in the axes of the other, [7].
        sign: 1.0; -1.0 if the body that hangs is the `parent` of the joint, whose coordinates count the other way.
    """

    joint: Joint
    parent: int | None
    frame: Array
    parent_frame: Array
    sign: float

    @property
    def axis(self) -> Array:
        """The axis in the axes of the body that hangs, [3], in the direction in which the joint's values grow."""
        assert isinstance(self.joint, AxialJoint)
        return self.sign * rotate(self.frame[3:], np.eye(3)[AXES.index(self.joint.axis)])

    @property
    def reference(self) -> Array:
        """The pose of the body in the axes of the other, [7], where the two frames coincide."""
        return compose(self.parent_frame, inverse(self.frame))


def joint_tree(
    joints: Sequence[PhysicsJoint], rows: Mapping[int, int], movers: Collection[int]
) -> tuple[dict[int, Link], list[PhysicsJoint]]:
    """Return the links of bodies by row, what others hang on first, and the joints that are none.

    Args:
        joints: The joints.
        rows: Row of each body by its number.
        movers: Rows of those with given poses.
    """

    def end(number: int | None) -> int | None:
        return None if number is None else rows[number]

    ends = [(end(each.body), end(each.parent)) for each in joints]
    grounded = [tuple(None if row in movers else row for row in pair) for pair in ends]
    loose = [isinstance(each.joint, DistanceJoint) for each in joints]
    left = {*closing_joints(grounded, loose), *(row for row, is_loose in enumerate(loose) if is_loose)}
    near: dict[int | None, list[int]] = {}
    for number, pair in enumerate(ends):
        for row in pair if number not in left else ():
            near.setdefault(row, []).append(number)
    links: dict[int, Link] = {}
    reached: set[int | None] = set()
    for root in (None, *sorted(movers), *sorted(rows.values())):
        pending = [root] if root not in reached else []
        reached.add(root)
        while pending:
            here = pending.pop(0)
            for number in near.get(here, ()):
                body, parent = ends[number]
                there = body if parent == here else parent
                if there is None or there in reached:
                    continue
                each = joints[number]
                if there == body:
                    links[there] = Link(each.joint, here, each.frame, each.parent_frame, 1.0)
                else:
                    links[there] = Link(each.joint, here, each.parent_frame, each.frame, -1.0)
                reached.add(there)
                pending.append(there)
    return links, [joints[number] for number in sorted(left)]


def compose(outer: Array, inner: Array) -> Array:
    """Return the pose [7] of a frame that has pose `inner` in a frame with pose `outer`."""
    return np.concatenate([outer[:3] + rotate(outer[3:], inner[:3]), multiply(outer[3:], inner[3:])])


def inverse(pose: Array) -> Array:
    """Return the inverse of a pose [7]."""
    turn = conjugate(pose[3:])
    return np.concatenate([-rotate(turn, pose[:3]), turn])


def angle_about(turn: Array, axis: int, around: float) -> float:
    """Return the angle of a rotation about an axis of its frame, rad, within half a turn of another angle.

    Args:
        turn: A quaternion [4].
        axis: 0, 1 or 2.
        around: rad.
    """
    angle = 2.0 * math.atan2(float(turn[1 + axis]), float(turn[0]))
    return angle + 2.0 * math.pi * round((around - angle) / (2.0 * math.pi))
