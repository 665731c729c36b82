"""Which files a stage is made of, so that it can be told whether they have changed."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

from pxr import UsdUtils

from tiscene.usd.stage import quiet


def layer_digests(path: str | Path) -> dict[str, str]:
    """SHA-256 of the file of every layer and texture that a USD file refers to, itself included, in any variant.

    The keys are paths relative to the file's folder, with forward slashes, so that they do not tell where it lies.
    What cannot be found is left out.
    """
    root = Path(path).resolve()
    with quiet():
        layers, assets, _ = UsdUtils.ComputeAllDependencies(str(root))
    # Inside a package the path goes on in brackets: "room.usdz[textures/rug.png]"; the package is one file.
    files = {str(root), *(layer.realPath.split("[")[0] for layer in layers), *(asset.split("[")[0] for asset in assets)}
    present = sorted(Path(file) for file in files if os.path.isfile(file))
    return {Path(os.path.relpath(file, root.parent)).as_posix(): _digest(file) for file in present}


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
