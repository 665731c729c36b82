# SPDX-License-Identifier: Apache-2.0
"""Disk cache of base images, which take seconds to render and are the same at the next start.

One file per image in a `DiskCache`, named by a digest of everything the image depends on.
"""

from __future__ import annotations

import dataclasses
import hashlib
import platform
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from dynamics.weak_cache import weakly_cached
from tiscene.device import runtime
from tiscene.files import DiskCache
from tiscene.render.view import CubeView, View
from tiscene.scene.description import SceneDescription
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT

SIZE_LIMIT = 1 << 30  # bytes; the least recently used files are deleted first
_SUFFIX = ".base"


class BaseImageCache:
    """Base images in one folder, which several processes may share.

    Args:
        folder: The folder; None: `cache_folder()`.
        size_limit: Limit of the folder's size, bytes.
    """

    def __init__(self, folder: Path | None = None, size_limit: int = SIZE_LIMIT) -> None:
        self._files = DiskCache(_SUFFIX, size_limit, folder)
        self.folder = self._files.folder

    def key(
        self, scene: DeviceScene, still: NDArray[np.bool_], view: View | CubeView, settings: Mapping[str, int | str]
    ) -> str:
        """Return the name of a base image: a digest of everything that it depends on.

        Args:
            scene: The scene, as placed.
            still: bool [n], the placed instances that are in the image.
            view: Camera and image size.
            settings: Render settings.
        """
        placement = scene.placement
        digest = hashlib.sha256(_program_digest())
        rows, lights = placement.mesh[still], scene.lights_of(placement)
        for row, (first, description) in enumerate(scene.descriptions):
            meshes = range(first, first + len(description.meshes))
            shown, lit = np.flatnonzero(np.isin(rows, meshes)), [light for number, light in lights if number == row]
            if len(shown) or lit:  # lights have textures too
                digest.update(content_digest(description))
                digest.update((rows[shown] - first).tobytes())
                digest.update(placement.world_from_object[CURRENT, still][shown].tobytes())
                if placement.color is not None:
                    digest.update(placement.color[CURRENT, still][shown].tobytes())
                _add(digest, lit)
        order = [number for number, _ in lights]
        _add(digest, [order, view.rows()[CURRENT], view.width, view.height, sorted(settings.items())])
        return digest.hexdigest()

    def load(self, key: str, shape: tuple[int, ...]) -> NDArray[np.float32] | None:
        """Return an image, or None if there is no intact file of that key and shape."""
        pixels = self._files.load(key)
        if pixels is None or len(pixels) != 4 * int(np.prod(shape)):
            return None
        return np.frombuffer(pixels, "<f4").reshape(shape).astype(np.float32)

    def save(self, key: str, image: NDArray[np.float32]) -> None:
        """Store an image. Does nothing if the folder is not writable."""
        self._files.save(key, np.ascontiguousarray(image, "<f4").tobytes())


@weakly_cached
def content_digest(description: SceneDescription) -> bytes:
    """Return a digest of the meshes, materials and textures of a description."""
    return digest_of([description.meshes, description.materials, description.textures])


def digest_of(value: Any) -> bytes:
    """Return a digest of a dataclass, an array, a number, a string, or a sequence of such."""
    digest = hashlib.sha256()
    _add(digest, value)
    return digest.digest()


def _add(digest: Any, value: Any) -> None:
    """Update a digest with a value, its type and its length."""
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
def _program_digest() -> bytes:
    """Return a digest of the rendering code and of the platform."""
    versions = ti.__version__, np.__version__
    digest = hashlib.sha256(f"{runtime.running()} {platform.machine()} {versions}".encode())
    root = Path(__file__).parents[3]  # tiscene
    for path in sorted([*root.glob("render/**/*.py"), *root.glob("scene/**/*.py")]):
        digest.update(path.read_bytes())
    return digest.digest()
