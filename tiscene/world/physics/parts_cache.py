# SPDX-License-Identifier: Apache-2.0
"""Convex parts on disk: a room's are computed once, by the first process that needs them."""

from __future__ import annotations

import hashlib
import json
import platform
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.files import DiskCache
from tiscene.world.physics.convex_parts import convex_parts
from tiscene.world.physics.part_shapes import PartShape

SIZE_LIMIT = 1 << 28  # bytes
_SUFFIX = ".parts"


class PartsCache:
    """Convex parts of several surfaces, in one file.

    Args:
        key: A digest of what the surfaces belong to, such as a stage's meshes.

    Attributes:
        is_new: Whether something was computed that is not on disk yet.
    """

    def __init__(self, key: bytes) -> None:
        self._files = DiskCache(_SUFFIX, SIZE_LIMIT)
        self._key = hashlib.sha256(_program_digest() + key).hexdigest()
        data = self._files.load(self._key)
        self._known: dict[str, list[PartShape]] = {} if data is None else _unpacked(data)
        self.is_new = False

    def parts(self, triangles: NDArray[np.float64], tolerance: float, thickness: float) -> list[PartShape]:
        """Return the parts of a surface; arguments as of `convex_parts`."""
        digest = hashlib.sha256(np.array([tolerance, thickness]).tobytes() + np.ascontiguousarray(triangles).tobytes())
        name = digest.hexdigest()
        if name not in self._known:
            self._known[name] = convex_parts(triangles, tolerance, thickness)
            self.is_new = True
        return self._known[name]

    def save(self) -> None:
        """Write what was computed."""
        if self.is_new:
            self._files.save(self._key, _packed(self._known))
            self.is_new = False


def _packed(known: dict[str, list[PartShape]]) -> bytes:
    """Return parts as a line of JSON (kinds, numbers of points, axes) and all their numbers."""
    heads = {name: [[part.kind, len(part.points), part.axis] for part in parts] for name, parts in known.items()}
    numbers = [
        np.concatenate([part.center, part.half, part.points.ravel()]) for parts in known.values() for part in parts
    ]
    return json.dumps(heads).encode() + b"\n" + np.concatenate([np.zeros(0), *numbers]).astype("<f8").tobytes()


def _unpacked(data: bytes) -> dict[str, list[PartShape]]:
    line, _, rest = data.partition(b"\n")
    heads: dict[str, list[Any]] = json.loads(line)
    numbers, at = np.frombuffer(rest, "<f8").astype(np.float64), 0
    known: dict[str, list[PartShape]] = {}
    for name, parts in heads.items():
        known[name] = []
        for kind, count, axis in parts:
            points = numbers[at + 6 : at + 6 + 3 * count].reshape(count, 3)
            known[name].append(PartShape(kind, numbers[at : at + 3], numbers[at + 3 : at + 6], points, axis))
            at += 6 + 3 * count
    return known


@cache
def _program_digest() -> bytes:
    """Return a digest of the code and of the libraries that the parts depend on."""
    import scipy

    digest = hashlib.sha256(f"{platform.machine()} {np.__version__} {scipy.__version__}".encode())
    for name in ("convex_parts.py", "part_shapes.py"):
        digest.update((Path(__file__).parent / name).read_bytes())
    return digest.digest()
