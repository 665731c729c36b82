# SPDX-License-Identifier: Apache-2.0
"""Detect what happened to the objects of a world between two frames: spawns, despawns, contacts and overlaps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Literal

from tiscene.frame.events import Event
from tiscene.scenario.edits import ObjectHistory, StageObjectHistory
from tiscene.scene.description import SceneDescription
from tiscene.world.trajectories import WALLS, Collision


def detect_changes(
    frame: int,
    stage: SceneDescription,
    stage_histories: Mapping[int, StageObjectHistory],
    histories: Mapping[int, ObjectHistory],
    collisions: Iterable[Collision],
    overlaps: Iterable[Collision],
) -> tuple[Event, ...]:
    """Return the events between frames `frame - 1` and `frame` that no camera is needed for.

    Args:
        frame: k, 0 or more.
        stage: the stage; its objects have the ids 1 to n.
        stage_histories: edits of the stage's objects, by their row in `stage.objects`.
        histories: the scenario's objects that are alive now or were so at the frame before, by row; their ids are
            n + 1 + row.
        collisions: collisions of the scenario's objects since the frame before.
        overlaps: what objects of the scenario were placed inside of at `frame`.

    Returns:
        Spawns and despawns by object id, then contacts and overlaps in their order.
    """
    first_id = len(stage.objects) + 1
    lifecycle = [Event("despawn", row + 1) for row, each in stage_histories.items() if each.despawned == frame]
    for row, history in histories.items():
        alive = history.alive(frame, as_of=frame)
        if alive != (frame > 0 and history.alive(frame - 1, as_of=frame - 1)):
            lifecycle.append(Event("spawn" if alive else "despawn", first_id + row))
    lifecycle.sort(key=lambda event: event.object)
    contacts = [_meeting("contact", each, stage, first_id) for each in collisions]
    return (*lifecycle, *contacts, *(_meeting("overlap", each, stage, first_id) for each in overlaps))


def _meeting(
    kind: Literal["contact", "overlap"], collision: Collision, stage: SceneDescription, first_id: int
) -> Event:
    id = first_id + collision.number
    if collision.kind == "wall":
        return Event(kind, id, surface=WALLS[collision.other])
    if collision.kind == "collider":
        return Event(kind, id, surface=stage.colliders[collision.other].prim_path)
    return Event(kind, id, (1 if collision.kind == "stage" else first_id) + collision.other)
