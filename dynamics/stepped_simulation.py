# SPDX-License-Identifier: Apache-2.0
"""SteppedSimulation: bodies that meet obstacles, walls and each other, one frame after another."""

from __future__ import annotations

import bisect
import hashlib
import math
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from numbers import Rational

import numpy as np
from numpy.typing import NDArray

from dynamics import argument_checks
from dynamics import body_layout as at
from dynamics.clocks import exact
from dynamics.closed_form import Still
from dynamics.colliding_bodies import Array, CollisionState, Mover
from dynamics.errors import ArgumentError
from dynamics.obstacles import Obstacles, nothing
from dynamics.path_poses import Paths
from dynamics.random_bounce import UniformMovementRandomBounce
from dynamics.step_arrays import StepDevice
from dynamics.timings import AllTogether, Timing

SUBSTEP = Fraction(1, 200)  # s, at most: how long movers do not look at each other
CACHED_FRAMES = 16  # results kept for asking again
CHECKPOINT = 16  # frames between checkpoints, until there are too many
MAX_CHECKPOINTS = 1024
RECENT_FRAMES = 4

State = tuple[Array, NDArray[np.int32]]  # the columns of all bodies


class SteppedSimulation:
    """Moves bodies that collide. Taichi must run when frames are asked for.

    Frame k is a pure function of what the simulation was made with: the same bits in any order of asking, for any
    number of threads. A frame that was not reached yet costs the frames since the last checkpoint before it. Movers
    that never come near each other have the same poses as without each other, to the bit.
    """

    def __init__(
        self,
        movers: Sequence[Mover],
        timings: Timing | None = None,
        *,
        fps: float | Rational,
        obstacles: Callable[[int], Obstacles] | None = None,
        walls: Callable[[Fraction], Array | None] | None = None,
    ) -> None:
        """timings: default AllTogether(0).

        obstacles: what is in the way from a frame to the next, one object as long as nothing changes. None: nothing.

        walls: planes [6, 4] at a time, s: inside where n . x + d >= 0, n a unit vector; None while there are none.
        Raises ValueError if the timings cannot work, TypeError for a dynamic that is neither a bounce nor closed form.
        """
        self.movers = tuple(movers)
        self.timings = AllTogether(0.0) if timings is None else timings
        argument_checks.positive(fps, "fps")
        self.fps = exact(fps)
        self._walls = walls or (lambda _time: None)
        self._obstacles = obstacles or _Nothing()
        self.substeps = max(1, math.ceil(1 / (self.fps * SUBSTEP)))
        self._paths = self._made_paths()
        self._device: StepDevice | None = None
        self._reached = -1  # the frame that the device stands at
        self._checkpoints: dict[int, State] = {}
        self._recent: dict[int, State] = {}  # of the last frames, for edits of the next one
        self._interval = CHECKPOINT
        self._moments: OrderedDict[int, CollisionState] = OrderedDict()

    def _made_paths(self) -> Paths:
        return Paths([mover.body for mover in self.movers], self.timings, "movers")

    def frame(self, number: int) -> CollisionState:
        """All movers at frame `number` (0 or more), k / fps seconds after the start."""
        number = argument_checks.whole(number, "number")
        if number < 0:
            raise ArgumentError(f"number={number}: must be 0 or more")
        if number in self._moments:
            self._moments.move_to_end(number)
            return self._moments[number]
        device = self._device = self._device or StepDevice(self.movers)
        if not self._reached <= number or self._reached < 0 or number - self._reached > self._interval:
            self._go_back(device, number)
        while self._reached < number:
            moment = self._advance(device, self._reached)
            self._reached += 1
            self._keep(self._reached, self._moved(device, moment))
            self._save(device)
        return self._moments[number]

    def _go_back(self, device: StepDevice, number: int) -> None:
        """Stand at the last checkpoint before `number`, from which that frame is computed again; or where it is."""
        states = self._checkpoints | self._recent
        before = [frame for frame in states if frame < number]
        latest = max(before, default=0)
        if 0 <= self._reached < number and self._reached >= latest:
            return
        if before:
            device.restore(*self._whole(latest, states[latest]))
            self._reached = latest
        else:
            device.restore(*self._start(0))
            self._reached = 0
            self._keep(0, self._moved(device, device.moment()))
            self._save(device)

    def _whole(self, frame: int, state: State) -> State:
        """The state at a frame with the movers that were not known when it was kept."""
        bodies, integers = state
        if len(bodies) == max(1, len(self.movers)):
            return state
        all_bodies, all_integers = self._start(frame)
        all_bodies[: len(bodies)], all_integers[: len(bodies)] = bodies, integers
        return all_bodies, all_integers

    def _save(self, device: StepDevice) -> None:
        self._recent[self._reached] = device.state()
        while len(self._recent) > RECENT_FRAMES:
            del self._recent[next(iter(self._recent))]
        if self._reached % self._interval or self._reached in self._checkpoints:
            return
        self._checkpoints[self._reached] = self._recent[self._reached]
        if len(self._checkpoints) > MAX_CHECKPOINTS:
            # Every other one goes, so that memory is bounded and the distance between them grows with the stream.
            self._interval *= 2
            self._checkpoints = {k: state for k, state in self._checkpoints.items() if k % self._interval == 0}

    def _keep(self, number: int, moment: CollisionState) -> None:
        self._moments[number] = moment
        while len(self._moments) > CACHED_FRAMES:
            self._moments.popitem(last=False)

    def _moved(self, device: StepDevice, moment: CollisionState) -> CollisionState:
        """The frame that is reached, once what is moved there was moved."""
        moves = {row: _pose(*last) for row, last in self._last_moves(self._reached, exactly=True)}
        if not moves:
            return moment
        device.put(moves)
        poses = moment.poses.copy()
        poses[list(moves)] = list(moves.values())
        return replace(moment, poses=poses)

    def _last_moves(self, frame: int, exactly: bool) -> Iterator[tuple[int, tuple[Sequence[float], Sequence[float]]]]:
        """The last move of every mover up to `frame`, or at it: row, position and rotation."""
        for row, mover in enumerate(self.movers):
            done = bisect.bisect_right(mover.moves, frame, key=lambda move: move.frame)
            if done and not (exactly and mover.moves[done - 1].frame < frame):
                yield row, (mover.moves[done - 1].position, mover.moves[done - 1].rotation)

    def _advance(self, device: StepDevice, frame: int) -> CollisionState:
        """From frame `frame` to the next."""
        times = [Fraction(frame * self.substeps + part, self.substeps) / self.fps for part in range(self.substeps + 1)]
        targets = self._path(times, frame)
        clocks = [self._paths.seconds(time) for time in times]
        obstacles = self._obstacles(frame)
        if frame > 0 and self._obstacles(frame - 1) is not obstacles:
            device.forget_obstacles()
        device.begin_frame(targets[0], [self._there(mover, frame) for mover in self.movers])
        for part in range(self.substeps):
            active = clocks[part + 1] - clocks[part]
            length = float(times[part + 1] - times[part])
            device.substep(targets[part + 1], active, self._walls(times[part + 1]), length, obstacles)
        return device.moment(float(1 / self.fps))

    def _path(self, times: Sequence[Fraction], frame: int) -> Array:
        """Where the paths have the movers, whatever is in the way: float64 [times, n, 7].

        frame: moves after it are not known yet.
        """
        poses = self._paths.poses(times)
        for row, last in self._last_moves(frame, exactly=False):
            if isinstance(self.movers[row].body.dynamic, Still):
                poses[:, row] = _pose(*last)
        return poses

    def amend(self, movers: Sequence[Mover], frame: int) -> None:
        """Go on with others from a frame on; before it everything stays as it was computed.

        movers: as before, but for moves and last frames from `frame` on; new ones follow that are not there before it.
        """
        grown = len(movers) > len(self.movers)
        self.movers = tuple(movers)
        if grown:
            self._paths = self._made_paths()
            self._device = None
        for known in (self._moments, self._checkpoints, self._recent):
            for number in [each for each in known if each >= frame or (grown and known is self._moments)]:
                del known[number]
        if grown or self._reached >= frame:
            self._reached = -1

    def start_at(self, frame: int) -> None:
        """Have nothing computed before a frame, up to which all paths were free and nothing bounced."""
        self._reached = -1
        for known in (self._moments, self._checkpoints, self._recent):
            known.clear()
        if frame > 0:
            self._checkpoints[frame - 1] = self._start(frame - 1)

    @staticmethod
    def _there(mover: Mover, frame: int) -> bool:
        return mover.first_frame <= frame and (mover.last_frame is None or frame <= mover.last_frame)

    def _start(self, frame: int) -> State:
        """The columns of bodies that met nothing before a frame; of what bounces, where it starts."""
        bodies = np.zeros((max(1, len(self.movers)), at.FLOAT_COLUMNS))
        integers = np.zeros((max(1, len(self.movers)), at.INTEGER_COLUMNS), dtype=np.int32)
        bodies[: len(self.movers), at.POSITION : at.ROTATION + 4] = self._path([Fraction(frame) / self.fps], frame)[0]
        group = 0
        for row, mover in enumerate(self.movers):
            dynamic = mover.body.dynamic
            shape = mover.shape
            integers[row, at.KIND] = at.FOLLOWS
            integers[row, at.ON_PATH] = 1
            integers[row, at.FIRST_GROUP] = group
            if shape is not None:
                integers[row, at.GROUP_COUNT] = len(shape.groups)
                bodies[row, at.RADIUS] = shape.reach
                bodies[row, at.CENTER : at.CENTER + 3] = shape.spheres[:, :3].mean(axis=0, dtype=np.float64)
                group += len(shape.groups)
            if isinstance(dynamic, UniformMovementRandomBounce):
                direction = np.array(dynamic.start_direction)
                bodies[row, at.VELOCITY : at.VELOCITY + 3] = dynamic.speed * direction / np.linalg.norm(direction)
                bodies[row, at.SPEED] = dynamic.speed
                bodies[row, at.ANGULAR_SPEED] = dynamic.angular_speed
                integers[row, at.KIND] = at.BOUNCES
                integers[row, at.SEED] = np.uint32(dynamic.seed & 0xFFFFFFFF).astype(np.int32)
                # By name, not by row: other bodies may come and go.
                name = hashlib.sha256(mover.body.name.encode()).digest()[:4]
                integers[row, at.NAME_HASH] = np.frombuffer(name, dtype="<i4")[0]
        return bodies, integers


def _pose(position: Sequence[float], rotation: Sequence[float]) -> Array:
    return np.array([*position, *rotation], dtype=np.float64)


class _Nothing:
    """No obstacles at any frame."""

    def __init__(self) -> None:
        self._made: Obstacles | None = None

    def __call__(self, _frame: int) -> Obstacles:
        self._made = self._made or nothing()
        return self._made
