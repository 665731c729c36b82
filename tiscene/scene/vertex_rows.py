# SPDX-License-Identifier: Apache-2.0
"""Rows of the arrays that all meshes of a scene share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.description import Mesh


def color_rows(meshes: Sequence[Mesh], first: int) -> tuple[list[NDArray[np.float32]], NDArray[np.int64]]:
    """Return rows of `vertex_uv` with second uv and colors, from row `first` on, and the first row of each mesh."""
    blocks, starts = [], []
    for mesh in meshes:
        starts.append(first)
        if mesh.colors is not None and mesh.second_uv is not None:
            blocks.append(np.concatenate([mesh.second_uv, mesh.colors], axis=1).reshape(-1, 2))
            first += len(blocks[-1])
    return blocks, np.array(starts, np.int64)


def stack_rows(parts: list[Any], width: int, dtype: Any) -> NDArray[Any]:
    """Return arrays [n, width] below each other."""
    return np.concatenate([np.zeros((0, width), dtype), *(np.asarray(part, dtype) for part in parts)])
