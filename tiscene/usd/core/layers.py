# SPDX-License-Identifier: Apache-2.0
"""Files of a stage and their SHA-256 digests, to detect whether any of them has changed."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from pxr import Ar, Usd, UsdUtils

from tiscene import catalog
from tiscene.usd.core.package import split_package
from tiscene.usd.core.stage import quiet, resolver_context

MAX_KNOWN = 256  # root files whose digests are kept until one of their files changes


def scene_digests(scene: str, templates: Iterable[str]) -> dict[str, str]:
    """Return the digests of all files of a scene and of templates.

    Args:
        scene: name or file of a scene.
        templates: names or files of templates.

    Returns:
        `layer_digests` of each; the keys of a template's files begin with its name and a colon.
    """
    digests = layer_digests(catalog.find_scene(scene))
    for template in sorted(templates):
        files = layer_digests(catalog.find_template(template))
        digests |= {f"{template}: {name}": digest for name, digest in files.items()}
    return digests


def layer_digests(path: str | Path) -> dict[str, str]:
    """Return the SHA-256 of every layer and texture that a USD file refers to in any variant, itself included.

    Returns:
        Hexadecimal digests by path relative to the file's folder, with forward slashes, so that they do not depend on
        where the folder is; by path in the catalog for its files, if the file itself is elsewhere. Missing files are
        left out. A package (.usdz) is one file. Files that have not changed since an earlier call are not read again.
    """
    root = Path(path).resolve()
    key = root, tuple(catalog.search_path())
    known = _known.get(key)
    if known is None or any(_status(file) != status for file, status in known.statuses.items()):
        with quiet(), Ar.ResolverContextBinder(resolver_context(root)):
            layers, assets, unresolved = UsdUtils.ComputeAllDependencies(str(root))
        files = {str(root), *(split_package(path)[0] for path in (*(layer.realPath for layer in layers), *assets))}
        statuses = {file: _status(file) for file in files}  # before the files are read
        present = sorted(Path(file) for file in files if os.path.isfile(file))
        in_catalog = {} if catalog_path(root) else {file: catalog_path(file) for file in present}
        relative = {file: Path(os.path.relpath(file, root.parent)).as_posix() for file in present}
        digests = {in_catalog.get(file) or relative[file]: _digest(file) for file in present}
        known = _KnownDigests(statuses, digests)
        _known.pop(key, None)
        if not unresolved:  # a missing file may come to be anywhere
            while len(_known) >= MAX_KNOWN:
                del _known[next(iter(_known))]
            _known[key] = known
    return dict(known.digests)


def catalog_path(file: Path) -> str | None:
    """Return the path of a file in the folders of scenes, such as `room_02/scene.usda`; None if it is not found by it.

    Args:
        file: its resolved path.
    """
    folders = [folder.resolve() for folder in catalog.search_path()]
    for folder in folders:
        if file.is_relative_to(folder):
            name = file.relative_to(folder)
            first = next((each / name for each in folders if (each / name).exists()), None)
            return name.as_posix() if first is not None and first.resolve() == file else None
    return None


class _KnownDigests(NamedTuple):
    """Digests of a root file, which hold as long as its files have the same statuses."""

    statuses: dict[str, tuple[int, ...] | None]
    digests: dict[str, str]


_known: dict[tuple[Path, tuple[Path, ...]], _KnownDigests] = {}  # by root file and folders of scenes


def _status(path: str) -> tuple[int, ...] | None:
    """Return what changes when a file is written or replaced; None if there is none."""
    try:
        status = os.stat(path)
    except OSError:
        return None
    return status.st_mtime_ns, status.st_ctime_ns, status.st_size, status.st_ino, status.st_dev


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def has_file(stage: Usd.Stage, path: Path) -> bool:
    """Return whether a stage consists of a file, among others: what is written into it would refer to itself."""
    return path.resolve() in [Path(layer.realPath) for layer in stage.GetUsedLayers() if layer.realPath]
