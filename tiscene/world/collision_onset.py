# SPDX-License-Identifier: Apache-2.0
"""CollisionOnset: the first frame from which objects of a scenario might collide.

Before it every pose is a closed form of time, and nothing is simulated. Each edit is considered once, when its frame is
reached, against the objects that are alive then.
"""

from __future__ import annotations

import bisect
from collections.abc import Callable

from dynamics import RigidBody, Still, UniformMovementRandomBounce
from dynamics.collision_free import PathBounds
from dynamics.obstacles import Obstacles
from tiscene.scenario.edits import Edit, EditLog, Move, PlaceCamera, SetFrustumWalls, Spawn
from tiscene.world.object_movers import UNUSED, ObjectMovers


class CollisionOnset:
    """Finds the onset of collisions. It may be earlier than the first collision that is possible, but never later.

    Args:
        log: the edit log; `amend` takes further edits.
        movers: its objects.
        obstacles: returns the stage as obstacles, as authored; called if an object that collides moves.
        walled: whether the scenario has walls from the start.
    """

    def __init__(self, log: EditLog, movers: ObjectMovers, obstacles: Callable[[], Obstacles], walled: bool) -> None:
        self._log = log
        self._movers = movers
        self._obstacles = obstacles
        self._edits: list[Edit] = sorted(log.edits, key=_frame)
        self._considered = 0  # number of those that are
        self._frame: int | None = None
        self._objects_considered = False
        # Bounds of the paths of objects that collide, by row; None: unbounded.
        self._paths: dict[int, PathBounds | None] = {}
        self._walled = walled
        self._has_limited = False  # objects that collide and that walls hold
        self._has_moving = False  # objects that collide and move
        self._is_stage_edited = False

    def amend(self, edit: Edit) -> None:
        """Take one more edit of the log."""
        if self._frame is not None and edit.frame >= self._frame:
            return
        place = bisect.bisect_right(self._edits, edit.frame, key=_frame)
        self._edits.insert(place, edit)
        self._considered = min(self._considered, place)

    def find(self, frame: int) -> int | None:
        """Return the onset if it is at a frame or before, by what is known at that frame; else None."""
        if not self._objects_considered:
            for row in self._log.around(-1):
                self._add(row, 0)
            self._check(0)
            self._objects_considered = True  # last, as below: what an exception interrupts is considered again
        while self._considered < len(self._edits):
            edit = self._edits[self._considered]
            if edit.frame > frame or (self._frame is not None and edit.frame >= self._frame):
                break
            self._consider(edit)
            self._considered = min(self._considered + 1, len(self._edits))
        return self._frame if self._frame is not None and self._frame <= frame else None

    def _consider(self, edit: Edit) -> None:
        if isinstance(edit, SetFrustumWalls):
            self._walled |= edit.frustum is not None
        elif isinstance(edit, Spawn):
            row = self._log.row(edit.object.id)
            if row is not None:
                self._add(row, edit.frame)
        elif isinstance(edit, PlaceCamera):
            return  # cameras collide with nothing
        elif self._log.row(edit.id) is None:
            self._is_stage_edited = True
        elif isinstance(edit, Move):
            self._found(edit.frame)
        self._check(edit.frame)

    def _check(self, frame: int) -> None:
        """Find the onset where walls or edited obstacles make all paths uncertain."""
        if (self._walled and self._has_limited) or (self._is_stage_edited and self._has_moving):
            self._found(frame)

    def _found(self, frame: int) -> None:
        self._frame = frame if self._frame is None else min(self._frame, frame)
        del self._edits[bisect.bisect_left(self._edits, self._frame, key=_frame) :]
        self._considered = min(self._considered, len(self._edits))

    def _add(self, row: int, frame: int) -> None:
        """Consider an object from a frame on."""
        spec = self._log.histories[row].spec
        if isinstance(spec.dynamic, UniformMovementRandomBounce):
            self._found(frame)
        elif spec.collide and not isinstance(spec.dynamic, RigidBody):
            self._has_limited |= spec.frustum_limited
            moves = not isinstance(spec.dynamic, Still | None)
            self._has_moving |= moves
            if self._has_moving and not self._is_free(row, frame):
                self._found(frame)

    def _is_free(self, row: int, frame: int) -> bool:
        """Return whether the path of an object is clear of the stage and of the objects that are alive at a frame."""
        if self._movers[row].shape is None:
            return True
        path = self._path(row)
        if path is None or not (path.is_static or path.is_clear_of(self._obstacles())):
            return False
        near = self._log.around(frame)
        if len(self._paths) > 2 * len(near) + UNUSED:
            self._paths = {each: self._paths[each] for each in near if each in self._paths}
        others = [each for each in near if each != row and self._can_collide(each)]
        paths = [each for each in map(self._path, others) if each is not None]
        return len(paths) == len(others) and not path.may_meet_any(paths)

    def _can_collide(self, row: int) -> bool:
        return self._log.histories[row].spec.collide and self._movers[row].shape is not None

    def _path(self, row: int) -> PathBounds | None:
        if row not in self._paths:
            self._paths[row] = PathBounds.of(self._movers[row])
        return self._paths[row]


def _frame(edit: Edit) -> int:
    return edit.frame
