"""Motion: where a scenario's objects and camera are at each frame, and what they meet on the way.

Where nothing can be met every pose is a formula of time. Otherwise the objects are stepped, frame by frame; those that
follow paths have the same poses as by the formula, to the bit, as long as nothing is in their way.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dynamics import Body, Mover, Shape, Simulation, SteppedSimulation, Still, UniformMovementRandomBounce, cover
from dynamics import Move as Teleport
from dynamics.clocks import exact
from dynamics.free_paths import all_free
from dynamics.obstacles import Obstacles, placed
from dynamics.rotation import quaternion
from tiscene.camera import Camera
from tiscene.edits import Life
from tiscene.errors import ScenarioError
from tiscene.scenario import Scenario
from tiscene.scene.description import SceneDescription
from tiscene.scene.obstacles import MeshTrees, ObstacleTree

Array = NDArray[np.float64]
WALLS = ("left", "right", "bottom", "top", "near", "far")
# Poses of the frames last asked for are kept: three frames are needed for each, and the next needs two of them again.
KEPT_FRAMES = 8


@dataclass(frozen=True)
class Meeting:
    """An object of the scenario met something on the way to a frame.

    number: its row in the scenario. kind: "stage", "object" or "wall".
    other: the row of the stage's object, of the scenario's object, or of WALLS.
    """

    number: int
    kind: Literal["stage", "object", "wall"]
    other: int


class Motion:
    """The poses of a scenario's objects, then of the camera, as float64 [n, 7]: position, m, and unit quaternion."""

    def __init__(
        self,
        scenario: Scenario,
        stage: SceneDescription,
        camera: Camera,
        fps: float,
        aspect: float,
        surface: Callable[[int], Array],
        before: tuple[Motion, int] | None = None,
    ) -> None:
        """surface: an object's triangles [m, 3, 3] in its own axes, by its row. aspect: width / height of the view.

        before: the motion that this one replaces, and the first frame from which on the scenario has other edits.
        Raises ScenarioError if the timings or dynamics cannot work. Nothing is computed before a frame is asked for.
        """
        self._scenario = scenario
        self._stage = stage
        self._camera = camera
        self._aspect = aspect
        self._surface = surface
        self._fps = exact(fps)
        self._lives = scenario.lives()
        self._count = len(self._lives)
        # What bounces has no formula: for this simulation it stands, which also tells where it starts.
        bodies = [self._body(life, bounces=False) for life in self._lives]
        if camera.dynamic is not None:
            bodies.append(Body(camera.dynamic, camera.position, camera.rotation, name=camera.name, timed=False))
        try:
            self._formulas = Simulation(bodies, scenario.timings)
        except TypeError as error:
            raise ScenarioError(str(error)) from error
        self._before = before
        self._shapes: dict[tuple[object, ...], Shape | None] = before[0]._shapes if before else {}
        self._obstacles: tuple[Obstacles, NDArray[np.int64]] | None = before[0]._obstacles if before else None
        self._stepped: SteppedSimulation | None = None
        self._free_until = 0  # before this frame nothing could be met
        self._is_stepped: bool | None = None
        self._poses_by_frame: dict[int, Array] = {}

    def poses(self, frame: int) -> Array:
        """Before frame 0 everything is where it starts."""
        poses = self._poses_by_frame.get(frame)
        if poses is None:
            poses = self._formulas.poses(Fraction(frame) / self._fps)
            stepped = self._stepping(frame)
            if stepped is not None:
                poses[: self._count] = stepped.frame(max(frame, 0)).poses
            while len(self._poses_by_frame) >= KEPT_FRAMES:
                self._poses_by_frame.pop(next(iter(self._poses_by_frame)))
            self._poses_by_frame[frame] = poses
        return poses

    def arrivals(self, frame: int) -> Array:
        """The poses at a frame before the edits of that frame: as they were planned when the frame before was made."""
        poses = self.poses(frame)
        stepped = self._stepping(frame)
        if stepped is not None:
            poses = poses.copy()
            poses[: self._count] = stepped.frame(max(frame, 0)).arrivals
        return poses

    def blocked(self, frame: int) -> list[bool]:
        """Of every object of the scenario, whether something kept it from its way since the frame before."""
        stepped = self._stepping(frame)
        return [False] * self._count if stepped is None else stepped.frame(frame).blocked.tolist()

    def meetings(self, frame: int) -> list[Meeting]:
        """What the scenario's objects met since the frame before."""
        stepped = self._stepping(frame)
        result = []
        for contact in () if stepped is None else stepped.frame(frame).contacts:
            if contact.kind == "obstacle":
                instance = self._stage.instances[self._placed_obstacles()[1][contact.other]]
                result.append(Meeting(contact.mover, "stage", instance.object))
            elif contact.kind == "mover":
                result.append(Meeting(contact.mover, "object", contact.other))
            else:
                result.append(Meeting(contact.mover, "wall", contact.other))
        return result

    def _stepping(self, frame: int) -> SteppedSimulation | None:
        """The simulation of what collides at a frame, None if nothing can."""
        if self._is_stepped is None:
            self._is_stepped = self._must_step()
            self._before = None
        return None if frame < self._free_until else self._stepped

    def _must_step(self) -> bool:
        dynamics = [life.planned.dynamic for life in self._lives]
        moving = [not isinstance(dynamic, Still | None) for dynamic in dynamics]
        bouncing = any(isinstance(dynamic, UniformMovementRandomBounce) for dynamic in dynamics)
        put_elsewhere = any(life.moves for life in self._lives)
        walled = self._scenario.frustum is not None
        solid = any(life.planned.collide and (moves or walled) for life, moves in zip(self._lives, moving, strict=True))
        if not bouncing and not solid and not put_elsewhere:
            return False
        movers = [self._mover(row, life) for row, life in enumerate(self._lives)]
        obstacles, _ = self._placed_obstacles()
        if not bouncing and not put_elsewhere and all_free(movers, obstacles, walled):
            return False
        self._stepped = SteppedSimulation(
            movers,
            self._scenario.timings,
            fps=self._fps,
            obstacles=lambda: obstacles,
            walls=self._walls if walled else None,
        )
        if self._before is not None:
            earlier, frame = self._before
            self._free_until = frame if earlier._stepping(frame) is None else earlier._free_until
            self._stepped.continue_from(earlier._stepping(frame), frame)
        return True

    def _mover(self, row: int, life: Life) -> Mover:
        moves = []
        for move in life.moves:
            w, x, y, z = quaternion(move.rotation).tolist()
            moves.append(Teleport(move.frame, move.position, (w, x, y, z)))
        return Mover(
            self._body(life, bounces=True),
            self._shape(row, life) if life.planned.collide else None,
            life.planned.frustum_limited,
            life.planned.first_frame,
            life.last_frame,
            tuple(moves),
        )

    def _placed_obstacles(self) -> tuple[Obstacles, NDArray[np.int64]]:
        """The stage as obstacles, and the row of the stage's instance for each of theirs."""
        if self._obstacles is None:
            trees = MeshTrees.built(self._stage.meshes)
            tree = ObstacleTree(trees, self._stage.instances)
            self._obstacles = placed(trees.bvh, trees.wide, tree.roots, tree.matrices, tree.root), tree.rows
        return self._obstacles

    def _body(self, life: Life, bounces: bool) -> Body:
        each = life.planned
        dynamic = each.dynamic or Still()
        if isinstance(dynamic, UniformMovementRandomBounce) and not bounces:
            dynamic = Still()
        birth = Fraction(each.first_frame) / self._fps
        return Body(dynamic, each.position, each.rotation, name=each.id, birth=birth, timed=life.spawned is None)

    def _shape(self, row: int, life: Life) -> Shape | None:
        """The proxy spheres of an object; None without any surface. Objects of one template and scale share them."""
        key = (life.planned.template, life.planned.scale)
        if key not in self._shapes:
            surface = self._surface(row)
            self._shapes[key] = cover(surface) if len(surface) else None
        return self._shapes[key]

    def _walls(self, time: Fraction) -> Array:
        """The frustum's planes at a time, s."""
        frustum = self._scenario.frustum
        far = None if frustum is None or frustum.far == -1.0 else frustum.far
        camera = self._camera
        if camera.dynamic is not None:
            x, y, z, a, b, c, d = self._formulas.poses(time)[-1].tolist()
            camera = camera.posed((x, y, z), (a, b, c, d))
        return camera.frustum_planes(self._aspect, far)
