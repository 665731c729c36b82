# SPDX-License-Identifier: Apache-2.0
"""Trajectories: poses of a scenario's objects, cameras and lights at each frame, and the collisions of its objects.

Where no collision is possible every pose is a closed form of time. Otherwise the objects are simulated frame by frame;
objects on paths have the poses of the closed form, to the bit, as long as nothing is in their way.
"""

from __future__ import annotations

import bisect
import functools
import math
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dynamics import Body, CollisionState, Dynamic, Simulation, SteppedSimulation, Still
from dynamics.clocks import exact
from dynamics.dynamic import ClosedForm
from dynamics.lru_cache import LRUCache
from dynamics.obstacles import Obstacles
from dynamics.timings import AssignedWindows
from tiscene.errors import ScenarioError
from tiscene.scenario.edits import Despawn, Edit, EditLog, Move
from tiscene.scenario.objects import Object, path_of
from tiscene.scenario.scenario import Scenario
from tiscene.scene.bvh.blas import TreeRoom
from tiscene.scene.bvh.obstacle_tree import MeshTrees, ObstacleTree
from tiscene.scene.camera import Camera
from tiscene.scene.description import Instance, SceneDescription
from tiscene.scene.walking import STILL, Axes
from tiscene.world.collision_onset import CollisionOnset
from tiscene.world.object_movers import ObjectMovers
from tiscene.world.physics.rigid_body_simulation import PhysicsFrame

Array = NDArray[np.float64]
WALLS = ("left", "right", "bottom", "top", "near", "far")
# A state needs the poses of three frames, two of which the next state needs again.
KEPT_FRAMES = 8
KEPT_OBSTACLES = 8  # states of the stage as an obstacle, of which a frame needs two
CAMERA_SAMPLES = 256  # of a camera's trajectory, to see along which axes it moves
OPEN_ENDED = 10.0  # s that are looked at of a trajectory written in Python, which has no known end


@dataclass(frozen=True)
class Collision:
    """A collision of an object of the scenario since the frame before.

    Attributes:
        number: row of the object in the scenario.
        kind: what it collided with.
        other: row of the stage's object, of the stage's collider without an object, of the scenario's object, or of
            WALLS, by `kind`.
    """

    number: int
    kind: Literal["stage", "collider", "object", "wall"]
    other: int


@dataclass(frozen=True)
class TrajectoryContext:
    """What the objects of a scenario move in.

    Attributes:
        stage: the stage.
        cameras: the cameras; the frustum encloses the view of the first.
        fps: frame k shows time k / fps.
        aspect: width / height of the first camera's view.
        lights: (trajectory, position, quaternion) of lights with a LightMotion.
        surface: returns an object's collision surface [m, 3, 3].
        trees: returns the bounding volume hierarchies of the stage's meshes.
        instances: returns the stage's instances at a frame, then its invisible colliders, and which are present.
    """

    stage: SceneDescription
    cameras: Sequence[Camera]
    fps: float
    aspect: float
    lights: Sequence[tuple[Dynamic | None, tuple[float, ...], tuple[float, ...]]]
    surface: Callable[[Object], Array]
    trees: Callable[[], MeshTrees]
    instances: Callable[[int], tuple[Sequence[Instance], Sequence[bool]]]


