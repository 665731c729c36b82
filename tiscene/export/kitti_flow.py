# SPDX-License-Identifier: Apache-2.0
"""KITTI's optical flow: pairs of pictures, and flow as 16-bit RGB PNG with a valid channel.

=======================  ==========================================================================================
`image_2/000012_10.png`  frame 12
`image_2/000012_11.png`  frame 13, the second picture of the pair; written with frame 13, unless that is the first frame
`flow_occ/000012_10.png` flow from frame 12 to 13, of all pixels whose point is in frame 13's picture or hidden there
`flow_noc/000012_10.png` the same without occluded pixels
`occlusions/000012.png`  8-bit gray, 255 where the point is not visible in frame 13
=======================  ==========================================================================================

Red is 64 dx + 2^15, green is 64 dy + 2^15, blue is 1 where the flow is valid: -512 px to 511.98 px in steps of 1/64.
Longer flow is not valid. KITTI's readers pair files by their order: frames must be consecutive, and the last one has a
flow without a second picture (Geiger et al., "Vision meets Robotics", 2013; the development kit of KITTI 2015).
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Collection
from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import ExportError
from tiscene.export.array_files import Contents, png
from tiscene.export.png import mask8

if TYPE_CHECKING:
    from tiscene.frame.frame import Frame

SCALE, OFFSET = 64.0, 32768.0


def check_frames(frames: Collection[int]) -> None:
    """Raise ExportError unless frames are consecutive: flow goes from each to the next one."""
    first, last, count = min(frames, default=0), max(frames, default=-1), len(set(frames))
    if last - first + 1 != count:
        raise ExportError(
            f"format 'kitti-flow' writes pairs of consecutive frames, and these are {count} of the frames {first} to "
            f"{last}: export {first}:{last + 1} without a step (--frames {first}:{last + 1}), or another format"
        )


def of_previous(index: int) -> tuple[str, ...]:
    """Return the name of the second picture of the pair that begins with the frame before."""
    return (f"image_2/{index - 1:06d}_11.png",) if index > 0 else ()


def encode(frame: Frame) -> dict[str, Contents]:
    """Return the files of a frame by name."""
    flow, occlusion = frame.forward_flow, frame.forward_occlusion
    picture, name = cache(partial(png, frame.rgb)), f"{frame.index:06d}"
    files: dict[str, Contents] = {
        f"image_2/{name}_10.png": picture,
        f"flow_occ/{name}_10.png": lambda: png48(kitti(flow)),
        f"flow_noc/{name}_10.png": lambda: png48(kitti(flow, ~occlusion)),
        f"occlusions/{name}.png": lambda: png(mask8(occlusion)),
    }
    return files | dict.fromkeys(of_previous(frame.index), picture)


def kitti(flow: NDArray[np.float32], valid: NDArray[np.bool_] | None = None) -> NDArray[np.uint16]:
    """Return flow in KITTI's encoding: uint16 [h, w, 3].

    Args:
        flow: float32 [h, w, 2], px.
        valid: bool [h, w], pixels to keep; None: all whose flow can be represented.
    """
    # Scaling by a power of two is exact, and the offset is even: both leave the rounding of ties as it is.
    steps = np.rint(flow * np.float32(SCALE))
    low, high = -OFFSET, 65535.0 - OFFSET
    inside = (steps >= low) & (steps <= high)  # False for nan
    valid = inside[..., 0] & inside[..., 1] & (True if valid is None else valid)
    encoded = np.empty((*flow.shape[:2], 3), np.uint16)
    for axis in range(2):
        encoded[..., axis] = np.where(valid, steps[..., axis] + np.float32(OFFSET), np.float32(0.0))
    encoded[..., 2] = valid
    return encoded


def png48(pixels: NDArray[np.uint16]) -> bytes:
    """Return a picture with 16 bits a channel as PNG, which Pillow cannot write (PNG specification, third edition).

    Args:
        pixels: uint16 [h, w, 3].
    """
    height, width, _ = pixels.shape
    rows = pixels.astype(">u2").view(np.uint8).reshape(height, width * 6)
    filtered = np.empty((height, 1 + width * 6), np.uint8)
    filtered[:, 0] = 2  # "up": each byte minus the one above
    filtered[0, 1:] = rows[0]
    filtered[1:, 1:] = rows[1:] - rows[:-1]
    header = struct.pack(">IIBBBBB", width, height, 16, 2, 0, 0, 0)
    chunks = (b"IHDR", header), (b"IDAT", zlib.compress(filtered.tobytes(), 4)), (b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks
    )
