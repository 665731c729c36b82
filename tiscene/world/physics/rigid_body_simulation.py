# SPDX-License-Identifier: Apache-2.0
"""RigidBodySimulation: frames of bodies that fall, are pushed and come to rest.

A frame is advanced in steps of equal length. A new model is compiled where bodies appear or go, or the surroundings
change; the bodies that stay keep pose and velocity. Checkpoints let any earlier frame be computed again with the same
bits, in bounded memory.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import NamedTuple, Protocol

import numpy as np

from dynamics.checkpoints import Checkpoints
from dynamics.lru_cache import LRUCache
from dynamics.rotation import matrix_from_quaternion
from dynamics.whole_changes import WholeChanges, as_a_whole
from tiscene.errors import requires_extra
from tiscene.world.physics.joint_tree import PhysicsJoint
from tiscene.world.physics.mover_path import MoverPath
from tiscene.world.physics.physics_model import STEP, Array, PhysicsBody, PhysicsModel, Surroundings

CHECKPOINT = 16  # initial number of frames between checkpoints
MAX_CHECKPOINTS = 512
CACHED_FRAMES = 16  # results kept for repeated requests
CACHED_MODELS = 3
WALL_SLOP = 0.01  # m: bodies that reach through walls by less are left to the engine, as those that lean on them


def require_engine() -> None:
    """Raise MissingExtra unless MuJoCo and SciPy are installed."""
    with requires_extra("physics"):
        import mujoco  # noqa: F401
        import scipy  # noqa: F401


class PhysicsWorld(Protocol):
    """What is simulated, from each frame to the next; functions of the frame and of edits up to it alone."""

    def bodies(self, frame: int) -> Sequence[PhysicsBody]:
        """Return the bodies that exist at a frame, by ascending number."""

    def joints(self, frame: int) -> Sequence[PhysicsJoint]:
        """Return the joints between the bodies of a frame, by ascending number."""

    def filtered_pairs(self, frame: int) -> Collection[tuple[int, str, int]]:
        """Return what does not collide: number of a body, kind ("stage" or "body") and number of the other."""

    def surroundings(self, frame: int) -> tuple[Hashable, Callable[[], Surroundings]]:
        """Return a key of the surroundings from a frame to the next, and a function that returns them."""

    def start(self, number: int) -> Array:
        """Return the pose [7] at which a rigid body begins."""

    def teleports(self, frame: int) -> Mapping[int, Array]:
        """Return the poses [7] to which rigid bodies are moved at a frame, by number."""

    def arrival(self, frame: int, number: int) -> Array:
        """Return the pose [7] of a mover at a frame, before it is moved at that frame."""

    def mover_poses(self, frame: int, numbers: Sequence[int]) -> tuple[Array, Array]:
        """Return the poses [n, 7] of movers at a frame, and those planned for the next."""

    def walls(self, time: Fraction) -> Array | None:
        """Return the planes [6, 4] that hold limited bodies up to a time, s; None without walls."""

    def places_walls(self, frame: int) -> bool:
        """Return whether walls are placed anew at a frame, apart from those that move with their camera."""


@dataclass(frozen=True, eq=False)
class PhysicsFrame:
    """The rigid bodies at a frame.

    Attributes:
        numbers: Their numbers, ascending.
        poses: float64 [n, 7], position (m) and unit quaternion.
        arrivals: The same before they are moved at this frame.
        contacts: Number of a rigid body, kind ("stage", "body" or "wall") and number of what it has touched since the
            frame before.
    """

    numbers: tuple[int, ...]
    poses: Array
    arrivals: Array
    contacts: tuple[tuple[int, str, int], ...]


class _Saved(NamedTuple):
    """The state with which bodies arrive at a frame: of each rigid body, and of the engine if its model stays."""

    key: Hashable
    rigid: dict[int, tuple[Array, Array]]
    engine: Array
    contacts: tuple[tuple[int, str, int], ...]
    lag: float = 0.0  # s: how much earlier than poses velocities are
    asleep: frozenset[int] = frozenset()  # numbers of the bodies that nothing has touched yet


_NOTHING = _Saved(None, {}, np.zeros(0), ())


class _Prepared(NamedTuple):
    """The bodies at the start of a frame, before they are simulated to the next.

    Attributes:
        key: Key of the model.
        model: The model, with all bodies at their places.
        bodies: The bodies by row.
        paths: Ways of the movers to the next frame, by row.
        walls: Planes [6, 4] at the end of each step; None without walls.
        begun: Rows of rigid bodies that were placed anew.
        asleep: Rows of rigid bodies that stay in their places until they are touched.
    """

    key: Hashable
    model: PhysicsModel
    bodies: Sequence[PhysicsBody]
    paths: dict[int, MoverPath]
    walls: list[Array | None]
    begun: list[int]
    asleep: set[int]


class RigidBodySimulation(WholeChanges):
    """Simulates rigid bodies frame by frame.

    Frame k is a pure function of the world: the same bits in any order of requests on one machine and with one version
    of the engine. A frame that is requested for the first time costs the frames since the last checkpoint.

    Attributes:
        simulated_frames: Number of frames computed so far, those computed again included.
    """

    def __init__(self, world: PhysicsWorld, fps: Fraction) -> None:
        """Prepare; nothing is simulated yet.

        Args:
            world: What is simulated.
            fps: Frames per second.

        Raises:
            MissingExtra: MuJoCo or SciPy is not installed.
        """
        require_engine()
        self._world, self._fps = world, fps
        self._steps = max(1, math.ceil(1 / (fps * Fraction(str(STEP)))))
        self._step = float(1 / (fps * self._steps))
        self.simulated_frames = 0
        self._current = (-1, _NOTHING)
        self._checkpoints: Checkpoints[_Saved] = Checkpoints(CHECKPOINT, MAX_CHECKPOINTS)
        self._results: LRUCache[int, PhysicsFrame] = LRUCache(CACHED_FRAMES)
        self._models: LRUCache[Hashable, PhysicsModel] = LRUCache(CACHED_MODELS)
        self._loaded: tuple[Hashable, Surroundings] | None = None

    @property
    def checkpoint_count(self) -> int:
        """Number of states that are kept."""
        return len(self._checkpoints)

    def amend(self, frame: int) -> None:
        """Forget what edits at a frame change; states with which bodies arrive at it stay valid."""
        self._results.drop(lambda number: number >= frame)
        for number in [each for each in self._checkpoints if each > frame]:
            del self._checkpoints[number]
        if self._current[0] > frame:
            self._current = (-1, self._current[1])

    def surroundings_changed(self) -> None:
        """Compile all models anew when they are needed."""
        self._models.drop(lambda _key: True)
        self._loaded = None
        self._current = (-1, self._current[1])

    def frame(self, number: int) -> PhysicsFrame:
        """Return the rigid bodies at a frame, 0 or more."""
        if self.is_unfinished:  # models are between two steps of the engine
            self.surroundings_changed()
            self._checkpoints.clear()
            self.is_unfinished = False
        return self._results.get(number, lambda: self._simulated(number))

    @as_a_whole
    def _simulated(self, number: int) -> PhysicsFrame:
        reached, saved = self._current
        if not 0 <= reached <= number:
            reached = max((each for each in self._checkpoints if each <= number), default=-1)
            saved = self._checkpoints.get(reached, _NOTHING)
            reached = max(reached, 0)
        while reached < number:
            saved = self._advance(reached, saved)
            reached += 1
            self._checkpoints.add(reached, saved)
        self._current = (reached, saved)
        return self._result(number, saved)

    def _result(self, frame: int, saved: _Saved) -> PhysicsFrame:
        there = {body.number: body for body in self._world.bodies(frame) if body.rigid is not None}
        numbers = tuple(sorted({*there, *saved.rigid}))  # those that are gone have arrived there too
        arrivals = [
            saved.rigid[number][0] if number in saved.rigid else self._world.start(number) for number in numbers
        ]
        moved = self._moved(frame, saved)
        poses = [moved.get(number, pose) for number, pose in zip(numbers, arrivals, strict=True)]
        shape = (len(numbers), 7)
        return PhysicsFrame(numbers, np.reshape(poses, shape), np.reshape(arrivals, shape), saved.contacts)

    def _moved(self, frame: int, saved: _Saved) -> Mapping[int, Array]:
        """Return the poses [7] to which rigid bodies are moved at a frame; joined ones as their joints let them."""
        moved = self._world.teleports(frame)
        joints = self._world.joints(frame) if moved else ()
        if not any(number in moved for each in joints for number in (each.body, each.parent)):
            return moved
        start = self._prepared(frame, saved)
        start.model.joints.update()
        joined = {
            body.number: start.model.joints.pose(row)
            for row, body in enumerate(start.bodies)
            if body.rigid is not None and start.model.joints.joined(row)
        }
        return {**moved, **joined}

    def _advance(self, frame: int, saved: _Saved) -> _Saved:
        """Simulate from a frame to the next."""
        self.simulated_frames += 1
        if not any(body.rigid is not None for body in self._world.bodies(frame)):
            return _NOTHING
        key, model, bodies, paths, walls, begun, asleep = self._prepared(frame, saved)
        if model.walled and walls[0] is not None:
            model.place_walls(walls[0])
        model.separate(begun)
        places = {row: model.joints.pose(row) for row in asleep}
        rest = {row: (pose, model.start_motion(row, pose, still=True)) for row, pose in places.items()}
        still = {row for row, path in paths.items() if np.array_equal(path.start, path.end)}
        touched: dict[tuple[int, str, int], None] = {}
        for part in range(self._steps):
            for row, path in paths.items():
                pose, motion = path.at(part, self._steps, self._step)
                if path.before is not None:
                    model.accelerate(row, motion - path.before)
                    path.before, motion = motion, path.before
                model.joints.place(row, pose, motion)
            planes = walls[part]
            if model.walled and planes is not None:
                model.place_walls(planes)
            for row in asleep:
                model.joints.place(row, *rest[row])
            contacts = model.step()
            asleep -= {
                row for row, (kind, other) in contacts if kind == "body" and other not in still and other not in asleep
            }
            for row, (kind, other) in contacts:
                number = bodies[other].number if kind == "body" else other
                touched[bodies[row].number, kind, number] = None
        for row in asleep:
            model.joints.place(row, *rest[row])
        model.joints.update()
        rigid = {
            body.number: (model.joints.pose(row), model.joints.motion(row))
            for row, body in enumerate(bodies)
            if body.rigid is not None
        }
        sleepers = frozenset(bodies[row].number for row in asleep)
        return _Saved(key, rigid, model.save(), tuple(sorted(touched)), model.lag, sleepers)

    def _prepared(self, frame: int, saved: _Saved) -> _Prepared:
        """Place all bodies as a frame begins, the moved ones at their new poses."""
        bodies, joints = self._world.bodies(frame), self._world.joints(frame)
        times = [Fraction(frame * self._steps + part, self._steps) / self._fps for part in range(self._steps + 1)]
        walls = [self._world.walls(time) for time in times[1:]]
        walled = all(planes is not None for planes in walls)
        around, make = self._world.surroundings(frame)
        key = (
            tuple((body.number, body.limited) for body in bodies),
            tuple(each.number for each in joints),
            around,
            walled,
        )
        model = self._model(key, frame, bodies, joints, around, make, walled)
        teleports = self._world.teleports(frame)
        if saved.key == key:
            model.restore(saved.engine)
        else:
            model.reset()
        paths = self._mover_paths(frame, bodies, model)
        places = {row: path.at(0, self._steps, self._step) for row, path in paths.items()}
        order = [row for row in model.joints.order(len(bodies)) if bodies[row].rigid is not None]
        begun = [row for row in order if bodies[row].number in teleports or bodies[row].number not in saved.rigid]
        if saved.key != key:
            for row, (pose, motion) in places.items():  # before it is moved: what hangs on it comes along then
                is_moved = model.joints.carries(row) and bodies[row].number in teleports
                model.joints.place(row, self._world.arrival(frame, bodies[row].number) if is_moved else pose, motion)
            for row in order:
                pose, motion = self._begin(model, row, saved)
                is_free = bodies[row].limited and not model.joints.joined(row) and bodies[row].number not in saved.rigid
                model.joints.place(row, _inside(pose, bodies[row], walls[0]) if is_free else pose, motion)
        for row, (pose, motion) in places.items():
            model.joints.place(row, pose, motion)
        for row in order:
            if bodies[row].number in teleports:
                pose = teleports[bodies[row].number]
                model.joints.place(row, pose, model.start_motion(row, pose, still=True))
        if walled and self._world.places_walls(frame):
            begun += [row for row in order if row not in begun and self._is_pulled_in(model, row, walls[0])]
        known = saved.rigid.keys() - saved.asleep
        asleep = {
            row
            for row in order
            if (rigid := bodies[row].rigid) is not None and rigid.starts_asleep and not model.joints.joined(row)
            if bodies[row].number not in teleports and bodies[row].number not in known
        }
        return _Prepared(key, model, bodies, paths, walls, begun, asleep)

    def _begin(self, model: PhysicsModel, row: int, saved: _Saved) -> tuple[Array, Array]:
        """Return pose [7] and motion [6] with which a rigid body begins in a new model."""
        number = model.bodies[row].number
        if number in saved.rigid:
            pose, motion = saved.rigid[number]
            return pose, motion + (saved.lag - model.lag) * model.gravity
        pose = self._world.start(number)
        return pose, model.start_motion(row, pose)

    @staticmethod
    def _is_pulled_in(model: PhysicsModel, row: int, planes: Array | None) -> bool:
        """Move a free body inside of walls that an edit has placed, which would fling it; return whether it was out."""
        body, pose = model.bodies[row], model.joints.pose(row)
        if not body.limited or model.joints.joined(row):
            return False
        moved = _inside(pose, body, planes)
        is_out = bool(np.abs(moved - pose).max() > WALL_SLOP)
        if is_out:
            model.joints.place(row, moved, model.joints.motion(row))
        return is_out

    def _mover_paths(self, frame: int, bodies: Sequence[PhysicsBody], model: PhysicsModel) -> dict[int, MoverPath]:
        """Return the ways of the movers from a frame to the next, by row."""
        rows = [row for row, body in enumerate(bodies) if body.rigid is None]
        if not rows:
            return {}
        here, there = self._world.mover_poses(frame, [bodies[row].number for row in rows])
        paths = {row: MoverPath(here[place], there[place]) for place, row in enumerate(rows)}
        carriers = [row for row in rows if model.joints.carries(row)]
        for row in carriers:
            paths[row].before = paths[row].at(0, self._steps, self._step)[1]
        before = {body.number for body in self._world.bodies(frame - 1)} if carriers and frame else set()
        known = [row for row in carriers if bodies[row].number in before]
        if known:
            earlier = self._world.mover_poses(frame - 1, [bodies[row].number for row in known])
            for place, row in enumerate(known):
                way = MoverPath(earlier[0][place], earlier[1][place])
                paths[row].before = way.at(self._steps - 1, self._steps, self._step)[1]
        return paths

    def _model(
        self,
        key: Hashable,
        frame: int,
        bodies: Sequence[PhysicsBody],
        joints: Sequence[PhysicsJoint],
        around: Hashable,
        make: Callable[[], Surroundings],
        walled: bool,
    ) -> PhysicsModel:
        """Return the model of bodies and surroundings."""

        def new() -> PhysicsModel:
            if self._loaded is None or self._loaded[0] != around:
                self._loaded = around, make()
            filtered = self._world.filtered_pairs(frame)
            return PhysicsModel(bodies, self._loaded[1], walled, self._step, joints, filtered)

        return self._models.get(key, new)


def _inside(pose: Array, body: PhysicsBody, planes: Array | None) -> Array:
    """Return a pose moved inside of the walls."""
    if planes is None or not body.parts or not body.collides:
        return pose
    points = np.concatenate([part.points for part in body.parts]) @ matrix_from_quaternion(pose[3:]).T
    moved = pose.copy()
    for _ in range(2):
        for x, y, z, d in planes.tolist():
            gap = float(((points + moved[:3]) @ np.array([x, y, z])).min() + d)
            moved[:3] -= min(gap, 0.0) * np.array([x, y, z])
    return moved
