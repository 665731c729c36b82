# SPDX-License-Identifier: Apache-2.0
"""Bodies and their surroundings as a MuJoCo model.

Rigid bodies fall and collide. Movers follow poses that are given: they are free bodies of great mass whose position and
velocity are set before every step, so that they carry and push others and nothing pushes them. The surroundings and the
walls do not move others than by being in their way. Bodies that hang on others by joints have the coordinates of the
joint; all others have those of a free body.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from dynamics.rigid_body import RigidBody
from dynamics.rotation import matrix_from_quaternion, quaternion
from tiscene.errors import ScenarioError
from tiscene.world.physics.free_rotation import FreeRotation
from tiscene.world.physics.joint_tree import PhysicsJoint, joint_tree
from tiscene.world.physics.joints_in_engine import JointsInEngine
from tiscene.world.physics.part_shapes import PartShape

Array = NDArray[np.float64]
STEP = 0.002  # s: longest step of the engine
CONTACT_TIME = 0.006  # s: time constant of a contact
MOVER_MASS = 1e5  # kg
CARRIER_MASS = 1e8  # kg: of movers that others hang on
SEPARATIONS = 40  # most moves of bodies that are placed inside of something
SLOP = 5e-4  # m: bodies that overlap by less are not moved
STATIC, RIGID, MOVER, WALL = 1, 2, 4, 8  # bits of collision
WALLS = 6
ARENA = 2**30  # bytes: most that contacts may take; only what they use is ever touched
REPORTED = 1000  # warnings of failures that the engine believes to have printed: it prints the first and logs it
ENLARGE = "make it larger or denser, or let it stay with Still()"


@dataclass(frozen=True, eq=False)
class PhysicsBody:
    """A body of a simulation.

    Attributes:
        number: Its number, which stays the same in all models.
        parts: Its shape.
        rigid: Its properties; None for a mover, whose poses are given.
        limited: Whether walls hold it.
        collides: Whether its parts touch others; else they are its mass alone.
        name: Its name in messages.
    """

    number: int
    parts: Sequence[PartShape]
    rigid: RigidBody | None
    limited: bool
    collides: bool = True
    name: str = ""


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What stands around the bodies.

    Attributes:
        placed: Number in contacts, pose [7] and parts of each object or instance.
        gravity: m/s2, world.
    """

    placed: Sequence[tuple[int, Array, Sequence[PartShape]]]
    gravity: tuple[float, float, float]