class Trajectories:
    """Poses of a scenario's objects, cameras and lights: float64 [n, 7], position (m) and unit quaternion.

    Nothing is computed before a frame is requested. Methods that take `rows` return the poses of these objects, given
    as ascending rows of `EditLog.histories`. A frame takes time by their number, not by that of all objects that ever
    existed.

    Args:
        scenario: the scenario.
        log: its edit log; `amend` takes further edits.
        setting: what the objects move in.

    Attributes:
        closed_form: poses without collisions of the objects that the scenario has without edits, then of the cameras,
            then of the lights.
        stepped: the simulation of collisions; None before it is needed.

    Raises:
        ScenarioError: timings or trajectories cannot work.
    """

    def __init__(self, scenario: Scenario, log: EditLog, setting: TrajectoryContext) -> None:
        self._scenario = scenario
        self._log = log
        self._setting = setting
        self._fps = exact(setting.fps)
        self._movers = ObjectMovers(log, self._fps, setting.surface)
        self._unspawned = len(scenario.objects)
        self.closed_form = self._simulation()
        self._spawned: tuple[tuple[int, ...], Simulation] = ((), Simulation(()))
        self._closed_form_poses: LRUCache[Fraction, Array] = LRUCache(KEPT_FRAMES)
        self._spawned_poses: LRUCache[tuple[Fraction, tuple[int, ...]], Array] = LRUCache(KEPT_FRAMES)
        # Frames at which edits change the stage as an obstacle.
        edited = log.stage_histories.values()
        moved = [move.frame for history in edited for move in history.moves]
        removed = [history.despawned for history in edited if history.despawned is not None]
        self._changes = sorted({*moved, *removed})
        # By the number of changes so far.
        self._obstacles: LRUCache[int, Obstacles] = LRUCache(KEPT_OBSTACLES)
        self._free_rooms: list[TreeRoom] = []  # of the trees of obstacles that are no longer used
        self._obstacle_rows: NDArray[np.int64] = np.zeros(0, np.int64)
        self_ = weakref.proxy(self)  # a cycle would wait for the cyclic collector
        self._onset = CollisionOnset(
            log, self._movers, lambda: self_._obstacles_at(0), walled=scenario.frustum is not None
        )
        self.stepped: SteppedSimulation | None = None
        self._stepped_from = 0

    @property
    def movers(self) -> ObjectMovers:
        """The objects as bodies and movers."""
        return self._movers

    def close(self) -> None:
        """Drop all simulations, and all that is on the device. What is asked later is simulated again."""
        self.stepped = None
        meshes = self._setting.stage.meshes
        self.use_trees(lambda: MeshTrees.built(meshes))

    def use_trees(self, trees: Callable[[], MeshTrees]) -> None:
        """Drop what is on the device; `trees` returns the trees of the stage's meshes from now on."""
        self._free_rooms = []
        self._obstacles.drop(lambda _changes: True)
        self._setting = replace(self._setting, trees=functools.cache(trees))

    def amend(self, edit: Edit) -> None:
        """Take one more edit of the log. Frames before the edit keep their poses and are not computed again."""
        self._onset.amend(edit)
        self._movers.amend(edit)
        if isinstance(edit, Move | Despawn) and self._log.row(edit.id) is None:
            # Obstacles before the edit stay valid.
            kept = bisect.bisect_left(self._changes, edit.frame)
            self._obstacles.drop(lambda epoch: epoch > kept)
            if edit.frame not in self._changes[kept : kept + 1]:
                self._changes.insert(kept, edit.frame)
        if self.stepped is not None:
            self.stepped.amend(self._movers, edit.frame)

    def poses(self, frame: int, rows: Sequence[int]) -> Array:
        """Return the poses of objects at a frame. Before frame 0 everything stands at its start."""
        return self._at(frame, tuple(rows), "poses")

    def arrivals(self, frame: int, rows: Sequence[int]) -> Array:
        """Return the poses of objects at a frame before its edits, as planned when the frame before was made."""
        return self._at(frame, tuple(rows), "arrivals")

    def _at(self, frame: int, rows: tuple[int, ...], kind: str) -> Array:
        """Return the poses at a frame; kind: "poses" or "arrivals", attributes of a simulated frame."""
        poses = self._closed_form(Fraction(frame), rows)
        stepped = self._stepping(frame)
        if stepped is not None:
            replace_rows(poses, rows, stepped.frame(max(frame, 0)), kind)
        return poses

    def between(self, frame: int, shift: Fraction, rows: Sequence[int]) -> Array:
        """Return the poses of objects at `frame + shift`, as planned when `frame` was made.

        Objects in collision are interpolated between two frames: position linearly, rotation by slerp.

        Args:
            frame: the frame.
            shift: offset in frames, -1..1.
            rows: the objects.
        """
        if not shift:
            return self.poses(frame, rows)
        if shift == 1:
            return self.arrivals(frame + 1, rows)
        rows, time = tuple(rows), frame + shift
        poses = self._closed_form(time, rows)
        stepped = self._stepping(frame)
        start = math.floor(time)
        if stepped is None or start < 0:
            return poses
        strayed = np.zeros(len(rows), np.bool_)
        ends = []
        for number, name in ((start, "poses"), (start + 1, "arrivals")):
            path = self._closed_form(Fraction(number), rows)
            ends.append(replace_rows(path.copy(), rows, stepped.frame(number), name))
            strayed |= (ends[-1] != path).any(axis=1)
        before, after = ends
        poses[strayed] = between_poses(before[strayed], after[strayed], float(time - start))
        return poses

    def camera_poses(self, frame: Fraction | int) -> Array:
        """Return the poses of all cameras at a frame, or at a time between two frames."""
        first = self._unspawned
        return self._scenario_poses(Fraction(frame))[first : first + len(self._setting.cameras)]

    @functools.cached_property
    def camera_axes(self) -> list[Axes]:
        """For each camera along which axes its trajectory moves it."""
        first = self._unspawned
        return [_axes_of(body) for body in self.closed_form.bodies[first : first + len(self._setting.cameras)]]

    def light_poses(self, frame: Fraction | int) -> Array:
        """Return the poses of all lights with motions at a frame, or at a time between two frames."""
        return self._scenario_poses(Fraction(frame))[self._unspawned + len(self._setting.cameras) :]

    def blocked(self, frame: int, rows: Sequence[int]) -> list[bool]:
        """Return for each object whether an obstacle has held it back since the frame before."""
        stepped = self._stepping(frame)
        if stepped is None:
            return [False] * len(rows)
        state = stepped.frame(frame)
        blocked = {number for number, each in zip(state.numbers, state.blocked.tolist(), strict=True) if each}
        return [row in blocked for row in rows]

    def collisions(self, frame: int) -> list[Collision]:
        """Return the collisions of the scenario's objects since the frame before."""
        stepped = self._stepping(frame)
        result = []
        for contact in () if stepped is None else stepped.frame(frame).contacts:
            if contact.kind == "obstacle":
                result.append(self.stage_collision(contact.mover, int(self._obstacle_rows[contact.other])))
            elif contact.kind == "mover":
                result.append(Collision(contact.mover, "object", contact.other))
            else:
                result.append(Collision(contact.mover, "wall", contact.other))
        return result

    def stage_collision(self, number: int, row: int) -> Collision:
        """Return a collision with a row of the stage's instances and colliders."""
        stage = self._setting.stage
        hidden = row - len(stage.instances)
        owner = stage.colliders[hidden].object if hidden >= 0 else stage.instances[row].object
        return Collision(number, "collider", hidden) if owner < 0 else Collision(number, "stage", owner)

    def _stepping(self, frame: int) -> SteppedSimulation | None:
        """Return the simulation of collisions at a frame; None if no collision is possible up to it."""
        onset = self._onset.find(frame)
        if onset is None:
            return None
        if self.stepped is None or self._stepped_from != onset:
            stepped = self.stepped or self._new_stepped()
            stepped.start_at(onset)
            self._stepped_from, self.stepped = onset, stepped
        return self.stepped

    def _new_stepped(self) -> SteppedSimulation:
        unspawned = [self._log.histories[row].spec for row in range(self._unspawned)]
        timings = AssignedWindows(self._scenario.timings, [(each.id, path_of(each)) for each in unspawned])
        return SteppedSimulation(
            self._movers,
            timings,
            fps=self._fps,
            existing=self._log.around,
            obstacles=self._obstacles_at,
            walls=self.walls,
        )

    def _simulation(self) -> Simulation:
        """Return the closed forms of the objects without edits, the cameras and the lights."""
        bodies = [self._movers.body(row) for row in range(self._unspawned)]
        for camera in self._setting.cameras:
            dynamic = camera.dynamic or Still()
            bodies.append(Body(dynamic, camera.position, camera.rotation, name=camera.name, timed=False))
        for motion, position, rotation in self._setting.lights:
            bodies.append(Body(motion or Still(), position, rotation, name="light", timed=False))  # type: ignore[arg-type]
        try:
            return Simulation(bodies, self._scenario.timings)
        except TypeError as error:
            raise ScenarioError(str(error)) from error

    def _scenario_poses(self, frame: Fraction) -> Array:
        """Return the poses of `closed_form` at a time in frames."""
        return self._closed_form_poses.get(frame, lambda: self.closed_form.poses(frame / self._fps))

    def _closed_form(self, frame: Fraction, rows: tuple[int, ...]) -> Array:
        """Return new poses of objects without collisions at a time in frames."""
        count = bisect.bisect_left(rows, self._unspawned)
        poses = self._scenario_poses(frame)[list(rows[:count])]
        if count == len(rows):
            return poses
        spawned = rows[count:]
        return np.concatenate(
            [poses, self._spawned_poses.get((frame, spawned), lambda: self._poses_of_spawned(frame, spawned))]
        )

    def _poses_of_spawned(self, frame: Fraction, rows: tuple[int, ...]) -> Array:
        if self._spawned[0] != rows:
            self._movers.keep((*range(self._unspawned), *rows))
            self._spawned = rows, Simulation([self._movers.body(row) for row in rows])
        return self._spawned[1].poses(frame / self._fps)

    def _obstacles_at(self, frame: int) -> Obstacles:
        """Return the stage as obstacles, from a frame to the next."""

        def new() -> Obstacles:
            trees = self._setting.trees()
            instances, there = self._setting.instances(frame)
            room = self._free_rooms.pop() if self._free_rooms else TreeRoom()
            tree = ObstacleTree(trees, instances, there, room)
            self._obstacle_rows = tree.rows
            obstacles = Obstacles.from_trees(trees.bvh, trees.is_bvh8, tree.roots, tree.matrices, tree.root)
            weakref.finalize(obstacles, self._free_rooms.append, room).atexit = False
            return obstacles

        return self._obstacles.get(bisect.bisect_right(self._changes, frame), new)

    def walls(self, time: Fraction) -> Array | None:
        """Return the planes that bound objects up to a time (s); None without walls."""
        frustum, camera, aspect = self._scenario.frustum, self._setting.cameras[0], self._setting.aspect
        made = bisect.bisect_left(self._log.enclosures, math.ceil(time * self._fps), key=lambda edit: edit.frame)
        if made:
            last = self._log.enclosures[made - 1]
            frustum, camera, aspect = last.frustum, last.camera, last.aspect
        if frustum is None:
            return None
        camera = camera.at(float(time))
        if camera.dynamic is not None:
            x, y, z, a, b, c, d = self.closed_form.poses(time)[self._unspawned].tolist()
            camera = camera.with_pose((x, y, z), (a, b, c, d))
        return camera.frustum_planes(aspect, None if frustum.far == -1.0 else frustum.far)


