# SPDX-License-Identifier: Apache-2.0
"""Edits: what was done to a running stream, frame by frame, so that it can be done again."""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from dynamics import Still, argument_checks
from tiscene.errors import ScenarioError, scenario_errors
from tiscene.scenario.objects import Frustum, Object
from tiscene.scene.camera import Camera, Vector3


@dataclass(frozen=True)
class Spawn:
    """An object appears at a frame. Timings do not apply to it: its clock runs from then on. Raises ScenarioError."""

    frame: int
    object: Object

    def __post_init__(self) -> None:
        with scenario_errors():
            object.__setattr__(self, "frame", _frame(self.frame))
            if getattr(self.object, "first_frame", None) != self.frame:
                raise ScenarioError(
                    f"object: must be an Object whose first_frame is {self.frame}, the frame of its spawn"
                )


@dataclass(frozen=True)
class Despawn:
    """Something is gone from a frame on. Raises ScenarioError.

    id: of an object of the scenario, or the prim path of a thing of the stage.
    """

    frame: int
    id: str

    def __post_init__(self) -> None:
        with scenario_errors():
            object.__setattr__(self, "frame", _frame(self.frame))
            argument_checks.text(self.id, "id")


@dataclass(frozen=True)
class Move:
    """Something is put elsewhere at a frame. What follows a path returns to it, what bounces goes on from there.

    id: of an object of the scenario, or the prim path of a thing of the stage, which stands there from then on.
    position: m. rotation: Euler degrees or a quaternion. Raises ScenarioError.
    """

    frame: int
    id: str
    position: Vector3
    rotation: tuple[float, ...] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        with scenario_errors():
            object.__setattr__(self, "frame", _frame(self.frame))
            argument_checks.text(self.id, "id")
            object.__setattr__(self, "position", argument_checks.vector(self.position, "position"))
            object.__setattr__(self, "rotation", argument_checks.rotation(self.rotation, "rotation"))


@dataclass(frozen=True)
class SetFrustumWalls:
    """The walls that hold objects are those of another view from a frame on; they stand still.

    frustum: None: there are no walls. camera: whose view it is. aspect: its width / height. Raises ScenarioError.
    """

    frame: int
    frustum: Frustum | None
    camera: Camera
    aspect: float

    def __post_init__(self) -> None:
        with scenario_errors():
            object.__setattr__(self, "frame", _frame(self.frame))
            if not isinstance(self.camera, Camera) or self.camera.dynamic is not None:
                raise ScenarioError(
                    f"camera={self.camera!r}: must be a Camera without a dynamic: enclose again to move the walls"
                )
            object.__setattr__(self, "aspect", argument_checks.positive(self.aspect, "aspect"))


Edit = Spawn | Despawn | Move | SetFrustumWalls


@dataclass(frozen=True)
class ObjectHistory:
    """An object with what was done to it. planned: as the scenario or its spawn has it.

    spawned, despawned: the frames of the edits that did it, None if none did. moves: in the order of their frames.
    """

    spec: Object
    spawned: int | None = None
    despawned: int | None = None
    moves: tuple[Move, ...] = ()

    @property
    def last_frame(self) -> int | None:
        """The last frame at which it is there; None: it stays for ever."""
        ends = [self.spec.last_frame, None if self.despawned is None else self.despawned - 1]
        return min((end for end in ends if end is not None), default=None)

    def alive(self, frame: int, as_of: int) -> bool:
        """Whether it is there at a frame, as it was planned when frame `as_of` was made: edits are not anticipated."""
        if self.spawned is not None and self.spawned > as_of:
            return False
        if self.despawned is not None and self.despawned <= as_of and frame >= self.despawned:
            return False
        return self.spec.alive(frame)

    def is_static(self, as_of: int) -> bool:
        """Whether it is always there and never moves, or nobody knows of it, when frame `as_of` is made."""
        if self.spawned is not None and self.spawned > as_of:
            return True
        planned = self.spec
        edited = self.spawned, self.despawned, self.moves[0].frame if self.moves else None
        return (
            (planned.dynamic is None or isinstance(planned.dynamic, Still))
            and planned.first_frame == 0
            and planned.last_frame is None
            and not any(frame is not None and frame <= as_of for frame in edited)
        )

    def edited(self, edit: Move | Despawn) -> ObjectHistory:
        """With one edit more."""
        if isinstance(edit, Despawn):
            return replace(self, despawned=edit.frame)
        return replace(self, moves=_with(self.moves, edit))