class PhysicsModel:
    """A compiled model and its state.

    Attributes:
        bodies: The bodies in the order of their rows.
        walled: Whether there are walls.
        joints: Poses and motions of the bodies, and how they hang on others.
        gravity: Acceleration [6] of bodies that fall freely.
        lag: How much earlier than poses velocities are, s. Free bodies are integrated by steps of velocity and position
            in turn (leapfrog), which is exact for free fall; joints by the Runge-Kutta method, which keeps energy.
    """

    def __init__(
        self,
        bodies: Sequence[PhysicsBody],
        around: Surroundings,
        walled: bool,
        step: float,
        joints: Sequence[PhysicsJoint],
        filtered: Collection[tuple[int, str, int]] = (),
    ) -> None:
        """Compile a model.

        Args:
            bodies: The bodies.
            around: What stands around them.
            walled: Whether there are walls.
            step: Length of a step, s.
            joints: Joints between the bodies.
            filtered: What does not collide: number of a body, kind ("stage" or "body") and number of the other.

        Raises:
            ScenarioError: A body has too little mass, or a shape without volume.
        """
        import mujoco

        self.bodies, self.walled = tuple(bodies), walled
        rows = {body.number: row for row, body in enumerate(self.bodies)}
        links, loops = joint_tree(joints, rows, [row for row, body in enumerate(self.bodies) if body.rigid is None])
        self.joints = JointsInEngine(mujoco, links, loops, rows)
        self._engine: Any = mujoco
        self._mesh_count = 0  # `len(spec.meshes)` would make an object for each of them
        spec = self._new_spec(step, around.gravity, is_linked=bool(links))
        self.lag = 0.0 if links else 0.5 * step
        self.gravity = np.array([*around.gravity, 0.0, 0.0, 0.0])
        stage: list[int] = []
        apart = {number for _, kind, number in filtered if kind == "stage"}
        for number, pose, parts in around.placed:
            holder = spec.worldbody.add_body(name=f"stage_{number}") if number in apart else spec.worldbody
            for part in parts:
                self._add(spec, holder, part, contype=STATIC, conaffinity=0, pose=pose)
            stage += [] if number in apart else [number] * len(parts)
        made: dict[int, Any] = {}
        for row in self.joints.order(len(self.bodies)):
            made[row] = self._add_body(spec, self.joints.add_body(spec, row, made), row)
        self.joints.add_loops(spec, made, step)
        self._filter(spec, filtered, rows, {number for number, _, _ in around.placed})
        if walled:
            self._add_walls(spec)
        self._model = self._compiled(spec)
        if self._set_masses(made):
            self._model = self._compiled(spec)
        rigid = [row for row, body in enumerate(self.bodies) if body.rigid is not None]
        masses = [float(self._model.body(f"body_{row}").mass[0]) for row in rigid]
        self._model.stat.meaninertia = sum(masses) / len(masses) if masses else 1.0
        self._data = mujoco.MjData(self._model)
        self.joints.bind(self._model, self._data)
        free = [self.joints.body(row) for row in rigid] if not links else []
        self._rotation = FreeRotation(mujoco, self._model, free)
        self._owners = [("stage", number) for number in stage]
        for body in self._model.geom_bodyid[len(stage) :].tolist():
            kind, _, row = self._model.body(body).name.partition("_")
            self._owners.append((kind, int(row)))
        kinds = mujoco.mjtWarning
        starts = self._model.jnt_qposadr, self._model.jnt_dofadr, self._model.jnt_dofadr
        self._failures = dict(
            zip((kinds.mjWARN_BADQPOS, kinds.mjWARN_BADQVEL, kinds.mjWARN_BADQACC), starts, strict=True)
        )
        self._state_size = mujoco.mj_stateSize(self._model, mujoco.mjtState.mjSTATE_INTEGRATION)

    def _new_spec(self, step: float, gravity: tuple[float, float, float], *, is_linked: bool) -> Any:
        """Return an empty model with the options of the simulation."""
        spec = self._engine.MjSpec()
        spec.compiler.degree = False
        spec.memory = ARENA
        option = spec.option
        option.timestep, option.gravity = step, list(gravity)
        option.cone, option.impratio = self._engine.mjtCone.mjCONE_ELLIPTIC, 10.0
        option.noslip_iterations, option.iterations = 4, 100
        if is_linked:
            option.integrator = self._engine.mjtIntegrator.mjINT_RK4
        return spec

    def _add_walls(self, spec: Any) -> None:
        """Add the planes of a frustum."""
        plane = {"type": self._engine.mjtGeom.mjGEOM_PLANE, "size": [0.0, 0.0, 1.0], "friction": [0.0] * 3}
        for wall in range(WALLS):
            holder = spec.worldbody.add_body(mocap=True, name=f"wall_{wall}")
            holder.add_geom(**plane, contype=WALL, conaffinity=0)

    def _add_body(self, spec: Any, made: Any, row: int) -> Any:
        """Add properties and parts to a body; return it."""
        body = self.bodies[row]
        if body.rigid is None:
            mass = CARRIER_MASS if self.joints.carries(row) else MOVER_MASS
            made.explicitinertial, made.mass = True, mass
            made.inertia, made.gravcomp = [mass] * 3, 1.0
            named: dict[str, Any] = {"contype": MOVER, "conaffinity": 0}
        else:
            damping = _damping_of(body.rigid.restitution)
            named = {
                "contype": RIGID,
                "conaffinity": STATIC | RIGID | MOVER | (WALL if body.limited else 0),
                "density": body.rigid.density,
                "friction": [body.rigid.friction, 0.005, 0.0002],
                "solref": [CONTACT_TIME / damping, damping],
                "condim": 6 if body.rigid.friction > 0.0 else 1,
                "priority": 1,
            }
        if not body.collides:
            named |= {"contype": 0, "conaffinity": 0}
        for part in body.parts:
            self._add(spec, made, part, **named)
        return made

    @staticmethod
    def _filter(
        spec: Any, filtered: Collection[tuple[int, str, int]], rows: Mapping[int, int], placed: Collection[int]
    ) -> None:
        """Leave out contacts of what does not collide, as far as it is there."""
        for number, kind, other in sorted(filtered):
            if number not in rows or other not in (rows if kind == "body" else placed):
                continue
            name = f"body_{rows[other]}" if kind == "body" else f"stage_{other}"
            spec.add_exclude(bodyname1=f"body_{rows[number]}", bodyname2=name)

    def _compiled(self, spec: Any) -> Any:
        try:
            return spec.compile()
        except ValueError as error:
            found = re.search(r"'body_(\d+)(/\d+)?'", str(error))  # a body, or one of its meshes
            owner = "a part of the stage" if found is None else self._named(int(found[1]))
            if found is None or found[2]:
                raise ScenarioError(f"{owner} has a shape that cannot be simulated: {error}") from error
            raise ScenarioError(f"{owner} is too small or light to be simulated; {ENLARGE}") from error

    def _set_masses(self, made: Mapping[int, Any]) -> bool:
        """Set the masses and moments of inertia that are not those of shapes; return whether there are any."""
        any_given = False
        for row, each in enumerate(self.bodies):
            rigid, body = each.rigid, self._model.body(f"body_{row}")
            if rigid is None or (rigid.mass, rigid.center_of_mass, rigid.diagonal_inertia) == (None, None, None):
                continue
            any_given, own = True, float(body.mass[0])
            made[row].explicitinertial, made[row].mass = True, own if rigid.mass is None else rigid.mass
            made[row].ipos = body.ipos if rigid.center_of_mass is None else rigid.center_of_mass
            made[row].inertia, made[row].iquat = body.inertia * (made[row].mass / own), body.iquat
            if rigid.diagonal_inertia is not None:
                made[row].inertia, made[row].iquat = rigid.diagonal_inertia, quaternion(rigid.principal_axes)
        return any_given

    def _add(self, spec: Any, body: Any, part: PartShape, pose: Array | None = None, **named: Any) -> None:
        """Add a part to a body, at a pose or in the axes of the body."""
        kinds = self._engine.mjtGeom
        turn = np.array([1.0, 0.0, 0.0, 0.0]) if pose is None else pose[3:]
        position = part.center.copy() if part.kind != "hull" else np.zeros(3)
        if pose is not None:
            position = matrix_from_quaternion(turn) @ position + pose[:3]
        match part.kind:
            case "box":
                shape: dict[str, Any] = {"type": kinds.mjGEOM_BOX, "size": part.half.tolist()}
            case "sphere":
                shape = {"type": kinds.mjGEOM_SPHERE, "size": [float(part.half[0]), 0.0, 0.0]}
            case "cylinder" | "capsule":
                radius, height = float(part.half[part.axis - 1]), float(part.half[part.axis])
                kind = kinds.mjGEOM_CYLINDER if part.kind == "cylinder" else kinds.mjGEOM_CAPSULE
                shape = {"type": kind, "size": [radius, height - radius * (part.kind == "capsule"), 0.0]}
                turn = _with_axis(turn, part.axis)
            case _:
                name = f"{body.name}/{self._mesh_count}"
                self._mesh_count += 1
                mesh = spec.add_mesh(name=name)
                mesh.uservert = part.points.ravel().tolist()
                mesh.inertia = self._engine.mjtMeshInertia.mjMESH_INERTIA_CONVEX
                shape = {"type": kinds.mjGEOM_MESH, "meshname": name}
        body.add_geom(pos=position.tolist(), quat=turn.tolist(), **shape, **named)

    # State

    def save(self) -> Array:
        """Return everything that the next steps depend on."""
        state = np.empty(self._state_size)
        self._engine.mj_getState(self._model, self._data, state, self._engine.mjtState.mjSTATE_INTEGRATION)
        return state

    def restore(self, state: Array) -> None:
        """Return to a state that was saved."""
        self._engine.mj_setState(self._model, self._data, state, self._engine.mjtState.mjSTATE_INTEGRATION)

    def reset(self) -> None:
        """Forget the state before, of which contacts would keep a trace."""
        self._engine.mj_resetData(self._model, self._data)

    def start_motion(self, row: int, pose: Array, *, still: bool = False) -> Array:
        """Return the motion [6] with which a rigid body begins, `lag` before its pose.

        Args:
            row: The body.
            pose: Its pose [7].
            still: Begin at rest, whatever its initial velocities.
        """
        rigid = self.bodies[row].rigid
        assert rigid is not None
        velocity = np.zeros(3) if still else np.array(rigid.velocity)
        spin = np.zeros(3) if still else np.array(rigid.angular_velocity)
        own = matrix_from_quaternion(pose[3:]).T @ spin
        motion = self._rotation.earlier(self.joints.body(row), pose, np.concatenate([velocity, own]))
        return motion - self.lag * self.gravity

    def accelerate(self, row: int, change: Array) -> None:
        """Change the motion of a mover by `change` [6] in the next step, which those that hang on it feel."""
        self.joints.push(row, CARRIER_MASS * change / self._model.opt.timestep)

    def separate(self, rows: Sequence[int]) -> None:
        """Move rigid bodies out of what they are placed inside of, without giving them speed.

        Args:
            rows: The bodies that may move.
        """
        movable = {row for row in rows if not self.joints.joined(row)}
        for _ in range(SEPARATIONS if movable else 0):
            self._engine.mj_fwdPosition(self._model, self._data)
            shifts: dict[int, Array] = {}
            for number in range(self._data.ncon):
                contact = self._data.contact[number]
                if contact.dist > -SLOP:
                    continue
                owners = [self._owners[geom] for geom in contact.geom.tolist()]
                sides = [(row, sign) for (kind, row), sign in zip(owners, (-1.0, 1.0), strict=True) if kind == "body"]
                sides = [(row, sign) for row, sign in sides if row in movable]
                for row, sign in sides:
                    shift = sign * (-contact.dist / len(sides)) * np.array(contact.frame[:3])
                    before = shifts.get(row)
                    if before is None or shift @ shift > before @ before:
                        shifts[row] = shift
            if not shifts:
                return
            for row, shift in shifts.items():
                self.joints.shift(row, shift)

    def place_walls(self, planes: Array) -> None:
        """Move the walls to planes [6, 4]; inside is n . x + d >= 0."""
        for wall, (x, y, z, d) in enumerate(planes.tolist()):
            self._data.mocap_pos[wall] = (-d * x, -d * y, -d * z)
            self._data.mocap_quat[wall] = _towards(np.array([x, y, z]))

    def step(self) -> list[tuple[int, tuple[str, int]]]:
        """Advance by a step; return row of a rigid body and owner of the other part for each contact.

        Raises:
            ScenarioError: A body moves in a way that cannot be simulated. The engine has lost its state then.
        """
        for kind in self._failures:
            self._data.warning[kind].number = REPORTED
        too_fast = self._rotation.apply(self._data)
        if too_fast is not None:
            self._fail(too_fast)
        self._engine.mj_step(self._model, self._data)
        self._check_stability()
        touching = []
        for one, other in self._data.contact.geom.tolist()[: self._data.ncon]:
            for mine, theirs in ((one, other), (other, one)):
                kind, row = self._owners[mine]
                if kind == "body" and self.bodies[row].rigid is not None:
                    touching.append((row, self._owners[theirs]))
        return touching

    def _check_stability(self) -> None:
        """Raise ScenarioError if the engine has given up a body, and with it the state of all."""
        for kind, starts in self._failures.items():
            warning = self._data.warning[kind]
            if warning.number not in (0, REPORTED):  # the engine has set all to 0, then counted its failure
                joint = int(np.searchsorted(starts, warning.lastinfo, side="right")) - 1
                self._fail(int(self._model.jnt_bodyid[joint]))

    def _fail(self, body: int) -> NoReturn:
        row = int(self._model.body(body).name.removeprefix("body_"))
        raise ScenarioError(f"{self._named(row)} is too small, light or fast to be simulated; {ENLARGE}")

    def _named(self, row: int) -> str:
        return f"object {self.bodies[row].name!r}"


def _with_axis(turn: Array, axis: int) -> Array:
    """Return a rotation after that of MuJoCo's axis, which is z, to another one."""
    w, x, y, z = turn.tolist()
    half = math.sqrt(0.5)
    match axis:
        case 0:
            return half * np.array([w - y, x - z, y + w, z + x])
        case 1:
            return half * np.array([w + x, x - w, y - z, z + y])
        case _:
            return turn


def _damping_of(restitution: float) -> float:
    """Return the damping ratio of a contact after which a body has this fraction of its speed."""
    if restitution <= 0.0:
        return 1.0
    logarithm = math.log(restitution)
    return -logarithm / math.hypot(math.pi, logarithm)


def _towards(normal: Array) -> Array:
    """Return the quaternion that turns +z to a unit vector."""
    x, y, z = normal.tolist()
    if z < -1.0 + 1e-12:
        return np.array([0.0, 1.0, 0.0, 0.0])
    quaternion = np.array([1.0 + z, -y, x, 0.0])
    return np.asarray(quaternion / np.linalg.norm(quaternion))
