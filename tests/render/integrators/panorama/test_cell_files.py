# SPDX-License-Identifier: Apache-2.0
"""Groups of cells of panoramas on disk: what is read back, and what damage does."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tiscene.render.integrators.panorama.cell_files import CellFiles

SIZE, COLUMNS = 64, 9


def groups(*numbers: int) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    cells = np.random.default_rng(numbers[0]).random((len(numbers), SIZE, COLUMNS), np.float32)
    return np.array(numbers, np.int32), cells


def check(files: CellFiles, *expected: tuple[NDArray[np.int32], NDArray[np.float32]]) -> None:
    """Check that exactly these groups are read, in order of their numbers."""
    numbers, cells = (np.concatenate(each) for each in zip(*expected, strict=True))
    found_numbers, found_cells = files.load("key", SIZE, COLUMNS, np.float32)
    np.testing.assert_array_equal(found_numbers, np.sort(numbers))
    np.testing.assert_array_equal(found_cells, cells[np.argsort(numbers)])


def test_groups_of_all_processes_are_read_by_key(tmp_path: Path) -> None:
    one, other = CellFiles(tmp_path), CellFiles(tmp_path)
    one.append("key", *groups(7, 3))
    other.append("key", *groups(5))
    one.append("key", *groups(4))
    one.append("other", *groups(9))
    check(CellFiles(tmp_path), groups(7, 3), groups(5), groups(4))
    assert len(list(tmp_path.iterdir())) == 3
    assert len(one.load("none", SIZE, COLUMNS, np.float32)[0]) == 0


def test_torn_and_damaged_records_are_left_out(tmp_path: Path) -> None:
    files = CellFiles(tmp_path)
    files.append("key", *groups(1))
    files.append("key", *groups(2))
    files.append("key", *groups(3))
    (path,) = tmp_path.iterdir()
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1  # in the second record
    path.write_bytes(content[:-5])
    check(files, groups(1))


def test_oldest_files_are_deleted_where_there_is_no_room(tmp_path: Path) -> None:
    old = CellFiles(tmp_path)
    old.append("key", *groups(1))
    CellFiles(tmp_path, size_limit=1000).append("key", *groups(2))
    check(old, groups(2))


def test_folder_that_cannot_be_written_is_no_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    files = CellFiles(tmp_path / "file" / "folder")
    files.append("key", *groups(1))
    assert len(files.load("key", SIZE, COLUMNS, np.float32)[0]) == 0
