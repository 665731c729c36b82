# SPDX-License-Identifier: Apache-2.0
"""Tiles of panoramas on disk: what is read back, and what damage does."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tiscene.render.integrators.panorama.panorama_kernels import TILE
from tiscene.render.integrators.panorama.tile_files import TileFiles


def tiles(*numbers: int) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    cells = np.random.default_rng(numbers[0]).random((len(numbers), TILE * TILE, 9), np.float32)
    return np.array(numbers, np.int32), cells


def check(files: TileFiles, *expected: tuple[NDArray[np.int32], NDArray[np.float32]]) -> None:
    """Check that exactly these tiles are read, in order of their numbers."""
    numbers, cells = (np.concatenate(each) for each in zip(*expected, strict=True))
    found_numbers, found_cells = files.load("key", 9)
    np.testing.assert_array_equal(found_numbers, np.sort(numbers))
    np.testing.assert_array_equal(found_cells, cells[np.argsort(numbers)])


def test_tiles_of_all_processes_are_read_by_key(tmp_path: Path) -> None:
    one, other = TileFiles(tmp_path), TileFiles(tmp_path)
    one.append("key", *tiles(7, 3))
    other.append("key", *tiles(5))
    one.append("key", *tiles(4))
    one.append("other", *tiles(9))
    check(TileFiles(tmp_path), tiles(7, 3), tiles(5), tiles(4))
    assert len(list(tmp_path.iterdir())) == 3
    assert len(one.load("none", 9)[0]) == 0


def test_torn_and_damaged_records_are_left_out(tmp_path: Path) -> None:
    files = TileFiles(tmp_path)
    files.append("key", *tiles(1))
    files.append("key", *tiles(2))
    files.append("key", *tiles(3))
    (path,) = tmp_path.iterdir()
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1  # in the second record
    path.write_bytes(content[:-5])
    check(files, tiles(1))


def test_oldest_files_are_deleted_where_there_is_no_room(tmp_path: Path) -> None:
    old = TileFiles(tmp_path)
    old.append("key", *tiles(1))
    TileFiles(tmp_path, size_limit=1000).append("key", *tiles(2))
    check(old, tiles(2))


def test_folder_that_cannot_be_written_is_no_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    files = TileFiles(tmp_path / "file" / "folder")
    files.append("key", *tiles(1))
    assert len(files.load("key", 9)[0]) == 0
