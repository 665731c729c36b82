# SPDX-License-Identifier: Apache-2.0
"""Edits of a running stream: spawn, despawn, move, place a camera, new frustum walls; and the log that replays them."""

from __future__ import annotations

import bisect
import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

from dynamics import Still
from dynamics.argument_checks import index, position, positive, rotation, set_checked, text, vector
from tiscene.errors import ScenarioError, scenario_errors
from tiscene.scenario.lifespan_index import LifespanIndex
from tiscene.scenario.objects import Frustum, Object
from tiscene.scene.camera import Camera, Quaternion, Vector3
from tiscene.scene.walking import Axes, walked_axes


@dataclass(frozen=True, slots=True)
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
            set_checked(self, frame=index)
            if not isinstance(self.object, Object) or self.object.first_frame != self.frame:
                raise ScenarioError(
                    f"object: must be an Object whose first_frame is {self.frame}, the frame of its spawn"
                )


@dataclass(frozen=True, slots=True)
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
            set_checked(self, frame=index, id=text)


@dataclass(frozen=True, slots=True)
class Move:
    """Move an object at a frame. An object on a path returns to it; a bouncing one continues from there.

    Attributes:
        frame: the first frame at the new pose.
        id: id in the scenario, or prim path on the stage. An object of the stage stays from then on, or continues
            its animation from there.
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
            set_checked(self, frame=index, id=text, position=position, rotation=rotation)


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
            set_checked(self, frame=index)
            if not isinstance(self.frustum, Frustum | None):
                raise ScenarioError(f"frustum={self.frustum!r}: must be a Frustum or None")
            if not isinstance(self.camera, Camera) or self.camera.dynamic is not None or self.camera.lens is not None:
                text = "must be a Camera without a dynamic and without keyframes of its lens"
                raise ScenarioError(f"camera={self.camera!r}: {text}; to move walls, set them again")
            set_checked(self, aspect=positive)


@dataclass(frozen=True)
class PlaceCamera:
    """Place a camera at a frame. It leaves its trajectory, if it has one, and stays until it is placed again.

    Attributes:
        frame: the first frame at the new pose.
        camera: name of the camera.
        position: m.
        rotation: unit quaternion.

    Raises:
        ScenarioError: a value is invalid.
    """

    frame: int
    camera: str
    position: Vector3
    rotation: Quaternion

    def __post_init__(self) -> None:
        with scenario_errors():
            set_checked(self, frame=index, camera=text, position=vector, rotation=_quaternion)


def _quaternion(value: Any, name: str) -> tuple[float, ...]:
    quaternion = rotation(value, name)
    if len(quaternion) != 4:
        raise ScenarioError(f"{name}={value!r}: must be a quaternion (w, x, y, z)")
    return quaternion


Edit = Spawn | Despawn | Move | SetFrustumWalls | PlaceCamera


AnyEdit = TypeVar("AnyEdit", Move, PlaceCamera)


def _last(edits: Sequence[AnyEdit], frame: int) -> AnyEdit | None:
    """Return the last of some edits, given by ascending frames, up to a frame; None: there is none."""
    done = bisect.bisect_right(edits, frame, key=lambda edit: edit.frame)
    return edits[done - 1] if done else None


@dataclass(eq=False, slots=True)
class ObjectHistory:
    """An object of the scenario with its edits. An EditLog extends it in place.

    Attributes:
        spec: the object, as in the scenario or in its spawn.
        spawned: frame of its spawn; None: it is part of the scenario.
        despawned: frame of its removal; None: none.
        moves: its moves, by frame.
    """

    spec: Object
    spawned: int | None = None
    despawned: int | None = None
    moves: list[Move] = field(default_factory=list)

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

    def move(self, frame: int) -> Move | None:
        """Return the last move up to a frame; None: there is none."""
        return _last(self.moves, frame)

    def is_static(self, as_of: int) -> bool:
        """Return whether, as of a frame, it is alive for ever and never moves; True before its spawn.

        Spawns and moves at frame 0 say how the scenario starts. They do not count as changes.
        """
        if self.spawned is not None and self.spawned > as_of:
            return True
        planned, move = self.spec, self.move(as_of)
        return (
            (planned.dynamic is None or isinstance(planned.dynamic, Still))
            and planned.first_frame == 0
            and planned.last_frame is None
            and (self.despawned is None or self.despawned > as_of)
            and (move is None or move.frame == 0)
        )


@dataclass(eq=False)
class StageObjectHistory:
    """An object of the stage with its edits. An EditLog extends it in place.

    Attributes:
        despawned: frame of its removal; None: none.
        moves: its moves, by frame.
    """

    despawned: int | None = None
    moves: list[Move] = field(default_factory=list)

    def alive(self, frame: int, as_of: int) -> bool:
        """Return whether it is alive at a frame, as known when frame `as_of` was made."""
        return self.despawned is None or self.despawned > min(frame, as_of)

    def move(self, frame: int, as_of: int) -> Move | None:
        """Return the last move up to a frame, as known at `as_of`; None: it has its authored pose."""
        return _last(self.moves, min(frame, as_of))

    def is_static(self, as_of: int) -> bool:
        """Return whether no edit up to a frame has removed it, or moved it after frame 0."""
        move = self.move(as_of, as_of)
        return self.alive(as_of, as_of) and (move is None or move.frame == 0)


@dataclass(eq=False)
class CameraHistory:
    """The placements of a camera. An EditLog extends it in place.

    Attributes:
        placements: its placements, by frame.
        first_steps: the first frame at which one of them is a step from another along an axis, by axis.
    """

    placements: list[PlaceCamera] = field(default_factory=list)
    first_steps: dict[int, int] = field(default_factory=dict)

    def at(self, frame: int) -> PlaceCamera | None:
        """Return the last placement up to a frame; None: there is none."""
        return _last(self.placements, frame)

    def walks(self, frame: int) -> Axes:
        """Return along which axes placements up to a frame are steps from others."""
        return Axes(axis for axis, first in self.first_steps.items() if first <= frame)

    def add(self, placement: PlaceCamera) -> None:
        """Add a placement; of two at one frame the later one wins."""
        bisect.insort(self.placements, placement, key=lambda each: each.frame)
        after = bisect.bisect_right(self.placements, placement.frame, key=lambda each: each.frame)
        for one, next in itertools.pairwise(self.placements[max(after - 2, 0) : after + 1]):
            for axis in walked_axes(one.position, next.position):
                self.first_steps[axis] = min(next.frame, self.first_steps.get(axis, next.frame))


class EditLog:
    """The edits of a scenario and the histories that result; grows by one edit at a time.

    Edits are in the order in which they were made. Their frames can decrease where the stream was sought back. Adding
    an edit takes the same time whatever their number.

    Args:
        objects: the scenario's objects.
        edits: edits so far.

    Attributes:
        edits: all edits.
        histories: histories of all objects, spawned ones last.
        stage_histories: histories of edited objects of the stage, by prim path.
        enclosures: effective replacements of the walls, by frame.
        cameras: histories of placed cameras, by name.

    Raises:
        ScenarioError: an edit is impossible.
    """

    def __init__(self, objects: Sequence[Object], edits: Sequence[Edit]) -> None:
        self.edits: list[Edit] = []
        self.histories = [ObjectHistory(each) for each in objects]
        self.stage_histories: dict[str, StageObjectHistory] = {}
        self.enclosures: list[SetFrustumWalls] = []
        self.cameras: dict[str, CameraHistory] = {}
        self._rows = {each.id: row for row, each in enumerate(objects)}
        self._unspawned = range(len(objects))
        self._spawned = LifespanIndex()
        for edit in edits:
            self.add(edit)

    def row(self, id: str) -> int | None:
        """Return the row of an object in `histories`; None for objects of the stage."""
        return self._rows.get(id)

    def around(self, frame: int) -> tuple[int, ...]:
        """Return the rows in `histories` of the objects that have to do with a frame, in ascending order.

        These are the spawned objects that are alive at the frame or at the one before it, and all objects that the
        scenario has without edits: their rows are the same at all frames.
        """
        return *self._unspawned, *self._spawned.at(frame)

    def alive(self, frame: int) -> list[int]:
        """Return the rows in `histories` of the objects that are alive at a frame, in ascending order."""
        return [row for row in self.around(frame) if self.histories[row].alive(frame, as_of=frame)]

    def camera(self, name: str, frame: int) -> PlaceCamera | None:
        """Return the last placement of a camera up to a frame; None: there is none."""
        history = self.cameras.get(name)
        return None if history is None else history.at(frame)

    def check(self, edit: Edit) -> None:
        """Raise ScenarioError if an edit is impossible."""
        where = f"edits[{len(self.edits)}]"
        if isinstance(edit, Spawn) and edit.object.id in self._rows:
            raise ScenarioError(f"{where}: the id {edit.object.id!r} is taken; ids are not reused")
        if isinstance(edit, Move | Despawn):
            history: ObjectHistory | StageObjectHistory | None = None
            if edit.id in self._rows:
                history = self.histories[self._rows[edit.id]]
            elif edit.id.startswith("/"):
                history = self.stage_histories.get(edit.id, StageObjectHistory())
            if history is None:
                raise ScenarioError(f"{where}: no object {edit.id!r} exists before this edit")
            if not history.alive(edit.frame, edit.frame):
                raise ScenarioError(f"{where}: the object {edit.id!r} is not alive at frame {edit.frame}")

    def add(self, edit: Edit) -> None:
        """Add an edit.

        Raises:
            ScenarioError: the edit is impossible; nothing has changed then.
        """
        self.check(edit)
        if isinstance(edit, SetFrustumWalls):
            # A later entry of the log overrides earlier ones from its frame on.
            while self.enclosures and self.enclosures[-1].frame >= edit.frame:
                self.enclosures.pop()
            self.enclosures.append(edit)
        elif isinstance(edit, PlaceCamera):
            self.cameras.setdefault(edit.camera, CameraHistory()).add(edit)
        elif isinstance(edit, Spawn):
            row = self._rows[edit.object.id] = len(self.histories)
            self.histories.append(ObjectHistory(edit.object, spawned=edit.frame))
            self._spawned.add(row, *_relevant(self.histories[row]))
        elif edit.id not in self._rows:
            _extend(self.stage_histories.setdefault(edit.id, StageObjectHistory()), edit)
        else:
            row = self._rows[edit.id]
            history = self.histories[row]
            if isinstance(edit, Despawn) and history.spawned is not None:
                self._spawned.remove(row, *_relevant(history))
                history.despawned = edit.frame
                self._spawned.add(row, *_relevant(history))
            else:
                _extend(history, edit)
        self.edits.append(edit)


def _extend(history: ObjectHistory | StageObjectHistory, edit: Move | Despawn) -> None:
    """Add an edit to a history; of two moves at one frame the later edit wins."""
    if isinstance(edit, Despawn):
        history.despawned = edit.frame
    else:
        bisect.insort(history.moves, edit, key=lambda move: move.frame)


def _relevant(history: ObjectHistory) -> tuple[int, int | None]:
    """Return the first frame of a lifespan and the first one after it: None if it does not end.

    An object that is despawned at the frame of its spawn has neither.
    """
    first, last = history.spec.first_frame, history.last_frame
    return first, None if last is None else last + (last >= first)
