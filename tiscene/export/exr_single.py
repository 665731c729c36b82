# SPDX-License-Identifier: Apache-2.0
"""Single-part OpenEXR: one folder per buffer, one file per frame, for readers that know no multi-part files (OpenCV).

================================  ========================================================================
buffer                            channels
================================  ========================================================================
colors, normals, other vectors    R G B (x y z); colors as half, others as float
flows, `uv`                       R G (x y), and B, which is 0
ids                               Y, uint
depth, other scalars              Y, float; masks are half, 1 is True
`coverage`, `material_coverage`   id0 weight0, id1 weight1 and so on, float
================================  ========================================================================

Values are those of the multi-part format (`exr`).
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tiscene.export.array_files import Contents
from tiscene.export.exr import channels, file_of

if TYPE_CHECKING:
    from tiscene.frame.frame import Frame

_NAMES = {"X": "R", "Y": "G", "Z": "B", "U": "R", "V": "G"}


def encode(frame: Frame) -> dict[str, Contents]:
    """Return the files of a frame by name."""
    return {
        f"{name}/{frame.index:06d}.exr": partial(_single_part, name, buffer) for name, buffer in frame.buffers.items()
    }


def _single_part(name: str, buffer: NDArray[Any]) -> bytes:
    """Return a buffer as a file."""
    return file_of({name: _renamed(channels(name, buffer))})


def _renamed(planes: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return channels by the names that readers of pictures look for."""
    if len(planes) == 1:
        return {"Y": next(iter(planes.values()))}
    if not set(planes) <= set(_NAMES):
        return planes
    renamed = {_NAMES[name]: plane for name, plane in planes.items()}
    return renamed if "B" in renamed else renamed | {"B": np.zeros_like(renamed["R"])}
