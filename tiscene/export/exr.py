# SPDX-License-Identifier: Apache-2.0
"""One multi-part OpenEXR file a frame, one part a buffer, named as the buffer, zip-compressed and without time stamps.

================================  ==========  ==========================================================
buffer                            channels    type
================================  ==========  ==========================================================
`rgb`, `hdr`, `albedo`            R G B       half, scene-linear (`rgb` through the inverse sRGB curve)
`depth`, `distance`               Z           float, m; no hit is +inf
`semantic`, `instance`, `part`    id          uint
flows, `uv`                       U V         float
`coverage`, `material_coverage`   id0 weight0 float; id1 weight1 and so on, the most first
other vectors                     X Y Z       float
other scalars                     Y           float; masks half, 1 is True
================================  ==========  ==========================================================

The half `rgb` gives back the very bytes: decode with the sRGB curve, times 255, rounded.
"""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.color import decode_srgb

if TYPE_CHECKING:
    from tiscene.frame.frame import Frame

COLORS = ("rgb", "hdr", "denoised", "albedo")
LARGEST_HALF = 65504.0


def encode(frame: Frame) -> dict[str, bytes]:
    """The files of a frame, name to contents."""
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    parts = [OpenEXR.Part(dict(header), channels(name, buffer), name=name) for name, buffer in frame.buffers.items()]
    data = io.BytesIO()
    OpenEXR.File(parts).write(data)
    return {f"{frame.index:06d}.exr": data.getvalue()}


def channels(name: str, buffer: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Channel names to contiguous arrays [h, w] of the channel's type."""
    if name.endswith("coverage"):
        ranks = range(buffer.shape[2])
        pairs = {f"{what}{rank}": buffer[..., rank, k] for rank in ranks for k, what in enumerate(("id", "weight"))}
        return {channel: np.ascontiguousarray(plane) for channel, plane in pairs.items()}
    if name in COLORS:
        linear = _linear(buffer) if buffer.dtype == np.uint8 else np.asarray(buffer, dtype=np.float32)
        names, values = "RGB", np.minimum(linear, LARGEST_HALF).astype(np.float16)
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
    """Display bytes as scene-linear values 0..1."""
    return decode_srgb(np.arange(256) / 255.0).astype(np.float32)[srgb]
