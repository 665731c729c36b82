# SPDX-License-Identifier: Apache-2.0
"""Files of a stage and their SHA-256 digests, to detect whether any of them has changed."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable
from pathlib import Path

from pxr import UsdUtils

from tiscene import catalog
from tiscene.usd.core.package import split_package
from tiscene.usd.core.stage import quiet


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
        where the folder is. Missing files are left out. A package (.usdz) is one file.
    """
    root = Path(path).resolve()
    with quiet():
        layers, assets, _ = UsdUtils.ComputeAllDependencies(str(root))
    files = {str(root), *(split_package(path)[0] for path in (*(layer.realPath for layer in layers), *assets))}
    present = sorted(Path(file) for file in files if os.path.isfile(file))
    return {Path(os.path.relpath(file, root.parent)).as_posix(): _digest(file) for file in present}


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
