# SPDX-License-Identifier: Apache-2.0
"""Trajectories: poses of a scenario's objects, cameras and lights at each frame, and the collisions of its objects.

Where no collision is possible every pose is a closed form of time. Otherwise the objects are simulated frame by frame;
objects on paths have the poses of the closed form, to the bit, as long as nothing is in their way.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dynamics import (
    Body,
    Dynamic,
    Mover,
    Shape,
    Simulation,
    SteppedSimulation,
    Still,
    Teleport,
    UniformMovementRandomBounce,
    cover,
)
from dynamics.clocks import exact
from dynamics.collision_free import all_free
from dynamics.obstacles import Obstacles
from dynamics.rotation import quaternion
from tiscene.errors import ScenarioError
from tiscene.scenario.edits import Despawn, Edit, EditLog, Move, ObjectHistory, SetFrustumWalls, Spawn
from tiscene.scenario.scenario import Scenario
from tiscene.scene.bvh.obstacle_tree import MeshTrees, ObstacleTree
from tiscene.scene.camera import Camera
from tiscene.scene.description import Instance, SceneDescription

Array = NDArray[np.float64]
WALLS = ("left", "right", "bottom", "top", "near", "far")
# A state needs the poses of three frames, two of which the next state needs again.
KEPT_FRAMES = 8


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
        surface: returns an object's collision surface [m, 3, 3] by its row.
        trees: returns the bounding volume hierarchies of the stage's meshes.
        instances: returns the stage's instances at a frame, then its invisible colliders, and which are present.
    """

    stage: SceneDescription
    cameras: Sequence[Camera]
    fps: float
    aspect: float
    lights: Sequence[tuple[Dynamic | None, tuple[float, ...], tuple[float, ...]]]
    surface: Callable[[int], Array]
    trees: Callable[[], MeshTrees]
    instances: Callable[[int], tuple[Sequence[Instance], Sequence[bool]]]


