# SPDX-License-Identifier: Apache-2.0
"""OpenEXR: one multi-part file per frame with one part per buffer, zip-compressed and without time stamps.

Parts have the names of the buffers.

================================  ==========  ==========================================================
buffer                            channels    type
================================  ==========  ==========================================================
`rgb`, `hdr`, `albedo`            R G B       half, scene-linear (`rgb` through the inverse sRGB curve)
`depth`, `distance`               Z           float, m; no hit is +inf
`semantic`, `instance`, `part`    id          uint
flows, `uv`                       U V         float
`coverage`, `material_coverage`   id0 weight0 float; id1 weight1 and so on, by descending weight
other vectors                     X Y Z       float
other scalars                     Y           float; masks are half, 1 is True
================================  ==========  ==========================================================

The bytes of `rgb` are recovered exactly: encode the half floats with the sRGB curve, multiply by 255 and round.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tiscene.export.array_files import Contents
from tiscene.scene.color import decode_srgb

if TYPE_CHECKING:
    from tiscene.frame.frame import Frame

COLORS = ("rgb", "hdr", "denoised", "albedo")
MAX_HALF = 65504.0


def encode(frame: Frame) -> dict[str, Contents]:
    """Return the file of a frame by its name."""
    return {f"{frame.index:06d}.exr": partial(_multi_part, frame.buffers)}


def _multi_part(buffers: Mapping[str, NDArray[Any]]) -> bytes:
    """Return buffers as the parts of a file."""
    return file_of({name: channels(name, buffer) for name, buffer in buffers.items()})


def file_of(parts: Mapping[str, dict[str, NDArray[Any]]]) -> bytes:
    """Return a file of parts by name, each with arrays [h, w] by the names of its channels."""
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    data = io.BytesIO()
    OpenEXR.File([OpenEXR.Part(dict(header), planes, name=name) for name, planes in parts.items()]).write(data)
    return data.getvalue()


def channels(name: str, buffer: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Return the channels of a buffer by name, as contiguous arrays [h, w]."""
    if name.endswith("coverage"):
        ranks = range(buffer.shape[2])
        pairs = {f"{name}{rank}": buffer[..., rank, k] for rank in ranks for k, name in enumerate(("id", "weight"))}
        return {channel: np.ascontiguousarray(plane) for channel, plane in pairs.items()}
    if name in COLORS:
        linear = _linear(buffer) if buffer.dtype == np.uint8 else np.asarray(buffer, dtype=np.float32)
        names, values = "RGB", np.minimum(linear, MAX_HALF).astype(np.float16)
    elif buffer.dtype == np.bool_:
        names, values = "Y", buffer.astype(np.float16)
    elif np.issubdtype(buffer.dtype, np.integer):
        return {"id": np.ascontiguousarray(buffer, dtype=np.uint32)}
    else:
        planes = 1 if buffer.ndim == 2 else buffer.shape[2]
        names = "Z" if name in ("depth", "distance") else {1: "Y", 2: "UV", 3: "XYZ"}[planes]
        values = np.asarray(buffer, dtype=np.float32)
    values = values.reshape(*buffer.shape[:2], -1)
    return {channel: np.ascontiguousarray(values[..., k]) for k, channel in enumerate(names)}


def _linear(srgb: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Decode 8-bit sRGB to scene-linear values 0..1."""
    return decode_srgb(np.arange(256) / 255.0).astype(np.float32)[srgb]
