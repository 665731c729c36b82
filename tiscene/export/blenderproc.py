# SPDX-License-Identifier: Apache-2.0
"""BlenderProc's HDF5: one file per frame, `h5py.File("12.hdf5")["colors"]`.

=====================  ==========================================================================================
buffer                 key
=====================  ==========================================================================================
`rgb`                  `colors`
`semantic`             `class_segmaps`
`instance`             `instance_segmaps`; `instance_attribute_maps` has a JSON list of `idx`, `category_id`, `name`
`normal_camera`        `normals`: 0.5 + 0.5 n, in Blender's camera axes (x right, y up, z backward)
`object_coordinates`   `nocs`
`albedo`               `diffuse`
all others             the buffer's name, such as `depth`, `distance`, `forward_flow`
=====================  ==========================================================================================

Arrays are exact but for `normals`, and gzip-compressed. Nothing hit is infinite in `depth` and `distance`.
"""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tiscene.export.array_files import Contents

if TYPE_CHECKING:
    from tiscene.frame.frame import Frame

KEYS = {
    "rgb": "colors",
    "semantic": "class_segmaps",
    "instance": "instance_segmaps",
    "normal_camera": "normals",
    "object_coordinates": "nocs",
    "albedo": "diffuse",
}


def encode(frame: Frame) -> dict[str, Contents]:
    """Return the file of a frame by its name."""
    attributes = None
    if "instance" in frame.buffers:
        attributes = [
            {"idx": row.id, "category_id": row.category_id, "name": row.name, "category": row.category}
            for row in frame.objects
        ]
    return {f"{frame.index}.hdf5": partial(_file, frame.buffers, attributes)}


def _file(buffers: Mapping[str, NDArray[Any]], attributes: list[dict[str, Any]] | None) -> bytes:
    """Return a file of buffers, and of the attributes of the ids in `instance`."""
    import h5py

    data = io.BytesIO()
    with h5py.File(data, "w") as file:
        for name, buffer in buffers.items():
            array = buffer
            if name == "normal_camera":
                array = (0.5 + 0.5 * buffer * np.array((1.0, -1.0, -1.0), np.float32)).astype(np.float32)
            file.create_dataset(
                KEYS.get(name, name),
                data=array,
                chunks=array.shape,
                compression="gzip",
                compression_opts=1,
                shuffle=True,
                track_times=False,
            )
        if attributes is not None:
            file.create_dataset("instance_attribute_maps", data=json.dumps(attributes).encode(), track_times=False)
    return data.getvalue()