class Trajectories:
    """Poses of a scenario's objects, cameras and lights: float64 [n, 7], position (m) and unit quaternion.

    Nothing is computed before a frame is requested.

    Args:
        scenario: the scenario.
        log: its edit log; `amend` takes further edits.
        setting: what the objects move in.

    Attributes:
        closed_form: poses without collisions.
        stepped: the simulation of collisions; None before it is needed.

    Raises:
        ScenarioError: timings or trajectories cannot work.
    """

    def __init__(self, scenario: Scenario, log: EditLog, setting: TrajectoryContext) -> None:
        self._scenario = scenario
        self._log = log
        self._setting = setting
        self._fps = exact(setting.fps)
        self.closed_form = self._simulation()
        # Frames at which edits change the stage as an obstacle.
        moved = [move.frame for life in log.stage.values() for move in life.moves]
        gone = [life.despawned for life in log.stage.values() if life.despawned is not None]
        self._changes = sorted({*moved, *gone})
        self._shapes: dict[tuple[object, ...], Shape | None] = {}
        # By the number of changes so far.
        self._obstacles: dict[int, Obstacles] = {}
        self._obstacle_rows: NDArray[np.int64] = np.zeros(0, np.int64)
        self._movers: list[Mover] = []
        self.stepped: SteppedSimulation | None = None
        self._free_until = 0  # before this frame no collision was possible
        self._is_stepped: bool | None = None
        self._poses_by_frame: dict[int, Array] = {}

    def amend(self, edit: Edit) -> None:
        """Take one more edit of the log. Frames before the edit keep their poses and are not computed again."""
        spawned = isinstance(edit, Spawn)
        if spawned:
            self.closed_form = self._simulation()
        for frame in [each for each in self._poses_by_frame if spawned or each >= edit.frame]:
            del self._poses_by_frame[frame]
        row = None
        if not isinstance(edit, SetFrustumWalls):
            row = self._log.row(edit.object.id if isinstance(edit, Spawn) else edit.id)
        if isinstance(edit, Move | Despawn) and row is None:
            # Obstacles before the edit stay valid.
            kept = bisect.bisect_left(self._changes, edit.frame)
            self._obstacles = {epoch: each for epoch, each in self._obstacles.items() if epoch <= kept}
            if edit.frame not in self._changes[kept : kept + 1]:
                self._changes.insert(kept, edit.frame)
        if self.stepped is None:
            if self._is_stepped is not None:
                self._free_until = edit.frame
            else:
                self._free_until = min(self._free_until, edit.frame)
            self._is_stepped = None
            return
        if row is not None:
            self._movers[row : row + 1] = [self._mover(row)]
        self.stepped.amend(self._movers, edit.frame)
        if edit.frame < self._free_until:
            self._free_until = edit.frame
            self.stepped.start_at(edit.frame)

    def poses(self, frame: int) -> Array:
        """Return all poses at a frame. Before frame 0 everything stands at its start."""
        poses = self._poses_by_frame.get(frame)
        if poses is None:
            poses = self.closed_form.poses(Fraction(frame) / self._fps)
            stepped = self._stepping(frame)
            if stepped is not None:
                poses[: len(self._log.lives)] = stepped.frame(max(frame, 0)).poses
            while len(self._poses_by_frame) >= KEPT_FRAMES:
                self._poses_by_frame.pop(next(iter(self._poses_by_frame)))
            self._poses_by_frame[frame] = poses
        return poses

    def between(self, frame: int, shift: Fraction) -> Array:
        """Return the poses at `frame + shift`, as planned when `frame` was made.

        Objects in collision are interpolated between two frames: position linearly, rotation by slerp.

        Args:
            frame: the frame.
            shift: offset in frames, -1..1.
        """
        if not shift:
            return self.poses(frame)
        time = frame + shift
        poses = self.closed_form.poses(time / self._fps)
        stepped = self._stepping(frame)
        start = math.floor(time)
        if stepped is None or start < 0:
            return poses
        rows = slice(len(self._log.lives))
        before, after = stepped.frame(start).poses, stepped.frame(start + 1).arrivals
        strayed = np.zeros(len(before), np.bool_)
        for number, found in ((start, before), (start + 1, after)):
            strayed |= (found != self.closed_form.poses(Fraction(number) / self._fps)[rows]).any(axis=1)
        poses[rows][strayed] = _between(before[strayed], after[strayed], float(time - start))
        return poses

    def arrivals(self, frame: int) -> Array:
        """Return the poses at a frame before the edits of that frame, as planned when the frame before was made."""
        poses = self.poses(frame)
        stepped = self._stepping(frame)
        if stepped is not None:
            poses = poses.copy()
            poses[: len(self._log.lives)] = stepped.frame(max(frame, 0)).arrivals
        return poses

    def blocked(self, frame: int) -> list[bool]:
        """Return for every object of the scenario whether an obstacle has held it back since the frame before."""
        stepped = self._stepping(frame)
        return [False] * len(self._log.lives) if stepped is None else stepped.frame(frame).blocked.tolist()

    def collisions(self, frame: int) -> list[Collision]:
        """Return the collisions of the scenario's objects since the frame before."""
        stepped = self._stepping(frame)
        result = []
        for contact in () if stepped is None else stepped.frame(frame).contacts:
            if contact.kind == "obstacle":
                stage, row = self._setting.stage, int(self._obstacle_rows[contact.other])
                hidden = row - len(stage.instances)
                owner = stage.colliders[hidden].object if hidden >= 0 else stage.instances[row].object
                if owner < 0:
                    result.append(Collision(contact.mover, "collider", hidden))
                else:
                    result.append(Collision(contact.mover, "stage", owner))
            elif contact.kind == "mover":
                result.append(Collision(contact.mover, "object", contact.other))
            else:
                result.append(Collision(contact.mover, "wall", contact.other))
        return result

    def _stepping(self, frame: int) -> SteppedSimulation | None:
        """Return the simulation of collisions at a frame; None if no collision is possible."""
        if self._is_stepped is None:
            self._is_stepped = self._must_step()
        return None if frame < self._free_until else self.stepped

    def _must_step(self) -> bool:
        lives = self._log.lives
        dynamics = [life.spec.dynamic for life in lives]
        moving = [not isinstance(dynamic, Still | None) for dynamic in dynamics]
        bouncing = any(isinstance(dynamic, UniformMovementRandomBounce) for dynamic in dynamics)
        teleported = any(life.moves for life in lives) or bool(self._changes)
        walled = any(each is not None for each in (self._scenario.frustum, *(e.frustum for e in self._log.enclosures)))
        solid = any(life.spec.collide and (moves or walled) for life, moves in zip(lives, moving, strict=True))
        if not bouncing and not solid and not any(life.moves for life in lives):
            return False
        self._movers = [self._mover(row) for row in range(len(lives))]
        if not bouncing and not teleported and all_free(self._movers, self._obstacles_at(0), walled):
            return False
        self.stepped = SteppedSimulation(
            self._movers, self._scenario.timings, fps=self._fps, obstacles=self._obstacles_at, walls=self.walls
        )
        self.stepped.start_at(self._free_until)
        return True

    def _mover(self, row: int) -> Mover:
        life = self._log.lives[row]
        moves = self._movers[row].moves if row < len(self._movers) else ()
        if moves and (len(moves) > len(life.moves) or moves[-1].frame > life.moves[len(moves) - 1].frame):
            moves = ()  # an edit was inserted before the others
        return Mover(
            self._body(life, bounces=True),
            self._shape(row, life) if life.spec.collide else None,
            life.spec.frustum_limited,
            life.spec.first_frame,
            life.last_frame,
            (*moves, *(_teleport(move) for move in life.moves[len(moves) :])),
        )

    def _simulation(self) -> Simulation:
        """Return the closed forms of all bodies. A bouncing body has none: it stands at its start here."""
        bodies = [self._body(life, bounces=False) for life in self._log.lives]
        for camera in self._setting.cameras:
            dynamic = camera.dynamic or Still()
            bodies.append(Body(dynamic, camera.position, camera.rotation, name=camera.name, timed=False))
        for motion, position, rotation in self._setting.lights:
            bodies.append(Body(motion or Still(), position, rotation, name="light", timed=False))  # type: ignore[arg-type]
        try:
            return Simulation(bodies, self._scenario.timings)
        except TypeError as error:
            raise ScenarioError(str(error)) from error

    def _obstacles_at(self, frame: int) -> Obstacles:
        """Return the stage as obstacles, from a frame to the next."""
        epoch = bisect.bisect_right(self._changes, frame)
        if epoch not in self._obstacles:
            trees = self._setting.trees()
            instances, there = self._setting.instances(frame)
            tree = ObstacleTree(trees, instances, there)
            self._obstacles[epoch] = Obstacles.from_trees(
                trees.bvh, trees.is_bvh8, tree.roots, tree.matrices, tree.root
            )
            self._obstacle_rows = tree.rows
        return self._obstacles[epoch]

    def _body(self, life: ObjectHistory, bounces: bool) -> Body:
        each = life.spec
        dynamic = each.dynamic or Still()
        if isinstance(dynamic, UniformMovementRandomBounce) and not bounces:
            dynamic = Still()
        birth = Fraction(each.first_frame) / self._fps
        return Body(dynamic, each.position, each.rotation, name=each.id, birth=birth, timed=life.spawned is None)

    def _shape(self, row: int, life: ObjectHistory) -> Shape | None:
        """Return the proxy spheres of an object, shared by template and scale; None without a surface."""
        key = (life.spec.template, life.spec.scale)
        if key not in self._shapes:
            surface = self._setting.surface(row)
            self._shapes[key] = cover(surface) if len(surface) else None
        return self._shapes[key]

    def walls(self, time: Fraction) -> Array | None:
        """Return the planes that bound objects up to a time (s); None without walls."""
        frustum, camera, aspect = self._scenario.frustum, self._setting.cameras[0], self._setting.aspect
        made = bisect.bisect_left(self._log.enclosures, math.ceil(time * self._fps), key=lambda edit: edit.frame)
        if made:
            last = self._log.enclosures[made - 1]
            frustum, camera, aspect = last.frustum, last.camera, last.aspect
        if frustum is None:
            return None
        if camera.dynamic is not None:
            x, y, z, a, b, c, d = self.closed_form.poses(time)[len(self._log.lives)].tolist()
            camera = camera.with_pose((x, y, z), (a, b, c, d))
        return camera.frustum_planes(aspect, None if frustum.far == -1.0 else frustum.far)


def _between(before: Array, after: Array, part: float) -> Array:
    """Interpolate poses [n, 7] by 0..1: position linearly, rotation by slerp."""
    poses = before + part * (after - before)
    cosine = np.einsum("ni,ni->n", before[:, 3:], after[:, 3:])[:, None]
    angle = np.arccos(np.clip(np.abs(cosine), 0.0, 1.0))
    turned = np.sin((1.0 - part) * angle) * before[:, 3:] + np.copysign(np.sin(part * angle), cosine) * after[:, 3:]
    poses[:, 3:] = np.where(angle > 1e-6, turned, before[:, 3:])
    poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    return poses


def _teleport(move: Move) -> Teleport:
    w, x, y, z = quaternion(move.rotation).tolist()
    return Teleport(move.frame, move.position, (w, x, y, z))
