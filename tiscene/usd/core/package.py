# SPDX-License-Identifier: Apache-2.0
"""Package-relative paths: "room.usdz[wood.png]" is wood.png in room.usdz. Ordinary file names may have brackets too."""

from __future__ import annotations

from pxr import Ar


def split_package(path: str) -> list[str]:
    """Return the parts of a path: the file, the path inside it, the path inside that one if it is a package, ..."""
    parts: list[str] = []
    while path or not parts:
        outer, path = Ar.SplitPackageRelativePathOuter(path)
        parts.append(str(outer))
    return parts
