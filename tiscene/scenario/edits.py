# SPDX-License-Identifier: Apache-2.0
"""Edits of a running stream: spawn, despawn, move, new frustum walls; and the log that replays them."""

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
    """Spawn an object. Timings do not apply to it: its clock starts at its first frame.

    Attributes:
        frame: the frame at which it appears.
        object: the object; its `first_frame` is `frame`.

    Raises:
        ScenarioError: a value is invalid.
    """

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
    """Remove an object from a frame on.

    Attributes:
        frame: the first frame without it.
        id: id in the scenario, or prim path on the stage.

    Raises:
        ScenarioError: a value is invalid.
    """

    frame: int
    id: str

    def __post_init__(self) -> None:
        with scenario_errors():
            object.__setattr__(self, "frame", _frame(self.frame))
            argument_checks.text(self.id, "id")


@dataclass(frozen=True)
class Move:
    """Move an object at a frame. An object on a path returns to it; a bouncing one continues from there.

    Attributes:
        frame: the first frame at the new pose.
        id: id in the scenario, or prim path on the stage, where the object stays from then on.
        position: m.
        rotation: Euler angles in degrees, or a quaternion.

    Raises:
        ScenarioError: a value is invalid.
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
    """Replace the walls that bound objects, from a frame on; they do not move.

    Attributes:
        frame: the first frame with these walls.
        frustum: the walls; None: none.
        camera: the camera whose view they enclose.
        aspect: width / height of that view.

    Raises:
        ScenarioError: a value is invalid.
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
                    f"camera={self.camera!r}: must be a Camera without a dynamic; to move walls, set them again"
                )
            object.__setattr__(self, "aspect", argument_checks.positive(self.aspect, "aspect"))


Edit = Spawn | Despawn | Move | SetFrustumWalls


@dataclass(frozen=True)
class ObjectHistory:
    """An object of the scenario with its edits.

    Attributes:
        spec: the object, as in the scenario or in its spawn.
        spawned: frame of its spawn; None: it is part of the scenario.
        despawned: frame of its removal; None: none.
        moves: its moves, by frame.
    """

    spec: Object
    spawned: int | None = None
    despawned: int | None = None
    moves: tuple[Move, ...] = ()

    @property
    def last_frame(self) -> int | None:
        """The last frame at which it is alive; None: for ever."""
        ends = [self.spec.last_frame, None if self.despawned is None else self.despawned - 1]
        return min((end for end in ends if end is not None), default=None)

    def alive(self, frame: int, as_of: int) -> bool:
        """Return whether it is alive at a frame, as planned when frame `as_of` was made: edits are not anticipated."""
        if self.spawned is not None and self.spawned > as_of:
            return False
        if self.despawned is not None and self.despawned <= as_of and frame >= self.despawned:
            return False
        return self.spec.alive(frame)

    def is_static(self, as_of: int) -> bool:
        """Return whether, as of a frame, it is alive for ever and never moves; True before its spawn."""
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
        """Return the history with one more edit."""
        if isinstance(edit, Despawn):
            return replace(self, despawned=edit.frame)
        return replace(self, moves=_with(self.moves, edit))


@dataclass(frozen=True)
class StageObjectHistory:
    """An object of the stage with its edits.

    Attributes:
        despawned: frame of its removal; None: none.
        moves: its moves, by frame.
    """

    despawned: int | None = None
    moves: tuple[Move, ...] = ()

    def alive(self, frame: int, as_of: int) -> bool:
        """Return whether it is alive at a frame, as known when frame `as_of` was made."""
        return self.despawned is None or self.despawned > min(frame, as_of)

    def move(self, frame: int, as_of: int) -> Move | None:
        """Return the last move up to a frame, as known at `as_of`; None: it has its authored pose."""
        done = bisect.bisect_right(self.moves, min(frame, as_of), key=lambda move: move.frame)
        return self.moves[done - 1] if done else None

    def edited(self, edit: Move | Despawn) -> StageObjectHistory:
        """Return the history with one more edit."""
        if isinstance(edit, Despawn):
            return replace(self, despawned=edit.frame)
        return replace(self, moves=_with(self.moves, edit))


class EditLog:
    """The edits of a scenario and the histories that result; grows by one edit at a time.

    Edits are in the order in which they were made. Their frames can decrease where the stream was sought back.

    Args:
        objects: the scenario's objects.
        edits: edits so far.

    Attributes:
        edits: all edits.
        lives: histories of all objects, spawned ones last.
        stage: histories of edited objects of the stage, by prim path.
        enclosures: effective replacements of the walls, by frame.

    Raises:
        ScenarioError: an edit is impossible.
    """

    def __init__(self, objects: Sequence[Object], edits: Sequence[Edit] = ()) -> None:
        self.edits: list[Edit] = []
        self.lives = [ObjectHistory(each) for each in objects]
        self.stage: dict[str, StageObjectHistory] = {}
        self.enclosures: list[SetFrustumWalls] = []
        self._rows = {each.id: row for row, each in enumerate(objects)}
        for edit in edits:
            self.add(edit)

    def row(self, id: str) -> int | None:
        """Return the row of an object in `lives`; None for objects of the stage."""
        return self._rows.get(id)

    def add(self, edit: Edit) -> None:
        """Add an edit.

        Raises:
            ScenarioError: the edit is impossible; nothing has changed then.
        """
        where = f"edits[{len(self.edits)}]"
        if isinstance(edit, SetFrustumWalls):
            # A later entry of the log overrides earlier ones from its frame on.
            while self.enclosures and self.enclosures[-1].frame >= edit.frame:
                self.enclosures.pop()
            self.enclosures.append(edit)
        elif isinstance(edit, Spawn):
            if edit.object.id in self._rows:
                raise ScenarioError(f"{where}: the id {edit.object.id!r} is taken; ids are not reused")
            self._rows[edit.object.id] = len(self.lives)
            self.lives.append(ObjectHistory(edit.object, spawned=edit.frame))
        elif edit.id in self._rows:
            row = self._rows[edit.id]
            if not self.lives[row].alive(edit.frame, edit.frame):
                raise ScenarioError(f"{where}: the object {edit.id!r} is not alive at frame {edit.frame}")
            self.lives[row] = self.lives[row].edited(edit)
        elif edit.id.startswith("/"):
            life = self.stage.get(edit.id, StageObjectHistory())
            if not life.alive(edit.frame, edit.frame):
                raise ScenarioError(f"{where}: {edit.id!r} is not alive at frame {edit.frame}")
            self.stage[edit.id] = life.edited(edit)
        else:
            raise ScenarioError(f"{where}: no object {edit.id!r} exists before this edit")
        self.edits.append(edit)


def _with(moves: tuple[Move, ...], move: Move) -> tuple[Move, ...]:
    """Insert a move by frame; of two at one frame the later edit wins."""
    if not moves or moves[-1].frame <= move.frame:
        return (*moves, move)
    return tuple(sorted((*moves, move), key=lambda each: each.frame))


def _frame(value: Any) -> int:
    frame = argument_checks.whole(value, "frame")
    if frame < 0:
        raise ScenarioError(f"frame={value!r}: must be 0 or more")
    return frame
