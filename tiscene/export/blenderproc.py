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
from typing import TYPE_CHECKING

import numpy as np

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


def encode(frame: Frame) -> dict[str, bytes]:
    """Return the file of a frame by its name."""
    import h5py

    data = io.BytesIO()
    with h5py.File(data, "w") as file:
        for name, buffer in frame.buffers.items():
            array = buffer
            if name == "normal_camera":
                array = (0.5 + 0.5 * buffer * np.array((1.0, -1.0, -1.0), np.float32)).astype(np.float32)
            file.create_dataset(
                KEYS.get(name, name), data=array, compression="gzip", compression_opts=1, track_times=False
            )
        if "instance" in frame.buffers:
            attributes = [
                {"idx": row.id, "category_id": row.category_id, "name": row.name, "category": row.category}
                for row in frame.objects
            ]
            file.create_dataset("instance_attribute_maps", data=json.dumps(attributes).encode(), track_times=False)
    return {f"{frame.index}.hdf5": data.getvalue()}
