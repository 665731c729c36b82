# SPDX-License-Identifier: Apache-2.0
"""PNG and other simple formats: one folder per buffer, one file per frame.

======================================  ==================================================================
`rgb`                                   8-bit RGB PNG
`semantic`, `instance`, `part`          16-bit gray PNG of the ids, 0 is the background
`depth`, `distance`                     16-bit gray PNG in mm; 0: no hit, 65535: 65.535 m or farther
`forward_flow`, `backward_flow`         Middlebury .flo: float32 (dx, dy) in px, little endian
the occlusion masks                     8-bit gray PNG, 255 is True
every other buffer (float32)            .npy, unchanged
======================================  ==================================================================
"""

from __future__ import annotations

import struct
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import ExportError, export_errors
from tiscene.export.array_files import Contents, npy, png
from tiscene.files import write_atomically

if TYPE_CHECKING:
    from tiscene.frame.frame import Frame

FLO_TAG = 202021.25  # the magic number of .flo files; its bytes are "PIEH"


def encode(frame: Frame) -> dict[str, Contents]:
    """Return the files of a frame by name. They raise ExportError for an id beyond unsigned 16 bits."""
    files: dict[str, Contents] = {}
    for name, buffer in frame.buffers.items():
        suffix, data = encoded_buffer(name, buffer)
        files[f"{name}/{frame.index:06d}{suffix}"] = data
    return files


def encoded_buffer(name: str, buffer: NDArray[Any]) -> tuple[str, Contents]:
    """Return suffix and contents of the file of a buffer."""
    if buffer.dtype == np.uint8:
        return ".png", partial(png, buffer)
    if buffer.dtype == np.bool_:
        return ".png", lambda: png(mask8(buffer))
    if np.issubdtype(buffer.dtype, np.integer):
        return ".png", lambda: png(ids16(name, buffer))
    if name in ("depth", "distance"):
        return ".png", lambda: png(millimeters(buffer))
    if name in ("forward_flow", "backward_flow"):
        return ".flo", partial(flo, buffer)
    return ".npy", partial(npy, buffer)


def mask8(mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return a mask as 8-bit gray: 255 is True."""
    return mask.view(np.uint8) * np.uint8(255)


def ids16(name: str, buffer: NDArray[Any]) -> NDArray[np.uint16]:
    """Return ids as unsigned 16 bits. Raises ExportError for an id beyond them."""
    low, high = int(buffer.min(initial=0)), int(buffer.max(initial=0))
    if low < 0 or high > 65535:
        id = low if low < 0 else high
        raise ExportError(f"buffer {name!r} has the id {id}; this format holds ids 0..65535: export as exr or npz")
    return buffer.astype(np.uint16)


def write_png(path: str | Path, pixels: NDArray[np.uint8]) -> None:
    """Write an image, uint8 [h, w, 3]. Raises ExportError if the file cannot be written."""
    with export_errors(path):
        write_atomically(Path(path), png(pixels))


def millimeters(meters: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Round to millimeters. A hit closer than half a millimeter becomes 1, since 0 means no hit."""
    hit = np.isfinite(meters)
    rounded = np.clip(np.round(np.where(hit, meters, 0.0).astype(np.float64) * 1000.0), 1.0, 65535.0)
    return np.where(hit, rounded, 0.0).astype(np.uint16)


def flo(flow: NDArray[np.float32]) -> bytes:
    """Return flow as a Middlebury .flo file."""
    height, width, _ = flow.shape
    return struct.pack("<fii", FLO_TAG, width, height) + flow.astype("<f4").tobytes()