def _axes_of(body: Body) -> Axes:
    """Return along which axes a body moves, in the time after which it has been wherever its trajectory takes it."""
    if isinstance(body.dynamic, Still):
        return Axes()
    end = exact(body.duration if isinstance(body.dynamic, ClosedForm) else OPEN_ENDED)
    times = [end * Fraction(i, CAMERA_SAMPLES) for i in range(CAMERA_SAMPLES + 1)]
    try:
        extent = np.ptp(Simulation([body]).poses_at(times)[:, 0, :3], axis=0)
    except Exception:  # Python that ends earlier; whoever renders that far gets its error
        return Axes(range(3))
    return Axes(np.flatnonzero(extent > STILL).tolist())


def between_poses(before: Array, after: Array, part: float) -> Array:
    """Interpolate poses [n, 7] by 0..1: position linearly, rotation by slerp."""
    poses = before + part * (after - before)
    cosine = np.einsum("ni,ni->n", before[:, 3:], after[:, 3:])[:, None]
    angle = np.arccos(np.clip(np.abs(cosine), 0.0, 1.0))
    turned = np.sin((1.0 - part) * angle) * before[:, 3:] + np.copysign(np.sin(part * angle), cosine) * after[:, 3:]
    poses[:, 3:] = np.where(angle > 1e-6, turned, before[:, 3:])
    poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    return poses


def replace_rows(poses: Array, rows: tuple[int, ...], state: CollisionState | PhysicsFrame, kind: str) -> Array:
    """Replace poses of objects, in place, by the `kind` of poses that are simulated; not all of them may be."""
    simulated: Array = getattr(state, kind)
    if rows == state.numbers:
        poses[:] = simulated
    else:
        _, into, source = np.intersect1d(rows, state.numbers, assume_unique=True, return_indices=True)
        poses[into] = simulated[source]
    return poses
