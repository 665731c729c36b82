# SPDX-License-Identifier: Apache-2.0
"""Atomic writes, and locks on output folders."""

import errno
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from tiscene.errors import ExportError, MissingFile, export_errors
from tiscene.files import (
    LOCK_NAME,
    FolderLockedError,
    lock_folder,
    remove_partial_files,
    replacing,
    write_atomically,
)


def full_disk(*_):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_failed_write_leaves_the_old_file_and_no_partial_one(tmp_path, monkeypatch):
    target = tmp_path / "x" / "a.bin"
    write_atomically(target, b"old")
    monkeypatch.setattr("os.replace", full_disk)
    with pytest.raises(OSError, match="No space left"):
        write_atomically(target, b"new")
    assert [path.name for path in target.parent.iterdir()] == ["a.bin"]
    assert target.read_bytes() == b"old"


def test_export_errors_names_the_file_that_cannot_be_written(tmp_path, monkeypatch):
    monkeypatch.setattr("pathlib.Path.write_bytes", full_disk)
    picture = tmp_path / "picture.png"
    with pytest.raises(ExportError, match=r"cannot write .*picture\.png.*No space left"), export_errors(picture):
        write_atomically(picture, b"new")
    assert list(tmp_path.iterdir()) == []


def test_export_errors_names_the_file_in_the_place_of_a_folder(tmp_path):
    out, below = tmp_path / "out", tmp_path / "out" / "rgb"
    out.write_text("")
    with pytest.raises(ExportError, match=r"^cannot write '.*out': it is a file, not a folder$"), export_errors(out):
        out.mkdir(exist_ok=True)
    out.unlink()
    out.mkdir()
    below.write_text("")
    with pytest.raises(ExportError, match=r"^cannot write '.*out': '.*rgb' is a file, not"), export_errors(out):
        write_atomically(below / "0.png", b"")


@pytest.mark.parametrize("name", ["folder", "x" * 250])
def test_failed_write_names_the_file_and_not_the_partial_one(tmp_path, name):
    (tmp_path / "folder").mkdir()
    with pytest.raises(OSError, match=f"/{name}'$") as failure:
        write_atomically(tmp_path / name, b"new")
    assert ".part" not in str(failure.value)


def test_atomic_write_gives_the_default_permissions(tmp_path):
    (tmp_path / "plain").write_bytes(b"")
    write_atomically(tmp_path / "a.bin", b"")
    assert (tmp_path / "a.bin").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_processes_with_equal_ids_do_not_share_a_partial_file(tmp_path, monkeypatch):
    """Containers on several machines often have the same ids."""
    target, write = tmp_path / "a.bin", Path.write_bytes

    def written_while_another_process_writes(path, data):
        monkeypatch.setattr(Path, "write_bytes", write)
        write(path, data)
        write_atomically(target, b"other")

    monkeypatch.setattr(Path, "write_bytes", written_while_another_process_writes)
    write_atomically(target, b"own")
    assert target.read_bytes() == b"own"
    assert [path.name for path in tmp_path.iterdir()] == ["a.bin"]


def test_partial_files_of_killed_processes_are_recognized(tmp_path):
    with replacing(tmp_path / "a.bin") as partial:
        partial.write_bytes(b"whole")
    partial.write_bytes(b"half")
    remove_partial_files(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["a.bin"]


def test_export_errors_leaves_errors_about_what_is_read(tmp_path):
    with pytest.raises(MissingFile, match=r"^no file"), export_errors(tmp_path):
        raise MissingFile("no file 'scene.usda'")


def test_lock_of_a_folder_is_exclusive_and_leaves_no_file(tmp_path):
    with lock_folder(tmp_path):
        with (
            pytest.raises(FolderLockedError, match=f"process {os.getpid()} on .* writes into it"),
            lock_folder(tmp_path),
        ):
            pass
        assert [path.name for path in tmp_path.iterdir()] == [LOCK_NAME]
    assert list(tmp_path.iterdir()) == []
    with lock_folder(tmp_path):
        pass


HOLDER = """
import sys
from pathlib import Path
from tiscene.files import lock_folder

with lock_folder(Path(sys.argv[1])):
    print("locked", flush=True)
    sys.stdin.read()
"""


def test_lock_of_a_killed_process_is_free_and_its_partial_files_are_removed(tmp_path):
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    with holder:
        assert holder.stdout.readline() == "locked\n"
        with pytest.raises(FolderLockedError, match=f"process {holder.pid} "), lock_folder(tmp_path):
            pass
        holder.kill()
    partial, own = tmp_path / "rgb" / f".000001.png.{holder.pid}-0123abcd.part", tmp_path / "movie.part"
    for path in (partial, own):
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(b"half")
    with lock_folder(tmp_path):
        assert not partial.exists()
        assert own.exists()


def test_partial_files_of_a_process_that_writes_into_a_subfolder_stay(tmp_path):
    """A merge may follow a killed one while a shard is being rendered."""
    shard = tmp_path / "shards" / "0"
    shard.mkdir(parents=True)
    (tmp_path / LOCK_NAME).write_text("process 1, which was killed")
    partial = shard / ".000001.png.2-0123abcd.part"
    with lock_folder(shard):
        partial.write_bytes(b"half a file")
        with lock_folder(tmp_path):
            assert partial.exists()
    (tmp_path / LOCK_NAME).write_text("process 3, which was killed")
    with lock_folder(tmp_path):
        assert not partial.exists()


def test_one_of_many_threads_at_a_time_holds_a_lock(tmp_path):
    """The lock file is deleted at each release, while other threads try to lock it."""
    holders, most, taken = [], [], []

    def take_repeatedly():
        while len(taken) < 200:
            try:
                with lock_folder(tmp_path):
                    holders.append(1)
                    most.append(len(holders))
                    taken.append(1)
                    holders.pop()
            except FolderLockedError:
                pass

    threads = [threading.Thread(target=take_repeatedly) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60.0)
    assert max(most) == 1
    assert list(tmp_path.iterdir()) == []
