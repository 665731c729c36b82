# SPDX-License-Identifier: Apache-2.0
"""SteppedSimulation: bodies that collide with obstacles, walls and each other, simulated frame by frame.

Every frame is advanced in substeps of equal length by the kernel of `dynamics.step_kernel`. Checkpoints of the state
let any earlier frame be recomputed. Only movers that exist around a frame have a row in its arrays: however many movers
come and go, a frame costs no more than those that exist at the same time.
"""

from __future__ import annotations

import bisect
import functools
import hashlib
import math
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from numbers import Rational
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynamics import argument_checks
from dynamics import body_layout as at
from dynamics.checkpoints import Checkpoints
from dynamics.clocks import exact
from dynamics.closed_form import Still
from dynamics.colliding_bodies import Array, CollisionState, Mover
from dynamics.errors import ArgumentError
from dynamics.obstacles import Obstacles
from dynamics.path_poses import Paths
from dynamics.random_bounce import UniformMovementRandomBounce
from dynamics.step_arrays import StepArrays
from dynamics.timings import AllTogether, AssignedWindows, Timing
from dynamics.whole_changes import WholeChanges, as_a_whole

SUBSTEP = Fraction(1, 200)  # s: longest substep; movers see each other's positions at its start
CACHED_FRAMES = 16  # results kept for repeated requests
CHECKPOINT = 16  # initial number of frames between checkpoints
MAX_CHECKPOINTS = 1024
RECENT_FRAMES = 4  # latest states kept besides checkpoints, for edits of the next frame


class _State(NamedTuple):
    """The movers of a frame: their numbers, float columns and integer columns, a row each."""

    numbers: tuple[int, ...]
    bodies: Array
    integers: NDArray[np.int32]


