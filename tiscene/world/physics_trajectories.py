# SPDX-License-Identifier: Apache-2.0
"""PhysicsTrajectories: trajectories of a scenario that may have rigid bodies.

Objects with a RigidBody are simulated by `tiscene.world.physics`. All other objects move as they do without them; they
push and carry rigid bodies and are not pushed.
"""

from __future__ import annotations

import bisect
import hashlib
import math
import warnings
from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from fractions import Fraction

import numpy as np

from dynamics.clocks import exact
from dynamics.lru_cache import LRUCache
from dynamics.rigid_body import RigidBody
from dynamics.rotation import quaternion
from tiscene.errors import ScenarioError, StageWarning, did_you_mean
from tiscene.scenario.edits import Edit, EditLog
from tiscene.scenario.joints import Joint
from tiscene.scenario.objects import Object
from tiscene.scenario.scenario import Scenario
from tiscene.scene.description import EARTH, Collider
from tiscene.world.physics.joint_tree import WORLD, PhysicsJoint, compose, inverse
from tiscene.world.physics.part_shapes import PartShape
from tiscene.world.physics.parts_cache import PartsCache
from tiscene.world.physics.physics_model import PhysicsBody, Surroundings
from tiscene.world.physics.rigid_body_simulation import PhysicsFrame, RigidBodySimulation, require_engine
from tiscene.world.physics.stage_parts import StageParts
from tiscene.world.trajectories import Array, Collision, Trajectories, TrajectoryContext, between_poses, replace_rows

KEPT_SHAPES = 64
MAX_SIZE = 1e5  # m, of objects: the engine fails on parts of much larger ones


class PhysicsTrajectories(Trajectories):
    """Poses of a scenario's objects, some of which may be rigid bodies; see `Trajectories`.

    Attributes:
        progress: called with what is being prepared and how much of it is done, 0..1; None: nothing is called.
    """

    progress: Callable[[str, float], None] | None = None
    _physics: RigidBodySimulation | None = None
    _physics_world: ScenarioPhysics | None = None

    def __init__(self, scenario: Scenario, log: EditLog, setting: TrajectoryContext) -> None:
        for history in log.histories:
            self.check(history.spec)
        super().__init__(scenario, log, setting)

    def check(self, spec: Object) -> None:
        """Raise MissingExtra if an object is a rigid body, and the physics engine is not installed."""
        if isinstance(spec.dynamic, RigidBody):
            require_engine()

    def close(self) -> None:
        super().close()
        self._physics = self._physics_world = None

    def amend(self, edit: Edit) -> None:
        changes = len(self._changes)
        super().amend(edit)
        if self._physics is not None:
            self._physics.amend(edit.frame)
            if len(self._changes) != changes:
                self._physics.surroundings_changed()

    def _at(self, frame: int, rows: tuple[int, ...], kind: str) -> Array:
        poses = super()._at(frame, rows, kind)
        if self._rigid_rows(rows):
            replace_rows(poses, rows, self._simulated(frame), kind)
        return poses

    def between(self, frame: int, shift: Fraction, rows: Sequence[int]) -> Array:
        poses, rigid = super().between(frame, shift, rows), self._rigid_rows(rows)
        if not rigid or shift in (0, 1):
            return poses
        start = math.floor(frame + shift)
        if start >= 0:
            before, after = self.poses(start, rows), self.arrivals(start + 1, rows)
            rigid_poses = between_poses(before, after, float(frame + shift - start))
            poses[rigid] = rigid_poses[rigid]
        else:
            poses[rigid] = self.poses(frame, rows)[rigid]
        return poses

    def collisions(self, frame: int) -> list[Collision]:
        found = super().collisions(frame)
        if not self._rigid_rows(self._log.around(frame)):
            return found
        before = set(self._simulated(frame - 1).contacts) if frame else set()
        for number, kind, other in self._simulated(frame).contacts:
            if (number, kind, other) in before:
                continue
            if kind == "stage":
                found.append(self.stage_collision(number, other))
            else:
                found.append(Collision(number, "object" if kind == "body" else "wall", other))
        return found

    def _rigid_rows(self, rows: Sequence[int]) -> list[int]:
        """Return the places in `rows` of rigid bodies."""
        histories = self._log.histories
        return [place for place, row in enumerate(rows) if isinstance(histories[row].spec.dynamic, RigidBody)]

    def _simulated(self, frame: int) -> PhysicsFrame:
        if self._physics is None:
            scenario = self._scenario
            self._physics_world = ScenarioPhysics(
                self, self._log, self._setting, scenario.joints, scenario.filtered_pairs
            )
            self._physics = RigidBodySimulation(self._physics_world, exact(self._setting.fps))
        return self._physics.frame(max(frame, 0))

    def kinematic_poses(self, frame: int, rows: tuple[int, ...]) -> tuple[Array, Array]:
        """Return the poses of objects that are no rigid bodies, at a frame and as planned for the next."""
        return Trajectories._at(self, frame, rows, "poses"), Trajectories._at(self, frame + 1, rows, "arrivals")

    def kinematic_arrival(self, frame: int, row: int) -> Array:
        """Return the pose [7] of an object that is no rigid body at a frame, before the edits of that frame."""
        begin: Array = Trajectories._at(self, frame, (row,), "arrivals")[0]
        return begin

    def stage_epoch(self, frame: int) -> int:
        """Return how often edits have changed the stage up to a frame."""
        return bisect.bisect_right(self._changes, frame)


