# SPDX-License-Identifier: Apache-2.0
"""Tiles of panoramas on disk, which several processes may share.

Each process appends the tiles that it traces to a file of its own, as records of one size: digest, number of the tile,
cells. Records that are torn or damaged are left out when they are read.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
from pathlib import Path
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

from tiscene.files import DiskCache
from tiscene.render.integrators.panorama.panorama_kernels import TILE

SIZE_LIMIT = 1 << 30  # bytes; the least recently used files are deleted first
_SUFFIX = ".tiles"
_ROOM = 1 << 26  # bytes that room is made for at once
_DIGEST = 16  # bytes


class TileFiles:
    """Traced tiles in one folder.

    Args:
        folder: The folder; None: `cache_folder()`.
        size_limit: Limit of the files' size, bytes.
    """

    def __init__(self, folder: Path | None = None, size_limit: int = SIZE_LIMIT) -> None:
        self._files = DiskCache(_SUFFIX, size_limit, folder)
        self.folder = self._files.folder
        self._name = f"{os.getpid()}-{uuid4().hex[:8]}{_SUFFIX}"
        self._room = 0

    def load(self, key: str, columns: int) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Return the tiles of a panorama that are on disk.

        Args:
            key: Of the panorama.
            columns: Columns of its cells.

        Returns:
            int32 [n], numbers of the tiles, increasing; float32 [n, TILE * TILE, columns], their cells.
        """
        record = _record(columns)
        found: dict[int, NDArray[np.float32]] = {}
        for path in sorted(self.folder.glob(f"{key}-*{_SUFFIX}")):
            with contextlib.suppress(OSError):
                content = path.read_bytes()
                os.utime(path)
                for row in np.frombuffer(content, record, len(content) // record.itemsize):
                    if row["digest"].tobytes() == _digest(row["tile"], row["cells"]):
                        found[int(row["tile"])] = row["cells"]
        tiles = np.array(sorted(found), np.int32)
        cells = np.array([found[tile] for tile in tiles], np.float32).reshape(-1, TILE * TILE, columns)
        return tiles, cells

    def append(self, key: str, tiles: NDArray[np.int32], cells: NDArray[np.float32]) -> None:
        """Store tiles. Does nothing if the folder is not writable.

        Args:
            key: Of the panorama.
            tiles: int32 [n], numbers of the tiles.
            cells: float32 [n, TILE * TILE, columns], their cells.
        """
        records = np.empty(len(tiles), _record(cells.shape[2]))
        records["tile"], records["cells"] = tiles, cells
        for row in records:
            row["digest"] = np.frombuffer(_digest(row["tile"], row["cells"]), f"V{_DIGEST}")[0]
        with contextlib.suppress(OSError):
            if self._room < records.nbytes:
                self.folder.mkdir(parents=True, exist_ok=True)
                self._room = max(_ROOM, records.nbytes)
                self._files.make_room(self._room)
            self._room -= records.nbytes
            with (self.folder / f"{key}-{self._name}").open("ab") as file:
                end = file.tell()
                try:
                    file.write(records.tobytes())
                    file.flush()
                except OSError:
                    file.truncate(end)
                    raise


def _record(columns: int) -> np.dtype[np.void]:
    """Return the type of a record."""
    return np.dtype([("digest", f"V{_DIGEST}"), ("tile", "<i4"), ("cells", "<f4", (TILE * TILE, columns))])


def _digest(tile: np.int32, cells: NDArray[np.float32]) -> bytes:
    """Return the digest of a record's content."""
    return hashlib.blake2b(tile.tobytes() + cells.tobytes(), digest_size=_DIGEST).digest()
