# SPDX-License-Identifier: Apache-2.0
"""Files are there whole or not at all."""

import errno
import os

import pytest

from tiscene.errors import ExportError, export_errors
from tiscene.files import write_atomically


def full_disk(*_):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_file_is_never_seen_in_part(tmp_path, monkeypatch):
    target = tmp_path / "x" / "a.bin"
    write_atomically(target, b"old")
    monkeypatch.setattr("os.replace", full_disk)
    with pytest.raises(OSError, match="No space left"):
        write_atomically(target, b"new")
    assert [path.name for path in target.parent.iterdir()] == ["a.bin"]
    assert target.read_bytes() == b"old"


def test_a_file_on_its_own_says_what_could_not_be_written(tmp_path, monkeypatch):
    monkeypatch.setattr("pathlib.Path.write_bytes", full_disk)
    picture = tmp_path / "picture.png"
    with pytest.raises(ExportError, match=r"cannot write .*picture\.png.*No space left"), export_errors(picture):
        write_atomically(picture, b"new")
    assert list(tmp_path.iterdir()) == []


def test_files_have_the_rights_that_others_have(tmp_path):
    (tmp_path / "plain").write_bytes(b"")
    write_atomically(tmp_path / "a.bin", b"")
    assert (tmp_path / "a.bin").stat().st_mode == (tmp_path / "plain").stat().st_mode
