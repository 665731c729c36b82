# SPDX-License-Identifier: Apache-2.0
"""Base images on disk: what a scene looks like without its movers costs seconds and is the same at the next start.

One file an image in the platform's cache folder (or $TISCENE_CACHE), named by a digest of all that the image depends
on. Files are written whole or not at all and are checked when read; whatever goes wrong, the image is rendered again.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import os
import platform
import sys
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.device import runtime
from tiscene.files import write_atomically
from tiscene.render.view import View
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT

SIZE_LIMIT = 1 << 30  # bytes of the folder; the files that were not used for longest go first
_SUFFIX = ".base"
_DIGEST = 32


def cache_folder() -> Path:
    """Where this platform keeps what can be made again."""
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


class BaseImageCache:
    """The images in one folder; any number of processes may use it at a time."""

    def __init__(self, folder: Path | None = None, size_limit: int = SIZE_LIMIT) -> None:
        """folder: by default the platform's. size_limit: bytes."""
        self.folder = folder or cache_folder()
        self.size_limit = size_limit
        self._digests: dict[int, bytes] = {}

    def key(self, scene: DeviceScene, still: NDArray[np.bool_], view: View, settings: Mapping[str, int | str]) -> str:
        """The name of the picture of those instances of what is placed: a digest of everything that it depends on."""
        placement = scene.placement
        digest = hashlib.sha256(_program())
        rows = placement.mesh[still]
        for first, description in scene.descriptions:
            meshes = range(first, first + len(description.meshes))
            shown = np.flatnonzero(np.isin(rows, meshes))
            if len(shown):
                digest.update(self._content(description))
                digest.update((rows[shown] - first).tobytes())
                digest.update(placement.world_from_object[CURRENT, still][shown].tobytes())
        _add(digest, [scene.lights.lights, view.rows()[CURRENT], view.width, view.height, sorted(settings.items())])
        return digest.hexdigest()

    def load(self, key: str, shape: tuple[int, ...]) -> NDArray[np.float32] | None:
        """The image of that key, None if there is none that is whole."""
        path = self.folder / (key + _SUFFIX)
        try:
            content = path.read_bytes()
            os.utime(path)
        except OSError:
            return None
        digest, pixels = content[:_DIGEST], content[_DIGEST:]
        if len(pixels) != 4 * int(np.prod(shape)) or hashlib.sha256(pixels).digest() != digest:
            return None
        return np.frombuffer(pixels, "<f4").reshape(shape).astype(np.float32)

    def save(self, key: str, image: NDArray[np.float32]) -> None:
        """Keep an image, if the folder can be written to."""
        pixels = np.ascontiguousarray(image, "<f4").tobytes()
        with contextlib.suppress(OSError):
            self.folder.mkdir(parents=True, exist_ok=True)
            self._make_room(len(pixels) + _DIGEST)
            write_atomically(self.folder / (key + _SUFFIX), hashlib.sha256(pixels).digest() + pixels)

    def _make_room(self, size: int) -> None:
        """Delete the files used longest ago, and what a process that died has left, until another one fits."""
        files = []
        for path in self.folder.iterdir():
            if path.suffix in (_SUFFIX, ".part"):
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

    def _content(self, description: Any) -> bytes:
        """A digest of what a description adds to a scene; computed once."""
        known = self._digests.get(id(description))
        if known is None:
            known = digest_of([description.meshes, description.materials, description.textures])
            self._digests[id(description)] = known
        return known


def digest_of(value: Any) -> bytes:
    """A digest of a dataclass, an array, a number, a text or a sequence of such."""
    digest = hashlib.sha256()
    _add(digest, value)
    return digest.digest()


def _add(digest: Any, value: Any) -> None:
    """Feed a value to a digest, type and length included."""
    if isinstance(value, np.ndarray):
        digest.update(f"{value.dtype.str}{value.shape}".encode())
        digest.update(np.ascontiguousarray(value).data)
    elif dataclasses.is_dataclass(value):
        digest.update(type(value).__name__.encode())
        for field in dataclasses.fields(value):
            _add(digest, getattr(value, field.name))
    elif isinstance(value, list | tuple):
        digest.update(f"[{len(value)}]".encode())
        for each in value:
            _add(digest, each)
    else:
        digest.update(f"{value!r};".encode())


@cache
def _program() -> bytes:
    """A digest of the code that makes the pictures and of what it runs on."""
    digest = hashlib.sha256(f"{runtime.running()} {platform.machine()} {np.__version__}".encode())
    root = Path(__file__).parents[3]  # tiscene
    for path in sorted([*root.glob("render/**/*.py"), *root.glob("scene/**/*.py")]):
        digest.update(path.read_bytes())
    return digest.digest()