class ScenarioPhysics:
    """What the physics engine simulates of a scenario: a PhysicsWorld.

    Args:
        trajectories: poses of the objects that are no rigid bodies, and walls.
        log: the scenario's edit log.
        setting: what the objects move in.
        joints: the scenario's joints.
        pairs: what does not collide, of `Scenario.filtered_pairs`.
    """

    def __init__(
        self,
        trajectories: PhysicsTrajectories,
        log: EditLog,
        setting: TrajectoryContext,
        joints: Sequence[Joint],
        pairs: Sequence[tuple[str, str]] = (),
    ) -> None:
        self._trajectories, self._log, self._setting, self._joints = trajectories, log, setting, joints
        self._pairs = pairs
        self._joined = {id for each in joints for id in (each.body, each.parent) if id is not None}
        self._made_joints: dict[tuple[int, int, int | None], PhysicsJoint] = {}
        self._parts: LRUCache[tuple[object, ...], list[PartShape]] = LRUCache(KEPT_SHAPES)
        self._stage_parts = StageParts(setting.stage.meshes, trajectories.progress)

    def bodies(self, frame: int) -> Sequence[PhysicsBody]:
        found = []
        for row in self._log.around(frame):
            history = self._log.histories[row]
            spec = history.spec
            rigid = spec.dynamic if isinstance(spec.dynamic, RigidBody) else None
            needed = rigid is not None or spec.id in self._joined
            if history.alive(frame, as_of=frame) and (spec.collide or needed):
                parts = self._parts_of(spec) if spec.collide or rigid is not None else []
                if parts or needed:
                    found.append(PhysicsBody(row, parts, rigid, spec.frustum_limited, spec.collide, spec.id))
        return found

    def joints(self, frame: int) -> Sequence[PhysicsJoint]:
        found = []
        for number, each in enumerate(self._joints):
            rows = [None if id is None else self._log.row(id) for id in (each.body, each.parent)]
            if all(row is None or self._log.histories[row].alive(frame, as_of=frame) for row in rows):
                body, parent = rows
                if body is not None and (parent is not None or each.parent is None):
                    key = number, body, parent
                    if key not in self._made_joints:
                        self._made_joints[key] = self._joint(number, each, body, parent)
                    found.append(self._made_joints[key])
        return found

    def filtered_pairs(self, frame: int) -> Collection[tuple[int, str, int]]:
        found = set()
        for pair in self._pairs:
            one, other = (self._log.row(name) for name in pair)
            if one is not None and other is not None:
                found.add((one, "body", other))
            elif one is not None or other is not None:
                row, name = (one, pair[1]) if one is not None else (other, pair[0])
                assert row is not None
                for number in self._stage_rows(frame, name) if name.startswith("/") else ():
                    found.add((row, "stage", number))
        return found

    def _stage_rows(self, frame: int, path: str) -> list[int]:
        """Return the rows of what stands around at and below a prim, or within the object whose only part it is."""
        stage = self._setting.stage
        instances, _ = self._setting.instances(frame)
        found = []
        for row, each in enumerate(instances):
            owner = stage.objects[each.object] if each.object >= 0 else None
            if isinstance(each, Collider) or owner is None:
                own, is_only = getattr(each, "prim_path", ""), False
            else:
                own = f"{owner.prim_path}/{owner.parts[each.part]}" if owner.parts else owner.prim_path
                is_only = not owner.parts and path.startswith(f"{own}/")
            if is_only or f"{own}/".startswith(f"{path.rstrip('/')}/"):
                found.append(row)
        if not found:
            hint = did_you_mean(path, [each.prim_path for each in stage.objects])
            text = f"filtered_pairs: nothing of the stage that collides is at {path!r}{hint}"
            warnings.warn(StageWarning(text), stacklevel=2)
        return found

    def _joint(self, number: int, joint: Joint, body: int, parent: int | None) -> PhysicsJoint:
        """Return a joint with both of its frames."""
        own = np.array([*joint.position, *quaternion(joint.rotation)])
        other = compose(inverse(WORLD if parent is None else self._begin(parent)), compose(self._begin(body), own))
        if joint.parent_position is not None:
            other[:3] = joint.parent_position
        if joint.parent_rotation is not None:
            other[3:] = quaternion(joint.parent_rotation)
        return PhysicsJoint(number, joint, body, parent, own, other)

    def _begin(self, row: int) -> Array:
        """Return the pose [7] at which an object begins, before any edit: joints are made once."""
        spec = self._log.histories[row].spec
        if isinstance(spec.dynamic, RigidBody):
            return self.start(row)
        return self._trajectories.kinematic_arrival(spec.first_frame, row)

    def surroundings(self, frame: int) -> tuple[Hashable, Callable[[], Surroundings]]:
        return self._trajectories.stage_epoch(frame), lambda: self._surroundings(frame)

    def start(self, number: int) -> Array:
        spec = self._log.histories[number].spec
        return np.array([*spec.position, *quaternion(spec.rotation)])

    def teleports(self, frame: int) -> Mapping[int, Array]:
        found = {}
        for row in self._log.around(frame):
            move = self._log.histories[row].move(frame)
            if move is not None and move.frame == frame:
                found[row] = np.array([*move.position, *quaternion(move.rotation)])
        return found

    def arrival(self, frame: int, number: int) -> Array:
        return self._trajectories.kinematic_arrival(frame, number)

    def mover_poses(self, frame: int, numbers: Sequence[int]) -> tuple[Array, Array]:
        return self._trajectories.kinematic_poses(frame, tuple(numbers))

    def walls(self, time: Fraction) -> Array | None:
        return self._trajectories.walls(time)

    def places_walls(self, frame: int) -> bool:
        edits = self._log.enclosures
        place = bisect.bisect_left(edits, frame, key=lambda edit: edit.frame)
        return place < len(edits) and edits[place].frame == frame

    def _surroundings(self, frame: int) -> Surroundings:
        instances, present = self._setting.instances(frame)
        placed = self._stage_parts.placed(instances, present)
        x, y, z = self._setting.stage.up
        return Surroundings(placed, self._setting.stage.gravity or (-EARTH * x, -EARTH * y, -EARTH * z))

    def _parts_of(self, spec: Object) -> list[PartShape]:
        """Return the parts of an object's collision surface, shared by template and scale."""
        return self._parts.get((spec.template, spec.scale), lambda: _parts_of(self._setting.surface(spec), spec.id))


def _parts_of(surface: Array, name: str) -> list[PartShape]:
    size = float(np.ptp(surface.reshape(-1, 3), axis=0).max()) if len(surface) else 0.0
    if not size <= MAX_SIZE:
        raise ScenarioError(
            f"object {name!r} is {size:.3g} m large: with physics=True, none may be larger than {MAX_SIZE:g} m"
        )
    disk = PartsCache(hashlib.sha256(surface.tobytes()).digest())
    parts = disk.parts(surface, min(max(0.02 * size, 0.001), 0.01), min(0.02 * size, 0.004))
    disk.save()
    return parts
