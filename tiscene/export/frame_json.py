# SPDX-License-Identifier: Apache-2.0
"""The metadata of a frame as one JSON file: camera, events and object table.

`labels/000012.json` holds

- `index`, `time` (s), `spp`,
- `camera`: `name`, `position` (m), `rotation` (w, x, y, z), `projection`, `K` (3x3, px, pixel centers at whole numbers)
  and `world_from_camera` (4x4; x right, y down, z forward), `width`, `height` (px). A point (x, y, z) of the camera is
  at K (x/z, y/z, 1) if the projection is "perspective", at K (x, y, 1) if it is "orthographic",
- `events`: one row for each of `frame.events`, with the fields of `Event`,
- `objects`, if requested: one row for each selected object, with the columns of `ObjectTable.columns` and the names of
  its `parts`; null for None.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tiscene.frame.frame import Frame
    from tiscene.frame.object_table import ObjectRow

OBJECT_SELECTIONS = ("moving", "visible", "all")


def encode(frame: Frame, objects: str | None) -> dict[str, bytes]:
    """Return the file of a frame by its name."""
    return {f"labels/{frame.index:06d}.json": labels_bytes(frame_labels(frame, objects)) + b"\n"}


def labels_bytes(labels: dict[str, Any]) -> bytes:
    """Return the metadata of a frame as JSON on one line."""
    return json.dumps(labels, allow_nan=False, separators=(",", ":")).encode()


def frame_labels(frame: Frame, objects: str | None) -> dict[str, Any]:
    """Return the metadata of a frame as JSON values.

    Args:
        frame: The frame.
        objects: Which rows of `frame.objects` are included, one of OBJECT_SELECTIONS (see `tiscene.export.export`);
            None for no table. Amodal pixel counts cost extra rays.
    """
    camera = frame.camera
    labels: dict[str, Any] = {
        "index": frame.index,
        "time": frame.time,
        "spp": frame.spp,
        "camera": {
            "name": camera.camera.name,
            "position": list(camera.position),
            "rotation": list(camera.rotation),
            "projection": "perspective" if camera.camera.orthographic_height is None else "orthographic",
            "K": camera.K.tolist(),
            "world_from_camera": camera.world_from_camera.tolist(),
            "width": camera.width,
            "height": camera.height,
        },
        "events": [asdict(event) for event in frame.events],
    }
    if objects is not None:
        columns = {name: column.tolist() for name, column in frame.objects.arrays().items()}
        labels["objects"] = [
            {name: _json_cell(name, values[row]) for name, values in columns.items()} | {"parts": list(item.parts)}
            for row, item in enumerate(frame.objects)
            if _is_selected(item, objects)
        ]
    return labels


def _is_selected(row: ObjectRow, selection: str) -> bool:
    match selection:
        case "moving":
            return bool(row.template) or any(row.velocity)
        case "visible":
            return row.visible_pixels > 0
    return True


def _json_cell(name: str, value: Any) -> Any:
    """Return a cell of a column as JSON: null for nan, and for -1 in `last_frame`."""
    if name == "last_frame" and value == -1:
        return None
    if isinstance(value, list):
        return None if any(math.isnan(number) for number in value) else value
    return None if isinstance(value, float) and math.isnan(value) else value
