# SPDX-License-Identifier: Apache-2.0
"""Joints between rigid bodies, and between a rigid body and the world or an object on a path; as in UsdPhysics.

A joint has a frame on each side: a position and a rotation in the axes of the object, in meters whatever its scale, or
in the world. The joint makes the two frames coincide up to its freedom: a fixed joint has none, a revolute one turns
about an axis of the frames, a prismatic one slides along it, a spherical one turns about their common origin. A
distance joint bounds the distance of the origins.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

from dynamics import RigidBody
from dynamics.argument_checks import (
    choice,
    flag,
    not_negative,
    number,
    optional,
    position,
    positive,
    rotation,
    set_checked,
    text,
)
from dynamics.joint_loops import closing_joints
from tiscene.errors import ScenarioError, scenario_errors
from tiscene.scenario.objects import Object, check_each
from tiscene.scene.camera import Vector3

AXES = ("X", "Y", "Z")


@dataclass(frozen=True)
class Joint:
    """What all joints have. It exists while its objects do.

    Attributes:
        body: id of an object; this or `parent` is a rigid body.
        parent: id of another object; None: the world.
        position: origin of the frame in the axes of `body`, m.
        rotation: of the frame in the axes of `body`; Euler angles in degrees, or a quaternion.
        parent_position: origin of the frame in the axes of `parent`, or in the world, m. None: where the frame of
            `body` is at the start poses of both objects.
        parent_rotation: of the frame in the axes of `parent`, or in the world. None: as of `parent_position`.
        collide: whether the two objects collide with each other.

    Raises:
        ScenarioError: a value is out of range.
    """

    body: str
    parent: str | None = None
    position: Vector3 = (0.0, 0.0, 0.0)
    rotation: tuple[float, ...] = (0.0, 0.0, 0.0)
    parent_position: Vector3 | None = None
    parent_rotation: tuple[float, ...] | None = None
    collide: bool = False

    def __post_init__(self) -> None:
        with scenario_errors():
            set_checked(self, body=text, parent=optional(text))
            if self.parent == self.body:
                raise ScenarioError(f"parent={self.parent!r}: must be another object than body")
            set_checked(self, position=position, parent_position=optional(position))
            set_checked(self, rotation=rotation, parent_rotation=optional(rotation), collide=flag)


@dataclass(frozen=True)
class FixedJoint(Joint):
    """Holds two objects together. The attributes are in `tiscene.scenario.joints.Joint`."""


@dataclass(frozen=True)
class AxialJoint(Joint):
    """What joints with an axis have; see `Joint`.

    Attributes:
        axis: "X", "Y" or "Z", of the frames.
        lower_limit: least value; None: unlimited.
        upper_limit: greatest value; None: unlimited.
    """

    axis: str = "X"
    lower_limit: float | None = None
    upper_limit: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        with scenario_errors():
            choice(self.axis, "axis", AXES)
            set_checked(self, lower_limit=optional(number), upper_limit=optional(number))
            low, high = self.lower_limit, self.upper_limit
            if low is not None and high is not None and low > high:
                raise ScenarioError(f"lower_limit={low!r}: must not be greater than upper_limit={high!r}")


@dataclass(frozen=True)
class RevoluteJoint(AxialJoint):
    """A hinge: `body` turns about the axis. The other attributes are in `tiscene.scenario.joints.Joint`.

    Attributes:
        axis: "X", "Y" or "Z", of the frames.
        lower_limit: least turn of `body`, degrees, right-handed; None: unlimited.
        upper_limit: greatest turn of `body`; None: unlimited.
    """


@dataclass(frozen=True)
class PrismaticJoint(AxialJoint):
    """A slider: `body` moves along the axis and does not turn.

    The other attributes are in `tiscene.scenario.joints.Joint`.

    Attributes:
        axis: "X", "Y" or "Z", of the frames.
        lower_limit: least way of `body`, m; None: unlimited.
        upper_limit: greatest way of `body`, m; None: unlimited.
    """


@dataclass(frozen=True)
class SphericalJoint(Joint):
    """A ball in a socket: `body` turns about the origin of the frame.

    The other attributes are in `tiscene.scenario.joints.Joint`.

    Attributes:
        axis: "X", "Y" or "Z", of the frames.
        cone_angle: greatest angle between the axes of the two frames, degrees, below 180; None: unlimited.
    """

    axis: str = "X"
    cone_angle: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        with scenario_errors():
            choice(self.axis, "axis", AXES)
            set_checked(self, cone_angle=optional(positive))
            if self.cone_angle is not None and self.cone_angle >= 180.0:
                raise ScenarioError(f"cone_angle={self.cone_angle!r}: must be below 180 degrees; None: unlimited")


@dataclass(frozen=True)
class DistanceJoint(Joint):
    """Bounds the distance of the origins of the two frames, as a rope or a rod does.

    The other attributes are in `tiscene.scenario.joints.Joint`.

    Attributes:
        min_distance: m.
        max_distance: m; None: unlimited.
    """

    min_distance: float = 0.0
    max_distance: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        with scenario_errors():
            if self.max_distance is None and self.min_distance == 0:
                raise ScenarioError("max_distance: is missing; give it, min_distance or both")
            set_checked(self, min_distance=not_negative, max_distance=optional(positive))
            least, most = self.min_distance, self.max_distance
            if most is not None and most < least:
                raise ScenarioError(f"max_distance={most!r}: must be at least min_distance={least!r}")


def check_joints(value: Any, objects: Collection[Object]) -> tuple[Joint, ...]:
    """Return joints as a tuple.

    Args:
        value: a sequence of joints.
        objects: the objects that they may name.

    Raises:
        ScenarioError: a joint is invalid; the message names it.
    """
    example = "such as RevoluteJoint(...)"
    joints = check_each(value, "joints", Joint, f"joints, {example}", f"a joint, {example}")
    rigid = {each.id: isinstance(each.dynamic, RigidBody) for each in objects}
    for row, each in enumerate(joints):
        if type(each) in (Joint, AxialJoint):
            raise ScenarioError(f"joints[{row}]={each!r}: must be a joint, {example}")
        for name, id in (("body", each.body), ("parent", each.parent)):
            if id is not None and id not in rigid:
                raise ScenarioError(f"joints[{row}].{name}={id!r}: there is no object with this id")
        if not any(rigid[id] for id in (each.body, each.parent) if id is not None):
            raise ScenarioError(
                f"joints[{row}]: neither {each.body!r} nor its parent is a rigid body; give one of them "
                "dynamic=RigidBody(), or the scenario physics=True"
            )
    ends = [tuple(id if id is not None and rigid[id] else None for id in (each.body, each.parent)) for each in joints]
    for row in closing_joints(ends, [isinstance(each, DistanceJoint) for each in joints]):
        each = joints[row]
        if isinstance(each, AxialJoint) and (
            isinstance(each, PrismaticJoint) or each.lower_limit is not None or each.upper_limit is not None
        ):
            raise ScenarioError(
                f"joints[{row}]: its objects are connected already, by other joints or by the world; there, "
                "prismatic joints and limits are not supported. List this joint before the others"
            )
    return joints
