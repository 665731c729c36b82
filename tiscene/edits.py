"""Edits: what was done to a running stream, frame by frame, so that it can be done again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from dynamics import Still, check
from tiscene.camera import Camera, Vector3

if TYPE_CHECKING:
    from tiscene.scenario import Frustum, Object


@dataclass(frozen=True)
class Spawn:
    """An object appears at a frame. Timings do not apply to it: its clock runs from then on."""

    frame: int
    object: Object

    def __post_init__(self) -> None:
        object.__setattr__(self, "frame", _frame(self.frame))
        if getattr(self.object, "first_frame", None) != self.frame:
            raise ValueError(f"object: must be an Object whose first_frame is {self.frame}, the frame of its spawn")


@dataclass(frozen=True)
class Despawn:
    """Something is gone from a frame on. id: of an object of the scenario, or the prim path of a thing of the stage."""

    frame: int
    id: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "frame", _frame(self.frame))


@dataclass(frozen=True)
class Move:
    """Something is put elsewhere at a frame. What follows a path returns to it, what bounces goes on from there.

    id: of an object of the scenario, or the prim path of a thing of the stage, which stands there from then on.
    position: m. rotation: Euler degrees or a quaternion.
    """

    frame: int
    id: str
    position: Vector3
    rotation: tuple[float, ...] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "frame", _frame(self.frame))
        object.__setattr__(self, "position", check.vector(self.position, "position"))
        object.__setattr__(self, "rotation", check.rotation(self.rotation, "rotation"))


@dataclass(frozen=True)
class Enclose:
    """The walls that hold objects are those of another view from a frame on; they stand still.

    frustum: None: there are no walls. camera: whose view it is. aspect: its width / height.
    """

    frame: int
    frustum: Frustum | None
    camera: Camera
    aspect: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "frame", _frame(self.frame))
        if not isinstance(self.camera, Camera) or self.camera.dynamic is not None:
            raise TypeError(
                f"camera={self.camera!r}: must be a Camera without a dynamic: enclose again to move the walls"
            )
        object.__setattr__(self, "aspect", check.positive(self.aspect, "aspect"))


Edit = Spawn | Despawn | Move | Enclose


@dataclass(frozen=True)
class Life:
    """An object with what was done to it. planned: as the scenario or its spawn has it.

    spawned, despawned: the frames of the edits that did it, None if none did. moves: in the order of their frames.
    """

    planned: Object
    spawned: int | None = None
    despawned: int | None = None
    moves: tuple[Move, ...] = ()

    @property
    def last_frame(self) -> int | None:
        """The last frame at which it is there; None: it stays for ever."""
        ends = [self.planned.last_frame, None if self.despawned is None else self.despawned - 1]
        return min((end for end in ends if end is not None), default=None)

    def alive(self, frame: int, known: int) -> bool:
        """Whether it is there at a frame, as it was planned when frame `known` was made: edits are not anticipated."""
        if self.spawned is not None and self.spawned > known:
            return False
        if self.despawned is not None and self.despawned <= known and frame >= self.despawned:
            return False
        return self.planned.alive(frame)

    def rests(self, known: int) -> bool:
        """Whether it is always there and never moves, as far as was known when frame `known` was made."""
        planned = self.planned
        edited = self.spawned, self.despawned, *(move.frame for move in self.moves)
        return (
            (planned.dynamic is None or isinstance(planned.dynamic, Still))
            and planned.first_frame == 0
            and planned.last_frame is None
            and not any(frame is not None and frame <= known for frame in edited)
        )


@dataclass(frozen=True)
class StageLife:
    """What was done to a thing of the stage. despawned: at which frame, or None. moves: in the order of frames."""

    despawned: int | None = None
    moves: tuple[Move, ...] = ()

    def alive(self, frame: int, known: int) -> bool:
        """Whether it is there at a frame, as it was known when frame `known` was made."""
        return self.despawned is None or self.despawned > min(frame, known)

    def move(self, frame: int, known: int) -> Move | None:
        """The move that put it where it is at a frame, as known at `known`; None: it is where it always was."""
        done = [move for move in self.moves if move.frame <= min(frame, known)]
        return done[-1] if done else None


def stage_lives(objects: Sequence[Object], edits: Sequence[Edit]) -> dict[str, StageLife]:
    """What was done to things of the stage, by their prim paths. Raises ValueError for an edit that cannot be."""
    own = {each.id for each in objects} | {edit.object.id for edit in edits if isinstance(edit, Spawn)}
    result: dict[str, StageLife] = {}
    for row, edit in enumerate(edits):
        if not isinstance(edit, Move | Despawn) or edit.id in own:
            continue
        life = result.get(edit.id, StageLife())
        if not life.alive(edit.frame, edit.frame):
            raise ValueError(f"edits[{row}]: {edit.id!r} is not there at frame {edit.frame}")
        if isinstance(edit, Despawn):
            result[edit.id] = replace(life, despawned=edit.frame)
        else:
            result[edit.id] = replace(life, moves=_in_order((*life.moves, edit)))
    return result


def _in_order(moves: Sequence[Move]) -> tuple[Move, ...]:
    return tuple(sorted(moves, key=lambda move: move.frame))


def lives(objects: Sequence[Object], edits: Sequence[Edit]) -> list[Life]:
    """All objects that ever are, the spawned ones after the others. Raises ValueError for an edit that cannot be.

    Edits stand in the order in which they were made; their frames may go back where the stream was sought back.
    """
    result = {each.id: Life(each) for each in objects}
    for row, edit in enumerate(edits):
        if isinstance(edit, Spawn):
            if edit.object.id in result:
                raise ValueError(f"edits[{row}]: there is an object {edit.object.id!r} already; ids are never reused")
            result[edit.object.id] = Life(edit.object, spawned=edit.frame)
            continue
        if isinstance(edit, Enclose):
            continue
        life = result.get(edit.id)
        if life is None:
            if edit.id.startswith("/"):
                continue  # a thing of the stage
            raise ValueError(f"edits[{row}]: no object {edit.id!r} was there before it")
        if not life.alive(edit.frame, edit.frame):
            raise ValueError(f"edits[{row}]: the object {edit.id!r} is not there at frame {edit.frame}")
        if isinstance(edit, Despawn):
            result[edit.id] = replace(life, despawned=edit.frame)
        else:
            result[edit.id] = replace(life, moves=_in_order((*life.moves, edit)))
    return list(result.values())


def _frame(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise TypeError(f"frame={value!r}: must be a whole number of frames")
    if value < 0:
        raise ValueError(f"frame={value!r}: must be 0 or more")
    return value
