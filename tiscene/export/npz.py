# SPDX-License-Identifier: Apache-2.0
"""NPZ: one NumPy archive per frame with every buffer unchanged, `numpy.load("000012.npz")["depth"]`.

Files have no time stamps, so that equal frames give equal bytes.
"""

from __future__ import annotations

import io
import zipfile
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tiscene.frame.frame import Frame

# The date of all members: the oldest one that a zip file can hold.
EPOCH = (1980, 1, 1, 0, 0, 0)


def encode(frame: Frame) -> dict[str, bytes]:
    """Return the file of a frame by its name."""
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as members:
        for name, buffer in frame.buffers.items():
            data = io.BytesIO()
            np.lib.format.write_array(data, np.ascontiguousarray(buffer), version=(1, 0), allow_pickle=False)
            member = zipfile.ZipInfo(f"{name}.npy", EPOCH)
            member.compress_type = zipfile.ZIP_DEFLATED
            member.create_system = 3  # Unix, on every platform
            members.writestr(member, data.getvalue(), compresslevel=4)
    return {f"{frame.index:06d}.npz": archive.getvalue()}
