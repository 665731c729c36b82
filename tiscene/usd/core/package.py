# SPDX-License-Identifier: Apache-2.0
"""Paths into packages: "room.usdz[wood.png]" is wood.png in room.usdz. Other names may have brackets too."""

from __future__ import annotations

from pxr import Ar


def split_package(path: str) -> list[str]:
    """The file of a path, then the path of what is in it, of what is in that, and so on."""
    parts: list[str] = []
    while path or not parts:
        outer, path = Ar.SplitPackageRelativePathOuter(path)
        parts.append(str(outer))
    return parts
