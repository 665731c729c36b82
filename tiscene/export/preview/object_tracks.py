# SPDX-License-Identifier: Apache-2.0
"""ObjectTracks: what a page shows of objects over time, collected frame by frame."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from tiscene.frame.difficulty import MEASURES
from tiscene.frame.frame import Frame
from tiscene.frame.object_table import ObjectRow
from tiscene.frame.visualize import id_colors

MILLIMETER = 3  # decimals


class ObjectTracks:
    """Objects, camera and events of the frames of a page.

    Positions and bounds are those seen from above: x to the right and z downwards, m.
    """

    def __init__(self) -> None:
        self._count = 0
        self._objects: dict[int, dict[str, Any]] = {}
        self._events: list[list[dict[str, Any]]] = []
        self._cameras: list[list[float]] = []
        self._difficulty: dict[str, list[float | None]] = {name: [] for name in MEASURES}

    def add(self, frame: Frame) -> None:
        """Add the next frame."""
        for row in frame.objects:
            track = self._objects.get(row.id) or self._new_track(row)
            low, high = row.world_bounds.tolist()
            track["positions"].append(_rounded(row.position))
            track["bounds"].append(_rounded((low[0], low[2], high[0], high[2])))
            track["speeds"].append(round(float(np.linalg.norm(row.velocity)), MILLIMETER))
            track["pixels"].append(row.visible_pixels)
            track["visibility"].append(round(row.fraction_visible, 3) if row.visible_pixels else 0.0)
        self._count += 1
        for track in self._objects.values():
            for name in _COLUMNS:
                track[name] += [None] * (self._count - len(track[name]))  # gone
        self._events.append([asdict(event) for event in frame.events])
        position, forward = frame.camera.position, frame.camera.world_from_camera[:3, 2]
        half_width = 0.5 * frame.camera.width / float(frame.camera.K[0, 0])  # m; of a perspective camera at 1 m
        is_orthographic = frame.camera.camera.orthographic_height is not None
        self._cameras.append(_rounded((position[0], position[2], forward[0], forward[2], half_width, is_orthographic)))
        for name, value in frame.difficulty.to_json().items():
            self._difficulty[name].append(None if value is None else round(value, 3))

    def to_json(self) -> dict[str, Any]:
        """Return everything for the page's script. Columns that never change have one value."""
        for track in self._objects.values():
            track["moves"] = any(value != track["positions"][0] for value in track["positions"] if value is not None)
        objects = [
            {name: _packed(value) if name in _COLUMNS else value for name, value in track.items()}
            for track in self._objects.values()
        ]
        difficulty = {name: values for name, values in self._difficulty.items() if any(v is not None for v in values)}
        return {"objects": objects, "events": self._events, "cameraPath": self._cameras, "difficulty": difficulty}

    def _new_track(self, row: ObjectRow) -> dict[str, Any]:
        track = {
            "id": row.id,
            "name": row.name,
            "category": row.category,
            "template": row.template,
            "color": "#" + bytes(id_colors([row.id])[0]).hex(),
            **{name: [None] * self._count for name in _COLUMNS},
        }
        self._objects[row.id] = track
        return track


_COLUMNS = ("positions", "bounds", "speeds", "pixels", "visibility")


def _rounded(values: Any) -> list[float]:
    return [round(float(value), MILLIMETER) for value in values]


def _packed(values: list[Any]) -> list[Any]:
    return values[:1] if all(value == values[0] for value in values) else values
