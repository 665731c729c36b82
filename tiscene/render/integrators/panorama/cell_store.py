# SPDX-License-Identifier: Apache-2.0
"""Groups of cells of one panorama, tiles or blocks, in the device's memory and on disk."""

from __future__ import annotations

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.memory import copy_rows, device_array
from tiscene.render.integrators.panorama import panorama_kernels as kernels
from tiscene.render.integrators.panorama.cell_files import CellFiles
from tiscene.render.integrators.panorama.packed_cells import pack, words

_FIRST_CELLS = 1 << 16  # that there is room for at first


class CellStore:
    """Groups of cells, by their place on the cube.

    Args:
        shape: Faces, and groups along the sides of a face.
        size: Cells of a group.
        columns: Columns of a cell.
        files: Groups on disk; None: none.
        key: Digest of everything that the cells depend on, which names the files.

    Attributes:
        slots: int32 [shape], place of each group in `cells`, in groups; -1 if it is not there.
        cells: i32 [places * size, words] on the device, see `packed_cells`.
        columns: Columns of a cell.
    """

    def __init__(self, shape: tuple[int, int, int], size: int, columns: int, files: CellFiles | None, key: str) -> None:
        self.slots = np.full(shape, -1, np.int32)
        self.columns = columns
        self._size, self._used, self._words = size, 0, words(columns)
        self.cells = device_array(ti.i32, (_FIRST_CELLS // size * size, self._words))
        self._files, self._key = files, key
        self._saved = np.zeros(self.slots.size, bool)  # whether each group is on disk
        if files:
            numbers, values = files.load(key, size, self._words, np.int32)
            self._saved[numbers] = True
            self._keep(numbers, values)

    def bytes_with(self, groups: int) -> int:
        """Return the memory of the cells with room for further groups."""
        return 4 * self._room(self._used + groups) * self._size * self._words

    def clear(self) -> None:
        """Forget all groups, except on disk."""
        self.slots.fill(-1)
        self._used = 0

    def add(self, places: NDArray[np.int64], values: NDArray[np.float32]) -> None:
        """Keep groups that are not here, and store those that are not on disk.

        Args:
            places: [n, 3], indices into `slots`.
            values: float32 [n, size, columns], their cells.
        """
        numbers = np.ravel_multi_index(tuple(places.T), self.slots.shape).astype(np.int32)
        cells = pack(values)
        self._keep(numbers, cells)
        if self._files:
            unsaved = ~self._saved[numbers]
            self._files.append(self._key, numbers[unsaved], cells[unsaved])
            self._saved[numbers] = True

    def _keep(self, numbers: NDArray[np.int32], cells: NDArray[np.int32]) -> None:
        room = self._room(self._used + len(numbers)) * self._size
        if room > self.cells.shape[0]:
            old, self.cells = self.cells, device_array(ti.i32, (room, self._words))
            copy_rows(old, self.cells, old.shape[0])
        slots = self._used + np.arange(len(numbers), dtype=np.int32)
        kernels.store_cells(cells, slots, self.cells)
        self.slots.ravel()[numbers] = slots
        self._used += len(numbers)

    def _room(self, groups: int) -> int:
        """Return for how many groups there is room once there is for a number of them; it doubles."""
        room = int(self.cells.shape[0]) // self._size
        return room if groups <= room else max(groups, 2 * room)
