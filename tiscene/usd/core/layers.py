# SPDX-License-Identifier: Apache-2.0
"""Which files a stage is made of, so that it can be told whether they have changed."""

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
    """`layer_digests` of a scene and of templates, whose keys begin with their names and a colon."""
    digests = layer_digests(catalog.find_scene(scene))
    for template in sorted(templates):
        files = layer_digests(catalog.find_template(template))
        digests |= {f"{template}: {name}": digest for name, digest in files.items()}
    return digests


def layer_digests(path: str | Path) -> dict[str, str]:
    """SHA-256 of the file of every layer and texture that a USD file refers to, itself included, in any variant.

    The keys are paths relative to the file's folder, with forward slashes, so that they do not tell where it lies.
    What cannot be found is left out.
    """
    root = Path(path).resolve()
    with quiet():
        layers, assets, _ = UsdUtils.ComputeAllDependencies(str(root))
    # A package is one file.
    files = {str(root), *(split_package(path)[0] for path in (*(layer.realPath for layer in layers), *assets))}
    present = sorted(Path(file) for file in files if os.path.isfile(file))
    return {Path(os.path.relpath(file, root.parent)).as_posix(): _digest(file) for file in present}


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
