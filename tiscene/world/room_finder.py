# SPDX-License-Identifier: Apache-2.0
"""RoomFinder: the room that each object is in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynamics.rotation import matrix_from_quaternion
from tiscene.frame.object_table import ObjectState
from tiscene.scene.room_volume import RoomVolume, rooms_at


class RoomFinder:
    """Assigns rooms to objects by the centers of their boxes.

    Most objects rest: those that are the same Python object as before are not looked up again.

    Args:
        volumes: the volumes of rooms on the stage.
    """

    def __init__(self, volumes: Sequence[RoomVolume]) -> None:
        self._volumes = volumes
        self._known: dict[int, tuple[ObjectState, ObjectState]] = {}  # by id: an object without and with its room

    def assign(self, objects: Sequence[ObjectState]) -> list[ObjectState]:
        """Return objects with their rooms."""
        if not self._volumes:
            return list(objects)
        changed = [each for each in objects if self._known.get(each.id, (None,))[0] is not each]
        if changed:
            boxes, poses = (
                np.array([each.box for each in changed]),
                np.array([(*each.position, *each.rotation) for each in changed]),
            )
            turned = np.einsum("nij,nj->ni", matrix_from_quaternion(poses[:, 3:]), boxes.mean(axis=1))
            if len(self._known) > 2 * len(objects):  # objects that are gone
                alive = {each.id for each in objects}
                self._known = {id: pair for id, pair in self._known.items() if id in alive}
            for each, room in zip(changed, rooms_at(self._volumes, poses[:, :3] + turned), strict=True):
                self._known[each.id] = each, replace(each, room=room)
        return [self._known[each.id][1] for each in objects]
