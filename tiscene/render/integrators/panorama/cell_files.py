# SPDX-License-Identifier: Apache-2.0
"""Groups of cells of panoramas on disk, which several processes may share.

Each process appends the groups that it makes to a file of its own, as records of one size: digest, number of the group,
cells. Records that are torn or damaged are left out when they are read.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
from pathlib import Path
from typing import TypeVar
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

from tiscene.files import DiskCache

Value = TypeVar("Value", np.float32, np.int32)

SIZE_LIMIT = 1 << 32  # bytes; the least recently used files are deleted first
_SUFFIX = ".cells"
_ROOM = 1 << 26  # bytes that room is made for at once
_DIGEST = 16  # bytes


class CellFiles:
    """Groups of cells in one folder.

    Args:
        folder: The folder; None: `cache_folder()`.
        size_limit: Limit of the files' size, bytes.
    """

    def __init__(self, folder: Path | None = None, size_limit: int = SIZE_LIMIT) -> None:
        self._files = DiskCache(_SUFFIX, size_limit, folder)
        self.folder = self._files.folder
        self._name = f"{os.getpid()}-{uuid4().hex[:8]}{_SUFFIX}"
        self._room = 0

    def load(self, key: str, size: int, columns: int, kind: type[Value]) -> tuple[NDArray[np.int32], NDArray[Value]]:
        """Return the groups of a panorama that are on disk.

        Args:
            key: Of the panorama and the kind of group.
            size: Cells of a group.
            columns: Columns of a cell.
            kind: Type of their values, of four bytes.

        Returns:
            int32 [n], numbers of the groups, increasing; [n, size, columns], their cells.
        """
        record = _record(size, columns, kind)
        found: dict[int, NDArray[Value]] = {}
        for path in sorted(self.folder.glob(f"{key}-*{_SUFFIX}")):
            with contextlib.suppress(OSError):
                content = path.read_bytes()
                os.utime(path)
                for row in np.frombuffer(content, record, len(content) // record.itemsize):
                    if row["digest"].tobytes() == _digest(row["group"], row["cells"]):
                        found[int(row["group"])] = row["cells"]
        groups = np.array(sorted(found), np.int32)
        cells = np.array([found[group] for group in groups], kind).reshape(-1, size, columns)
        return groups, cells

    def append(self, key: str, groups: NDArray[np.int32], cells: NDArray[Value]) -> None:
        """Store groups. Does nothing if the folder is not writable.

        Args:
            key: Of the panorama and the kind of group.
            groups: int32 [n], numbers of the groups.
            cells: float32 or int32 [n, size, columns], their cells.
        """
        records = np.empty(len(groups), _record(cells.shape[1], cells.shape[2], cells.dtype.type))
        records["group"], records["cells"] = groups, cells
        for row in records:
            row["digest"] = np.frombuffer(_digest(row["group"], row["cells"]), f"V{_DIGEST}")[0]
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


def _record(size: int, columns: int, kind: type[Value]) -> np.dtype[np.void]:
    """Return the type of a record."""
    value = np.dtype(kind).newbyteorder("<")
    return np.dtype([("digest", f"V{_DIGEST}"), ("group", "<i4"), ("cells", value, (size, columns))])


def _digest(group: np.int32, cells: NDArray[Value]) -> bytes:
    """Return the digest of a record's content."""
    return hashlib.blake2b(group.tobytes() + cells.tobytes(), digest_size=_DIGEST).digest()
