# SPDX-License-Identifier: Apache-2.0
"""Atomic file writes, locks on output folders, and a cache of results that take seconds to compute.

A file written by `write_atomically` is either complete or absent. `lock_folder` keeps two processes from writing into
one folder at the same time; the lock of a process that was killed is free. `DiskCache` keeps results for the next
process; on any failure they are computed again.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import socket
import sys
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path
from uuid import uuid4

_DIGEST_SIZE = 32  # of SHA-256, at the start of a file
LOCK_NAME = ".tiscene.lock"
_PARTIAL = re.compile(r"\..+\.\d+-[0-9a-f]{8}\.part")  # names that `replacing` yields


class FolderLockedError(OSError):
    """Another process, or another thread of this one, writes into the folder."""


def write_atomically(path: Path, data: bytes | Iterable[bytes]) -> None:
    """Write a file, whole or in parts, so that it never exists in part. Creates its folder."""
    with replacing(path) as temporary:
        if isinstance(data, bytes):
            temporary.write_bytes(data)
        else:
            with temporary.open("wb") as file:
                file.writelines(data)


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a new name, hidden and beside `path`, for a file that becomes `path` at the end of the block.

    Creates the folder. After an error `path` is as before. Several processes may write one file, also from machines, or
    containers, that give them equal process ids.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}-{uuid4().hex[:8]}.part")
    try:
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        if error.filename != str(temporary):
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()  # there was an error, or it is a link to `path`, which is not replaced then


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
    """Delete the files in a folder and its subfolders that an interrupted `replacing` has left.

    Subfolders with a lock of their own, such as shards, are left to its next holder: a process may write into them.
    """
    for root, subfolders, names in os.walk(folder):
        subfolders[:] = [each for each in subfolders if not Path(root, each, LOCK_NAME).exists()]
        for name in filter(_PARTIAL.fullmatch, names):
            Path(root, name).unlink(missing_ok=True)


def _open_locked(path: Path) -> int:
    """Open a lock file and lock it. Return the file descriptor."""
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        if not _try_lock(descriptor):
            holder = os.read(descriptor, 200).decode(errors="replace") or "another process"
            os.close(descriptor)
            raise FolderLockedError(f"{holder} writes into it. Wait until it is done, or choose another folder.")
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


def cache_folder() -> Path:
    """Return the folder for caches: $TISCENE_CACHE, or `tiscene` in the platform's cache folder."""
    given = os.environ.get("TISCENE_CACHE")
    if given:
        return Path(given)
    if sys.platform == "win32":
        home = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    elif sys.platform == "darwin":
        home = Path.home() / "Library" / "Caches"
    else:
        home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return home / "tiscene"


class DiskCache:
    """Files of one kind, named by keys and verified when they are read, which several processes may share.

    The least recently used ones are deleted first.

    Args:
        suffix: Of the names of the files, with a dot.
        size_limit: Limit of their size together, bytes.
        folder: The folder; None: `cache_folder()`.
    """

    def __init__(self, suffix: str, size_limit: int, folder: Path | None = None) -> None:
        self.suffix, self.size_limit = suffix, size_limit
        self.folder = folder or cache_folder()

    def load(self, key: str) -> bytes | None:
        """Return what was saved under a key, or None if there is no intact file of it."""
        path = self.folder / (key + self.suffix)
        try:
            content = path.read_bytes()
            os.utime(path)
        except OSError:
            return None
        digest, data = content[:_DIGEST_SIZE], content[_DIGEST_SIZE:]
        return data if hashlib.sha256(data).digest() == digest else None

    def save(self, key: str, data: bytes) -> None:
        """Store data under a key, a name of a file. Only warns if the folder is not writable."""
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            self.make_room(len(data) + _DIGEST_SIZE)
            write_atomically(self.folder / (key + self.suffix), hashlib.sha256(data).digest() + data)
        except OSError as error:
            text = f"cannot keep results for later runs in {str(self.folder)!r}: {error.strerror or error}. "
            warnings.warn(text + "Name another folder by the environment variable TISCENE_CACHE.", stacklevel=2)

    def make_room(self, size: int) -> None:
        """Delete the least recently used files and leftovers of crashed processes until `size` more bytes fit."""
        files = []
        for path in self.folder.iterdir():
            if path.suffix == self.suffix or path.name.endswith(".part"):
                with contextlib.suppress(OSError):  # another process may have deleted it
                    status = path.stat()
                    files.append((status.st_mtime, status.st_size, path))
        excess = sum(file[1] for file in files) + size - self.size_limit
        for _, length, path in sorted(files, key=lambda file: file[:2]):
            if excess <= 0:
                break
            with contextlib.suppress(OSError):
                path.unlink()
                excess -= length
