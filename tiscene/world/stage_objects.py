# SPDX-License-Identifier: Apache-2.0
"""StageObjects: poses and presence of the stage's own objects, by authored animation and by edits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynamics.rotation import matrix_from_quaternion, quaternion
from tiscene.errors import ScenarioError, did_you_mean
from tiscene.frame.object_table import ObjectState
from tiscene.scenario.edits import Move, StageObjectHistory
from tiscene.scene.affine_maps import inverted
from tiscene.scene.animation import polar, quaternions
from tiscene.scene.assembly import corners
from tiscene.scene.camera import Vector3, quaternion_from_matrix
from tiscene.scene.description import Instance, SceneDescription
from tiscene.world.stage_animation import AnimatedInstances

Array = NDArray[np.float64]


class StageObjects:
    """The stage's objects, with their authored animation and the edits that moved or removed them.

    Args:
        stage: the stage.
        rows: its objects, posed as authored.
        owner: int32 [parts], row of each part's object.
        tracks: authored animation of the parts.
        poses: authored transforms of the objects, and their animation.
        fps: frame k shows time k / fps.

    Attributes:
        histories: histories of the edited objects, by row.
        first_edit_frame: frame of the earliest edit; None: there is none.
    """

    def __init__(
        self,
        stage: SceneDescription,
        rows: Sequence[ObjectState],
        owner: NDArray[np.int32],
        tracks: AnimatedInstances,
        poses: AnimatedInstances,
        fps: float,
    ) -> None:
        self._stage = stage
        self._rows = list(rows)
        self._owner = owner
        self._tracks = tracks
        self._poses = poses
        self._fps = fps
        self._tracked = np.union1d(owner[tracks.rows], poses.rows)
        self._numbers = {each.prim_path: row for row, each in enumerate(stage.objects)}
        self._starts: dict[tuple[int, int], Array] = {}  # matrix of an animated object at the frame of a move
        self.histories: dict[int, StageObjectHistory] = {}
        self.first_edit_frame: int | None = None

    def settle(self, histories: Mapping[str, StageObjectHistory]) -> None:
        """Take the histories of edited objects, by prim path.

        Raises:
            ScenarioError: the stage has no such object.
        """
        for path in histories:
            if path not in self._numbers:
                hint = did_you_mean(path, self._numbers)
                raise ScenarioError(f"edits: no object {path!r} in scene {self._stage.name!r}{hint}")
        numbered = {self._numbers[path]: history for path, history in histories.items()}
        self.histories = dict(sorted(numbered.items()))
        moved = [history.moves[0].frame for history in histories.values() if history.moves]
        removed = [history.despawned for history in histories.values() if history.despawned is not None]
        self.first_edit_frame = min((*moved, *removed), default=None)

    def is_alive(self, number: int, frame: int) -> bool:
        """Return whether an object, by its row, is alive at a frame."""
        return number not in self.histories or self.histories[number].alive(frame, as_of=frame)

    def moved_by(self, number: int, frame: int, known: int, *, at_rest: bool = False) -> Array | None:
        """Return the 4x4 matrix by which edits moved an object, by its row; None if none did.

        A move takes the object from where its animation has it at that frame. The animation continues from there.

        Args:
            number: the object.
            frame: the frame.
            known: the frame up to which edits are known.
            at_rest: take it from its authored pose instead, for users that know no animation.
        """
        move = self.histories[number].move(frame, known) if number in self.histories else None
        if move is None:
            return None
        start = _matrix_of(self._rows[number]) if at_rest else self._start(number, move.frame)
        now = matrix(np.array([*move.position, *quaternion(move.rotation)]))
        result: Array = np.einsum("ij,jk->ik", now, np.linalg.inv(start))
        return result

    def _start(self, number: int, frame: int) -> Array:
        """Return the 4x4 matrix of an object, by its row, where a move at a frame finds it."""
        if number not in self._tracked:
            return _matrix_of(self._rows[number])
        if (number, frame) not in self._starts:
            self._starts[number, frame] = _matrix_of(self._posed(frame)[number] or self._rows[number])
        return self._starts[number, frame]

    def place(self, frame: int, seconds: Array, world: Array, present: NDArray[np.bool_]) -> None:
        """Write matrices and presence of the parts before, at and after a frame.

        Args:
            frame: k.
            seconds: the three times at which animation is evaluated, s.
            world: float64 [3, parts or more, 3, 4], written.
            present: bool [3, parts or more], written.
        """
        count = len(self._owner)
        for time, second in enumerate(seconds.tolist()):
            world[time, :count], present[time, :count] = self._tracks.at(second)
        for number, history in self.histories.items():
            parts = np.flatnonzero(self._owner == number)
            for time, step in enumerate((-1, 0, 1)):
                then = max(frame + step, 0)
                present[time, parts] &= history.alive(then, as_of=frame)
                by = self.moved_by(number, then, frame)
                if by is not None:
                    world[time, parts] = np.einsum("ij,pjk->pik", by[:3, :3], world[time, parts])
                    world[time, parts, :, 3] += by[:3, 3]

    def edited_parts(self, frame: int) -> NDArray[np.bool_]:
        """Return for every part whether an edit up to a frame has removed it, or moved it after frame 0."""
        edited = [number for number, history in self.histories.items() if not history.is_static(as_of=frame)]
        return np.isin(self._owner, edited)

    def rows(self, frame: int) -> list[ObjectState]:
        """Return the objects that are alive at a frame."""
        rows: list[ObjectState | None] = list(self._rows)
        if len(self._tracked):
            for number, posed in self._posed(frame).items():
                rows[number] = posed
        for number, history in self.histories.items():
            row, move = rows[number], history.move(frame, as_of=frame)
            if not history.alive(frame, as_of=frame):
                rows[number] = None
            elif row is not None and move is not None:
                rows[number] = self._moved(number, row, move, frame)
        return [row for row in rows if row is not None]

    def rotation(self, path: str, frame: int) -> tuple[float, ...]:
        """Return the rotation of an object at a frame; where it is hidden, that of its last move, or as authored.

        Args:
            path: its prim path.
            frame: the frame.
        """
        number = self._numbers[path]
        move = self.histories[number].move(frame, as_of=frame) if number in self.histories else None
        hidden = self._rows[number].rotation if move is None else move.rotation
        return next((each.rotation for each in self.rows(frame) if each.prim_path == path), hidden)

    def _moved(self, number: int, row: ObjectState, move: Move, frame: int) -> ObjectState:
        """Return an object that an edit has moved, given where it is without edits."""
        by = self.moved_by(number, frame, frame)
        if by is None or number not in self._tracked:
            w, x, y, z = quaternion(move.rotation).tolist()
            return replace(row, position=move.position, rotation=(w, x, y, z))
        pose = by @ _matrix_of(row)
        return replace(
            row,
            position=tuple(pose[:3, 3].tolist()),
            rotation=quaternion_from_matrix(pose[:3, :3]),
            velocity=tuple((by[:3, :3] @ row.velocity).tolist()),
        )

    def _posed(self, frame: int) -> dict[int, ObjectState | None]:
        """Return the animated objects at a frame, by row; None for one that is absent."""
        present = self._tracks.at(frame / self._fps)[1]
        there = np.bincount(self._owner[present], minlength=len(self._rows)) > 0
        now, after = (self._poses.at(each / self._fps)[0][self._tracked] for each in (frame, frame + 1))
        turned, authored = polar(now[:, :, :3])[0], self._poses.authored[self._tracked]
        rotations = quaternions(turned)
        scales = np.einsum("nji,njk,nkl->nil", turned, now[:, :, :3], inverted(authored)[0][:, :, :3])
        scales = np.einsum("nij,njk->nik", scales, polar(authored[:, :, :3])[0])  # since the start, in own axes
        velocities = (after[:, :, 3] - now[:, :, 3]) * self._fps
        result: dict[int, ObjectState | None] = {}
        scaled = (np.abs(scales - np.eye(3)) > 1e-9).any(axis=(1, 2)).tolist()
        poses = zip(now[:, :, 3].tolist(), rotations.tolist(), velocities.tolist(), scaled, scales, strict=True)
        for number, (position, rotation, velocity, is_scaled, scale) in zip(self._tracked.tolist(), poses, strict=True):
            posed = {"position": tuple(position), "rotation": tuple(rotation), "velocity": tuple(velocity)}
            row = self._rows[number]
            box = _scaled(row.box, scale) if is_scaled else row.box
            result[number] = replace(row, **posed, box=box) if there[number] else None
        return result

    def carries(self, path: str, frame: int) -> Array | None:
        """Return the 4x4 matrix by which edits moved the object that a prim is part of; None if it was removed."""
        while path:
            number = self._numbers.get(path, -1)
            if number in self.histories:
                by = self.moved_by(number, frame, frame)
                return None if not self.is_alive(number, frame) else np.eye(4) if by is None else by
            path = path.rpartition("/")[0]
        return np.eye(4)

    def instances(self, frame: int) -> tuple[list[Instance], list[bool]]:
        """Return the stage's instances, then its colliders, at a frame, and which of them are present."""
        instances: list[Instance] = []
        for instance in (*self._stage.instances, *self._stage.colliders):
            by = self.moved_by(instance.object, frame, frame, at_rest=True)
            if by is not None:
                instance = replace(instance, world_from_object=by @ instance.world_from_object)
            instances.append(instance)
        return instances, [self.is_alive(instance.object, frame) for instance in instances]


def _scaled(box: tuple[Vector3, Vector3], scale: Array) -> tuple[Vector3, Vector3]:
    """Return a box whose edges a 3x3 matrix scales."""
    low, high = np.array(box)
    middle, half = scale @ (0.5 * (low + high)), np.linalg.norm(scale, axis=0) * 0.5 * (high - low)
    return corners(np.stack([middle - half, middle + half]))


def _matrix_of(row: ObjectState) -> Array:
    return matrix(np.array([*row.position, *row.rotation]))


def matrix(pose: Array) -> Array:
    """Return the 4x4 matrix of a pose [7]: position and unit quaternion."""
    result = np.eye(4)
    result[:3, :3] = matrix_from_quaternion(pose[3:])
    result[:3, 3] = pose[:3]
    return result