@dataclass(frozen=True)
class StageObjectHistory:
    """What was done to a thing of the stage. despawned: at which frame, or None. moves: in the order of frames."""

    despawned: int | None = None
    moves: tuple[Move, ...] = ()

    def alive(self, frame: int, as_of: int) -> bool:
        """Whether it is there at a frame, as it was known when frame `as_of` was made."""
        return self.despawned is None or self.despawned > min(frame, as_of)

    def move(self, frame: int, as_of: int) -> Move | None:
        """The move that put it where it is at a frame, as known at `as_of`; None: it is where it always was."""
        done = bisect.bisect_right(self.moves, min(frame, as_of), key=lambda move: move.frame)
        return self.moves[done - 1] if done else None

    def edited(self, edit: Move | Despawn) -> StageObjectHistory:
        """With one edit more."""
        if isinstance(edit, Despawn):
            return replace(self, despawned=edit.frame)
        return replace(self, moves=_with(self.moves, edit))


class EditLog:
    """What the edits make of the objects of a scenario and of the things of its stage; grows by one edit at a time.

    Edits stand in the order in which they were made; their frames may go back where the stream was sought back.
    edits: all of them. lives: all objects that ever are, the spawned ones after the others. stage: of the things that
    something was done to, by their prim paths. enclosures: those that count, in the order of their frames.
    """

    def __init__(self, objects: Sequence[Object], edits: Sequence[Edit] = ()) -> None:
        """Raises ScenarioError for an edit that cannot be."""
        self.edits: list[Edit] = []
        self.lives = [ObjectHistory(each) for each in objects]
        self.stage: dict[str, StageObjectHistory] = {}
        self.enclosures: list[SetFrustumWalls] = []
        self._rows = {each.id: row for row, each in enumerate(objects)}
        for edit in edits:
            self.add(edit)

    def row(self, id: str) -> int | None:
        """Of an object in `lives`; None: there is none, as for things of the stage."""
        return self._rows.get(id)

    def add(self, edit: Edit) -> None:
        """Raises ScenarioError for an edit that cannot be, changing nothing."""
        where = f"edits[{len(self.edits)}]"
        if isinstance(edit, SetFrustumWalls):
            # One that stands later in the log wins from its frame on.
            while self.enclosures and self.enclosures[-1].frame >= edit.frame:
                self.enclosures.pop()
            self.enclosures.append(edit)
        elif isinstance(edit, Spawn):
            if edit.object.id in self._rows:
                raise ScenarioError(f"{where}: there is an object {edit.object.id!r} already; ids are never reused")
            self._rows[edit.object.id] = len(self.lives)
            self.lives.append(ObjectHistory(edit.object, spawned=edit.frame))
        elif edit.id in self._rows:
            row = self._rows[edit.id]
            if not self.lives[row].alive(edit.frame, edit.frame):
                raise ScenarioError(f"{where}: the object {edit.id!r} is not there at frame {edit.frame}")
            self.lives[row] = self.lives[row].edited(edit)
        elif edit.id.startswith("/"):
            life = self.stage.get(edit.id, StageObjectHistory())
            if not life.alive(edit.frame, edit.frame):
                raise ScenarioError(f"{where}: {edit.id!r} is not there at frame {edit.frame}")
            self.stage[edit.id] = life.edited(edit)
        else:
            raise ScenarioError(f"{where}: no object {edit.id!r} was there before it")
        self.edits.append(edit)


def _with(moves: tuple[Move, ...], move: Move) -> tuple[Move, ...]:
    """In the order of frames; of two at one frame the later one wins."""
    if not moves or moves[-1].frame <= move.frame:
        return (*moves, move)
    return tuple(sorted((*moves, move), key=lambda each: each.frame))


def _frame(value: Any) -> int:
    frame = argument_checks.whole(value, "frame")
    if frame < 0:
        raise ScenarioError(f"frame={value!r}: must be 0 or more")
    return frame
