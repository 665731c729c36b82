# SPDX-License-Identifier: Apache-2.0
"""JointsInEngine: coordinates of bodies in a MuJoCo model, free ones and those of joints."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynamics.rotation import conjugate, multiply, rotate
from tiscene.scenario.joints import (
    AXES,
    AxialJoint,
    DistanceJoint,
    FixedJoint,
    Joint,
    PrismaticJoint,
    RevoluteJoint,
    SphericalJoint,
)
from tiscene.world.physics.joint_tree import WORLD, Link, PhysicsJoint, angle_about, compose, inverse

Array = NDArray[np.float64]
UNLIMITED = 1e9
ARM = 0.1  # m: half the distance of the two points that hold a hinge which closes a loop; of points that a cone limits
ROPE = 1e-6  # m: least range of a distance


class JointsInEngine:
    """The bodies of a model, of which some hang on others.

    Args:
        engine: The module `mujoco`.
        links: How bodies hang on others, by row; what others hang on first.
        loops: Joints that the engine holds by forces.
        rows: Row of each body by its number.
    """

    def __init__(
        self, engine: Any, links: Mapping[int, Link], loops: Sequence[PhysicsJoint], rows: Mapping[int, int]
    ) -> None:
        self._engine, self._links, self._loops, self._rows = engine, links, loops, rows
        self._carriers = {link.parent for link in links.values() if link.parent is not None}
        self._model: Any = None
        self._data: Any = None
        self._bodies: list[int] = []
        self._positions: list[int] = []
        self._velocities: list[slice] = []

    def order(self, count: int) -> list[int]:
        """Return all rows, in an order in which a body comes after the one on which it hangs."""
        return [*(row for row in range(count) if row not in self._links), *self._links]

    def carries(self, row: int) -> bool:
        """Return whether others hang on a body."""
        return row in self._carriers

    def joined(self, row: int) -> bool:
        """Return whether a body hangs on another, or another on it."""
        return row in self._links or row in self._carriers

    # Construction

    def add_body(self, spec: Any, row: int, made: Mapping[int, Any]) -> Any:
        """Add a body without parts to a specification and return it."""
        link = self._links.get(row)
        if link is None:
            body = spec.worldbody.add_body(name=f"body_{row}")
            body.add_freejoint()
            return body
        holder = spec.worldbody if link.parent is None else made[link.parent]
        pose = link.reference
        body = holder.add_body(name=f"body_{row}", pos=pose[:3].tolist(), quat=pose[3:].tolist())
        kinds = {
            RevoluteJoint: self._engine.mjtJoint.mjJNT_HINGE,
            PrismaticJoint: self._engine.mjtJoint.mjJNT_SLIDE,
            SphericalJoint: self._engine.mjtJoint.mjJNT_BALL,
        }
        joint = link.joint
        if isinstance(joint, FixedJoint):
            return body
        made_joint = body.add_joint(type=kinds[type(joint)], pos=link.frame[:3].tolist())
        if isinstance(joint, AxialJoint):
            made_joint.axis = link.axis.tolist()
            limits = _limits(joint)
            if limits is not None:
                made_joint.limited, made_joint.range = True, list(limits)
                made_joint.solref_limit = self._stiff(spec)
        return body

    def add_loops(self, spec: Any, made: Mapping[int, Any], step: float) -> None:
        """Add the joints that close loops, and leave out contacts between what is joined."""
        if not self._links and not self._loops:
            return
        spec.option.disableflags |= self._engine.mjtDisableBit.mjDSBL_FILTERPARENT
        pairs = {(row, link.parent) for row, link in self._links.items() if not link.joint.collide}
        for row, link in self._links.items():
            parent = spec.worldbody if link.parent is None else made[link.parent]
            self._add_cone(spec, f"cone_{row}", link.joint, (made[row], link.frame), (parent, link.parent_frame))
        for each in self._loops:
            one, other = self._rows[each.body], None if each.parent is None else self._rows[each.parent]
            pairs |= set() if each.joint.collide else {(one, other)}
            self._add_loop(spec, each, made[one], spec.worldbody if other is None else made[other])
        for one, other in sorted((one, other) for one, other in pairs if other is not None):
            spec.add_exclude(bodyname1=f"body_{one}", bodyname2=f"body_{other}")

    def _add_loop(self, spec: Any, each: PhysicsJoint, body: Any, parent: Any) -> None:
        joint, name = each.joint, f"loop_{each.number}"
        self._add_cone(spec, name, joint, (body, each.frame), (parent, each.parent_frame))
        offsets = [np.zeros(3)]
        if isinstance(joint, RevoluteJoint):
            offsets = [sign * ARM * np.eye(3)[AXES.index(joint.axis)] for sign in (-1.0, 1.0)]
        for part, offset in enumerate(offsets):
            ends = f"{name}_{part}_body", f"{name}_{part}_parent"
            for end, holder, frame in zip(ends, (body, parent), (each.frame, each.parent_frame), strict=True):
                place = frame[:3] + rotate(frame[3:], offset)
                holder.add_site(name=end, pos=place.tolist(), quat=frame[3:].tolist())
            if isinstance(joint, DistanceJoint):
                tendon = spec.add_tendon(name=name)
                for end in ends:
                    tendon.wrap_site(end)
                most = UNLIMITED if joint.max_distance is None else joint.max_distance
                tendon.limited, tendon.range = True, [joint.min_distance, max(most, joint.min_distance + ROPE)]
                tendon.solref_limit = self._stiff(spec)
                continue
            kinds = self._engine.mjtEq
            held = spec.add_equality(name=f"{name}_{part}", objtype=self._engine.mjtObj.mjOBJ_SITE)
            held.type = kinds.mjEQ_WELD if isinstance(joint, FixedJoint) else kinds.mjEQ_CONNECT
            held.name1, held.name2 = ends
            held.solref = self._stiff(spec)

    def _add_cone(self, spec: Any, name: str, joint: Joint, body: tuple[Any, Array], parent: tuple[Any, Array]) -> None:
        """Limit the angle between the axes of a spherical joint: the distance of two points on them, a chord.

        Args:
            spec: The specification.
            name: Of the limit.
            joint: The joint.
            body: The body, and the frame of the joint in its axes.
            parent: The other one, and the frame in its axes.
        """
        if not isinstance(joint, SphericalJoint) or joint.cone_angle is None:
            return
        tip = ARM * np.eye(3)[AXES.index(joint.axis)]
        tendon = spec.add_tendon(name=name)
        for end, (holder, frame) in zip((f"{name}_body", f"{name}_parent"), (body, parent), strict=True):
            holder.add_site(name=end, pos=(frame[:3] + rotate(frame[3:], tip)).tolist())
            tendon.wrap_site(end)
        tendon.limited = True
        tendon.range = [0.0, 2.0 * ARM * math.sin(0.5 * math.radians(joint.cone_angle))]
        tendon.solref_limit = self._stiff(spec)

    @staticmethod
    def _stiff(spec: Any) -> list[float]:
        """Return the stiffest reference of a constraint that is stable: time constant, damping ratio."""
        return [2.0 * spec.option.timestep, 1.0]

    def bind(self, model: Any, data: Any) -> None:
        """Find the coordinates of the bodies in a compiled model."""
        self._model, self._data = model, data
        for row in range(len(self._rows)):
            body = model.body(f"body_{row}").id
            joint = int(model.body_jntadr[body])
            self._bodies.append(body)
            self._positions.append(int(model.jnt_qposadr[joint]) if joint >= 0 else -1)
            start = int(model.body_dofadr[body])
            self._velocities.append(slice(start, start + int(model.body_dofnum[body])) if joint >= 0 else slice(0, 0))

    def body(self, row: int) -> int:
        """Return the number of a body in the compiled model."""
        return self._bodies[row]

    # State

    def update(self) -> None:
        """Compute poses and motions of bodies that hang on others."""
        if self._links:
            self._engine.mj_kinematics(self._model, self._data)
            self._engine.mj_comPos(self._model, self._data)
            self._engine.mj_comVel(self._model, self._data)

    def pose(self, row: int) -> Array:
        """Return the pose [7] of a body; after `update` if it hangs on another."""
        if row not in self._links:
            start = self._positions[row]
            return np.array(self._data.qpos[start : start + 7])
        body = self._bodies[row]
        return np.concatenate([self._data.xpos[body], self._data.xquat[body]])

    def motion(self, row: int) -> Array:
        """Return linear (world) and angular velocity (own axes) of a body, [6]; as of `pose`."""
        if row not in self._links:
            return np.array(self._data.qvel[self._velocities[row]])
        both = np.zeros(6)
        kind = self._engine.mjtObj.mjOBJ_XBODY
        self._engine.mj_objectVelocity(self._model, self._data, kind, self._bodies[row], both, 0)
        return np.concatenate([both[3:], rotate(conjugate(self._data.xquat[self._bodies[row]]), both[:3])])

    def place(self, row: int, pose: Array, motion: Array) -> None:
        """Set pose [7] and motion [6] of a body; of one that hangs on another, what its joint leaves free of them.

        What hangs on it comes along.
        """
        link, start, speeds = self._links.get(row), self._positions[row], self._velocities[row]
        if link is None:
            self._data.qpos[start : start + 7] = pose
            self._data.qvel[speeds] = motion
            return
        if start < 0:
            return
        self.update()
        parent = WORLD if link.parent is None else self.pose(link.parent)
        carried = np.zeros(6) if link.parent is None else self.motion(link.parent)
        spin = rotate(pose[3:], motion[3:]) - rotate(parent[3:], carried[3:])
        if isinstance(link.joint, SphericalJoint):
            turn = multiply(conjugate(compose(parent, link.reference)[3:]), pose[3:])
            self._data.qpos[start : start + 4] = turn
            self._data.qvel[speeds] = rotate(conjugate(pose[3:]), spin)
            return
        assert isinstance(link.joint, AxialJoint)
        frame = compose(parent, link.parent_frame)
        between = compose(inverse(frame), compose(pose, link.frame))
        axis = AXES.index(link.joint.axis)
        world_axis = link.sign * rotate(frame[3:], np.eye(3)[axis])
        if isinstance(link.joint, RevoluteJoint):
            low, high = _limits(link.joint) or (0.0, 0.0)
            middle = 0.5 * (low + high) if max(-low, high) < UNLIMITED else 0.0
            self._data.qpos[start] = link.sign * angle_about(between[3:], axis, link.sign * middle)
            self._data.qvel[speeds] = world_axis @ spin
            return
        lever = pose[:3] - parent[:3]
        along = motion[:3] - carried[:3] - np.cross(rotate(parent[3:], carried[3:]), lever)
        self._data.qpos[start] = link.sign * between[axis]
        self._data.qvel[speeds] = world_axis @ along

    def shift(self, row: int, offset: Array) -> None:
        """Move a free body by an offset [3]."""
        start = self._positions[row]
        self._data.qpos[start : start + 3] += offset

    def push(self, row: int, force: Array) -> None:
        """Apply a generalized force [6] to a free body in the steps from now on."""
        self._data.qfrc_applied[self._velocities[row]] = force


def _limits(joint: Joint) -> tuple[float, float] | None:
    """Return the limits of a joint, rad or m; None: it has none."""
    assert isinstance(joint, AxialJoint)
    if joint.lower_limit is None and joint.upper_limit is None:
        return None
    unit = math.radians(1.0) if isinstance(joint, RevoluteJoint) else 1.0
    low = -UNLIMITED if joint.lower_limit is None else joint.lower_limit * unit
    high = UNLIMITED if joint.upper_limit is None else joint.upper_limit * unit
    return low, max(high, low + 1e-9)
