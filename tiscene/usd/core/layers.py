# SPDX-License-Identifier: Apache-2.0
"""Files of a stage and their SHA-256 digests, to detect whether any of them has changed."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from pxr import UsdUtils

from tiscene import catalog
from tiscene.usd.core.package import split_package
from tiscene.usd.core.stage import quiet

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
        where the folder is. Missing files are left out. A package (.usdz) is one file. Files that have not changed
        since an earlier call are not read again.
    """
    root = Path(path).resolve()
    known = _known.get(root)
    if known is None or any(_status(file) != status for file, status in known.statuses.items()):
        with quiet():
            layers, assets, unresolved = UsdUtils.ComputeAllDependencies(str(root))
        files = {str(root), *(split_package(path)[0] for path in (*(layer.realPath for layer in layers), *assets))}
        statuses = {file: _status(file) for file in files}  # before the files are read
        present = sorted(Path(file) for file in files if os.path.isfile(file))
        digests = {Path(os.path.relpath(file, root.parent)).as_posix(): _digest(file) for file in present}
        known = _KnownDigests(statuses, digests)
        _known.pop(root, None)
        if not unresolved:  # a missing file may come to be anywhere
            while len(_known) >= MAX_KNOWN:
                del _known[next(iter(_known))]
            _known[root] = known
    return dict(known.digests)


class _KnownDigests(NamedTuple):
    """Digests of a root file, which hold as long as its files have the same statuses."""

    statuses: dict[str, tuple[int, ...] | None]
    digests: dict[str, str]


_known: dict[Path, _KnownDigests] = {}


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
