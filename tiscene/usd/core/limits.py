# SPDX-License-Identifier: Apache-2.0
"""How much a stage may take, and from where."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass, field
from pathlib import Path

from pxr import Usd

from tiscene.errors import ArgumentError, StageError
from tiscene.usd.core.package import split_package


@dataclass(frozen=True)
class Limits:
    """What reading a stage may take before it is refused.

    prims: how many are drawn from, instances counted each time. triangles: of all meshes, each counted once.
    seconds: of reading; checked between prims, or by ending the process of an untrusted file. memory: bytes, of that
    process only.
    """

    prims: int = 1_000_000
    triangles: int = 100_000_000
    seconds: float = 600.0
    memory: int = 16 << 30

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not value > 0:
                raise ArgumentError(f"limits: {name}={value} must be positive")


@dataclass
class Spent:
    """What reading has taken so far, against its limits."""

    stage: str
    limits: Limits
    prims: int = 0
    triangles: int = 0
    began: float = field(default_factory=time.monotonic)

    def prim(self) -> None:
        """One more prim. Raises StageError where a limit is passed."""
        self.prims += 1
        if self.prims > self.limits.prims:
            self._refuse(f"it has more than {self.limits.prims:,} prims")
        if time.monotonic() - self.began > self.limits.seconds:
            self._refuse(f"reading it took longer than {self.limits.seconds:g} s")

    def mesh(self, triangles: int) -> None:
        """One more mesh. Raises StageError where a limit is passed."""
        self.triangles += triangles
        if self.triangles > self.limits.triangles:
            self._refuse(f"it has more than {self.limits.triangles:,} triangles")

    def _refuse(self, text: str) -> None:
        raise StageError(self.stage, [f"{text}; raise `limits` if it is meant to be so"])


class Root:
    """A folder that everything must be in, by real paths: links that lead out of it do not help."""

    def __init__(self, folder: str | os.PathLike[str] | None) -> None:
        """folder: None for anywhere. Raises ArgumentError for one that is not there."""
        if not isinstance(folder, str | os.PathLike | None):
            raise ArgumentError(f"root={folder!r}: must be a folder")
        self.folder = None if folder is None else Path(folder).resolve()
        if self.folder is not None and not self.folder.is_dir():
            raise ArgumentError(f"root={str(folder)!r} is no folder")

    def holds(self, file: str) -> bool:
        """Whether a file, or a file inside a package ("room.usdz[wood.png]"), is in it."""
        return self.folder is None or Path(split_package(file)[0]).resolve().is_relative_to(self.folder)

    def check(self, stage: Usd.Stage, name: str) -> None:
        """Raises StageError if any layer of a stage is outside."""
        used = [layer.realPath for layer in stage.GetUsedLayers() if not layer.anonymous]
        outside = sorted(path for path in used if path and not self.holds(path))
        if outside:
            raise StageError(name, [f"layer @{path}@ is outside {self.folder}" for path in outside])