class SteppedSimulation(WholeChanges):
    """A simulation of bodies that collide.

    Frame k is a pure function of the arguments: the same bits in any order of requests and for any number of threads.
    Movers that never come near each other have the same poses as without each other. A frame that is requested for the
    first time costs the frames since the last checkpoint before it. Taichi must be running when frames are requested.

    Attributes:
        movers: The movers.
        timings: When each body's clock runs.
        fps: Frames per second, exactly.
        substeps: Number of substeps per frame.
        simulated_frames: Number of frames computed so far, those computed again included.
    """

    def __init__(
        self,
        movers: Sequence[Mover],
        timings: Timing | AssignedWindows | None = None,
        *,
        fps: float | Rational,
        existing: Callable[[int], Sequence[int]] | None = None,
        obstacles: Callable[[int], Obstacles] | None = None,
        walls: Callable[[Fraction], Array | None] | None = None,
    ) -> None:
        """Prepare the trajectories; nothing is simulated yet.

        Args:
            movers: The movers; their indices are their numbers.
            timings: When each body's clock runs; None: AllTogether(0).
            fps: Frames per second.
            existing: Returns the ascending numbers of the movers that have a row at a frame: each mover at least from
                its first frame to the one after its last. Other movers are not read. Timings must then assign the same
                windows to any of the movers, as `AssignedWindows` does. None: all movers at all frames.
            obstacles: Returns the obstacles between a frame and the next; the same object while nothing changes. None:
                no obstacles.
            walls: Returns six planes [6, 4] at a time, seconds, or None for no walls. Inside is n . x + d >= 0, with a
                unit vector n. None: never any walls.

        Raises:
            ArgumentError: For timings that cannot apply to these bodies.
            ArgumentTypeError: For a dynamic that is neither closed-form nor Stepped nor bouncing.
        """
        self._existing = existing
        self.timings: Timing | AssignedWindows = AllTogether(0.0) if timings is None else timings
        argument_checks.positive(fps, "fps")
        self.fps = exact(fps)
        self._walls = walls or (lambda _time: None)
        empty = functools.cache(Obstacles.empty)
        self._obstacles = obstacles or (lambda _frame: empty())
        self.substeps = max(1, math.ceil(1 / (self.fps * SUBSTEP)))
        self.simulated_frames = 0
        self._first = 0  # the frame to start from; before it there is no collision
        self._current = -1  # frame of the state in the arrays; -1: none
        self._checkpoints: Checkpoints[_State] = Checkpoints(CHECKPOINT, MAX_CHECKPOINTS)
        self._recent: dict[int, _State] = {}
        self._results: OrderedDict[int, CollisionState] = OrderedDict()
        self._set_movers(movers)
        self._build(self._numbers(0))

    def frame(self, number: int) -> CollisionState:
        """Return all movers at frame `number` (0 or more), `number` / fps seconds after the start."""
        number = argument_checks.whole(number, "number")
        if number < 0:
            raise ArgumentError(f"number={number}: must be 0 or more")
        if self.is_unfinished:  # the arrays are between two substeps
            self._forget()
            self._build(self._numbers(0))
            self.is_unfinished = False
        if number not in self._results:
            self._simulate(number)
        self._results.move_to_end(number)
        return self._results[number]

    @as_a_whole
    def _simulate(self, number: int) -> None:
        if not self._first <= self._current <= number <= self._current + self._checkpoints.interval:
            self._seek(number)
        while self._current < number:
            state = self._advance(self._current)
            self._current += 1
            self._keep(self._with_current_movers(state))

    def amend(self, movers: Sequence[Mover], frame: int) -> None:
        """Change the movers from a frame on; results before it stay valid.

        Args:
            movers: The current movers, with other moves and last frames from `frame` on; then new ones, which do not
                exist before `frame`. With `existing`, it may be the same sequence as before, changed in place.
            frame: First frame that may differ. With `existing`, results of earlier frames may lack new movers.
        """
        grown = self._existing is None and len(movers) > len(self.movers)
        self._set_movers(movers)
        for known in (self._results, self._checkpoints, self._recent):
            for number in [each for each in known if each >= frame or (grown and known is self._results)]:
                del known[number]
        if grown or self._current >= frame:
            self._current = -1

    def start_at(self, frame: int) -> None:
        """Skip the frames before `frame`, in which no body bounces and all paths are free of collisions."""
        self._first = max(frame - 1, 0)
        self._forget()

    def _forget(self) -> None:
        """Drop all states."""
        self._current = -1
        for known in (self._results, self._checkpoints, self._recent):
            known.clear()

    def _set_movers(self, movers: Sequence[Mover]) -> None:
        self.movers = tuple(movers) if self._existing is None else movers

    def _numbers(self, frame: int) -> tuple[int, ...]:
        """Return the numbers of the movers that have a row at a frame."""
        return tuple(range(len(self.movers)) if self._existing is None else self._existing(frame))

    def _select(self, numbers: tuple[int, ...]) -> None:
        """Read some movers; if they are others than before, make paths and arrays for them."""
        if self._arrays.numbers != numbers:
            self._build(numbers)
        else:
            self._selected = [self.movers[number] for number in numbers]

    def _build(self, numbers: tuple[int, ...]) -> None:
        """Read some movers, and make paths and arrays for them."""
        self._selected = [self.movers[number] for number in numbers]
        self._paths = Paths([mover.body for mover in self._selected], self.timings, "movers")
        self._arrays: StepArrays = StepArrays(numbers, self._selected)

    def _load(self, frame: int, saved: _State | None) -> None:
        """Fill the arrays with the movers of a frame: as they were saved, others as they start."""
        numbers = self._numbers(frame)
        self._select(numbers)
        self._current = frame
        if saved is not None and saved.numbers == numbers:
            self._arrays.restore(saved.bodies, saved.integers)
            return
        bodies, integers = self._initial_state(frame)
        if saved is not None:
            _, rows, saved_rows = np.intersect1d(numbers, saved.numbers, assume_unique=True, return_indices=True)
            groups = integers[rows, at.FIRST_GROUP]
            bodies[rows], integers[rows] = saved.bodies[saved_rows], saved.integers[saved_rows]
            integers[rows, at.FIRST_GROUP] = groups
            integers[rows, at.CONTACT_COUNT] = 0  # contacts name rows of the saved state
        self._arrays.restore(bodies, integers)

    def _seek(self, number: int) -> None:
        """Load the last kept state before `number`, unless the current one is as near."""
        if number <= self._first:
            self._load(number, None)
            self._keep(self._arrays.collision_state())
            return
        states = self._checkpoints | self._recent
        latest = max((frame for frame in states if self._first <= frame < number), default=self._first)
        if latest <= self._current < number:
            return
        self._load(latest, states.get(latest))
        if latest not in states:
            self._keep(self._arrays.collision_state())

    def _with_current_movers(self, result: CollisionState) -> CollisionState:
        """Drop movers that have no row at the current frame from the arrays and from its result; add new ones."""
        numbers = self._numbers(self._current)
        if numbers == result.numbers:
            return result
        self._load(self._current, _State(result.numbers, *self._arrays.state()))
        blocked = dict(zip(result.numbers, result.blocked.tolist(), strict=True))
        state = self._arrays.collision_state()
        return replace(
            state, blocked=np.array([blocked.get(each, False) for each in numbers], bool), contacts=result.contacts
        )

    def _keep(self, state: CollisionState) -> None:
        """Apply the current frame's teleports; keep its result, its state and, at intervals, a checkpoint."""
        frame = self._current
        self._results[frame] = self._teleported(self._arrays, state)
        while len(self._results) > CACHED_FRAMES:
            self._results.popitem(last=False)
        if frame < self._first:
            return
        self._recent[frame] = _State(self._arrays.numbers, *self._arrays.state())
        while len(self._recent) > RECENT_FRAMES:
            del self._recent[next(iter(self._recent))]
        self._checkpoints.add(frame, self._recent[frame], always=frame == self._first)

    def _teleported(self, arrays: StepArrays, state: CollisionState) -> CollisionState:
        """Apply the teleports of the current frame to the arrays and to its result."""
        moves = {row: _pose(*last) for row, last in self._last_moves(self._current, exactly=True)}
        if not moves:
            return state
        arrays.set_poses(moves)
        poses = state.poses.copy()
        poses[list(moves)] = list(moves.values())
        return replace(state, poses=poses)

    def _last_moves(self, frame: int, exactly: bool) -> Iterator[tuple[int, tuple[Sequence[float], Sequence[float]]]]:
        """Yield row, position and rotation of each mover's last teleport up to `frame`, or only of those at `frame`."""
        for row, mover in enumerate(self._selected):
            done = bisect.bisect_right(mover.moves, frame, key=lambda move: move.frame)
            if done and not (exactly and mover.moves[done - 1].frame < frame):
                yield row, (mover.moves[done - 1].position, mover.moves[done - 1].rotation)

    def _advance(self, frame: int) -> CollisionState:
        """Simulate from frame `frame` to the next."""
        self.simulated_frames += 1
        arrays = self._arrays
        self._select(arrays.numbers)  # `amend` may have changed the movers
        times = [Fraction(frame * self.substeps + part, self.substeps) / self.fps for part in range(self.substeps + 1)]
        targets = self._path_poses(times, frame)
        clocks = [self._paths.seconds(time) for time in times]
        obstacles = self._obstacles(frame)
        if frame > 0 and self._obstacles(frame - 1) is not obstacles:
            arrays.obstacles_changed()
        arrays.begin_frame(targets[0], [self._is_present(mover, frame) for mover in self._selected])
        for part in range(self.substeps):
            active = clocks[part + 1] - clocks[part]
            length = float(times[part + 1] - times[part])
            arrays.substep(targets[part + 1], active, self._walls(times[part + 1]), length, obstacles)
        return arrays.collision_state(float(1 / self.fps))

    def _path_poses(self, times: Sequence[Fraction], frame: int) -> Array:
        """Return the poses on the paths, float64 [times, n, 7], after all teleports up to `frame`."""
        poses = self._paths.poses(times)
        for row, last in self._last_moves(frame, exactly=False):
            if isinstance(self._selected[row].body.dynamic, Still):
                poses[:, row] = _pose(*last)
        return poses

    @staticmethod
    def _is_present(mover: Mover, frame: int) -> bool:
        return mover.first_frame <= frame and (mover.last_frame is None or frame <= mover.last_frame)

    def _initial_state(self, frame: int) -> tuple[Array, NDArray[np.int32]]:
        """Return the columns of bodies that had no collision before a frame; bouncing bodies are at their start.

        They are not teleported at that frame yet.
        """
        count = len(self._selected)
        bodies = np.zeros((max(1, count), at.FLOAT_COLUMNS))
        integers = np.zeros((max(1, count), at.INTEGER_COLUMNS), dtype=np.int32)
        bodies[:count, at.POSITION : at.ROTATION + 4] = self._path_poses([Fraction(frame) / self.fps], frame - 1)[0]
        group = 0
        for row, mover in enumerate(self._selected):
            dynamic = mover.body.dynamic
            shape = mover.shape
            integers[row, at.KIND] = at.FOLLOWS
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
                # Random numbers depend on the name, not the row, because other bodies may be added or removed.
                name = hashlib.sha256(mover.body.name.encode()).digest()[:4]
                integers[row, at.NAME_HASH] = np.frombuffer(name, dtype="<i4")[0]
        return bodies, integers


def _pose(position: Sequence[float], rotation: Sequence[float]) -> Array:
    return np.array([*position, *rotation], dtype=np.float64)
