# SPDX-License-Identifier: Apache-2.0
"""NPZ: one NumPy archive per frame with every buffer unchanged, `numpy.load("000012.npz")["depth"]`.

Files have no time stamps, so that equal frames give equal bytes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tiscene.export.array_files import Contents, archive, npy

if TYPE_CHECKING:
    from tiscene.frame.frame import Frame


def encode(frame: Frame) -> dict[str, Contents]:
    """Return the file of a frame by its name."""
    buffers = frame.buffers
    return {f"{frame.index:06d}.npz": lambda: archive({f"{name}.npy": npy(buffer) for name, buffer in buffers.items()})}
