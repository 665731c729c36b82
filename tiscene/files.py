# SPDX-License-Identifier: Apache-2.0
"""Atomic file writes, and locks on output folders.

A file written by `write_atomically` is either complete or absent. `lock_folder` keeps two processes from writing into
one folder at the same time; the lock of a process that was killed is free.
"""

from __future__ import annotations

import contextlib
import os
import re
import socket
from collections.abc import Iterator
from pathlib import Path

LOCK_NAME = ".tiscene.lock"
_PARTIAL = re.compile(r"\..+\.\d+\.part")  # names that `write_atomically` gives to files it has not finished


class FolderLockedError(OSError):
    """Another process, or another thread of this one, writes into the folder."""


def write_atomically(path: Path, data: bytes) -> None:
    """Write a file through a temporary file beside it, so that it never exists in part. Creates its folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")  # several processes may write one file
    try:
        temporary.write_bytes(data)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder, and remove the partial files that a killed holder of the lock has left in it.

    The operating system frees the lock of a process that ends in any way. The lock file `LOCK_NAME` exists while the
    lock is held; a killed process leaves it behind, without effect.

    Args:
        folder: An existing folder.

    Raises:
        FolderLockedError: Another process or thread holds the lock; the message names the process.
        OSError: The lock file cannot be created.
    """
    path = folder / LOCK_NAME
    descriptor = _open_locked(path)
    try:
        if os.fstat(descriptor).st_size > 0:  # a process died while it held the lock
            remove_partial_files(folder)
        os.ftruncate(descriptor, 0)
        os.write(descriptor, f"process {os.getpid()} on {socket.gethostname()}".encode())
        yield
    finally:
        os.ftruncate(descriptor, 0)
        with contextlib.suppress(OSError):
            path.unlink()
        os.close(descriptor)


def remove_partial_files(folder: Path) -> None:
    """Delete the files in a folder and its subfolders that an interrupted `write_atomically` has left."""
    for root, _, names in os.walk(folder):
        for name in filter(_PARTIAL.fullmatch, names):
            Path(root, name).unlink(missing_ok=True)


def _open_locked(path: Path) -> int:
    """Open a lock file and lock it. Return the file descriptor."""
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        if not _try_lock(descriptor):
            holder = os.read(descriptor, 200).decode(errors="replace") or "another process"
            os.close(descriptor)
            raise FolderLockedError(f"{holder} writes into it")
        # The previous holder may have deleted the file after it was opened here.
        with contextlib.suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(descriptor), os.stat(path)):
                return descriptor
        os.close(descriptor)


def _try_lock(descriptor: int) -> bool:
    """Lock an open file; return False if it is locked already.

    Returns True without a lock where files cannot be locked (Windows, some network drives).
    """
    try:
        import fcntl

        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except (ImportError, OSError):
        pass
    return True
