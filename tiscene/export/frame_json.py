# SPDX-License-Identifier: Apache-2.0
"""What a frame knows beside its pixels, as one JSON file: the camera, events, and the table of objects.

``labels/000012.json`` holds

- `index`, `time` (s), `spp`,
- `camera`: `name`, `position` (m), `rotation` (w, x, y, z), `K` (3x3, px, pixel centers at whole numbers) and
  `world_from_camera` (4x4; x right, y down, z forward), `width`, `height` (px),
- `events`: a row for each of `frame.events`, with the fields of `Event`,
- `objects`, if asked for: a row for each live object with the columns of `ObjectTable.columns` and the names of its
  `parts`; null stands for None.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tiscene.frame.frame import Frame


def encode(frame: Frame, objects: bool) -> dict[str, bytes]:
    """The file of a frame, name to contents."""
    text = json.dumps(frame_labels(frame, objects), allow_nan=False, separators=(",", ":"))
    return {f"labels/{frame.index:06d}.json": text.encode() + b"\n"}


def frame_labels(frame: Frame, objects: bool) -> dict[str, Any]:
    """The labels as JSON values. objects: with the rows of `frame.objects`, whose pixel counts cost some rays."""
    camera = frame.camera
    labels: dict[str, Any] = {
        "index": frame.index,
        "time": frame.time,
        "spp": frame.spp,
        "camera": {
            "name": camera.camera.name,
            "position": list(camera.position),
            "rotation": list(camera.rotation),
            "K": camera.K.tolist(),
            "world_from_camera": camera.world_from_camera.tolist(),
            "width": camera.width,
            "height": camera.height,
        },
        "events": [asdict(event) for event in frame.events],
    }
    if objects:
        columns = {name: column.tolist() for name, column in frame.objects.columns().items()}
        labels["objects"] = [
            {name: _plain(name, values[row]) for name, values in columns.items()} | {"parts": list(item.parts)}
            for row, item in enumerate(frame.objects)
        ]
    return labels


def _plain(name: str, value: Any) -> Any:
    """A cell as JSON: null where the row has None, which a column writes as nan or as the last frame -1."""
    if name == "last_frame" and value == -1:
        return None
    if isinstance(value, list):
        return None if any(math.isnan(number) for number in value) else value
    return None if isinstance(value, float) and math.isnan(value) else value
