# SPDX-License-Identifier: Apache-2.0
"""Limits on reading USD files: size of the scene, time, memory, and the folder that files must be in.

`Limits` is what a user sets. `ReadingBudget` counts prims and triangles while a stage is read and raises at the first
limit exceeded. Time and memory can only be bounded from outside, since USD itself may hang or allocate without end on a
damaged file: `tiscene.usd.read.subprocess_reader` reads in a child process and stops it.
"""

from __future__ import annotations

import os
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pxr import Usd

from tiscene.errors import ArgumentError, StageError
from tiscene.usd.core.package import split_package


@dataclass(frozen=True)
class Limits:
    """Upper bounds on reading one file. Reading stops with StageError at the first one exceeded.

    Attributes:
        prims: prims visited; those of an instance's prototype count for each instance.
        triangles: triangles of all meshes; a mesh that is shared by instances counts once.
        seconds: wall-clock time, including the start of the child process.
        memory: bytes of address space of the child process; Python, USD and NumPy alone take about 1 GiB. Enforced
            by the operating system, on Linux and other POSIX systems that honor RLIMIT_AS.

    Raises:
        ArgumentError: a limit is not positive.
    """

    prims: int = 1_000_000
    triangles: int = 100_000_000
    seconds: float = 600.0
    memory: int = 16 << 30

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not value > 0:
                raise ArgumentError(f"limits: {name}={value} must be positive")

    def exceeded(self, name: str) -> str:
        """Return the problem of a stage that exceeds one of the limits, and how to raise that limit.

        Args:
            name: name of the limit, an attribute of this class.
        """
        seen = {
            "prims": f"it has more than {self.prims:,} prims",
            "triangles": f"it has more than {self.triangles:,} triangles",
            "seconds": f"reading it took longer than {self.seconds:g} s",
            "memory": f"reading it took more memory than {self.memory / 2**30:.3g} GiB",
        }[name]
        return f"{seen}: the file may be damaged; if it is only large, raise the limit with Limits({name}=...)"


@dataclass
class ReadingBudget:
    """Prims, triangles and time used so far by reading one stage.

    Attributes:
        stage: name of the file in error messages.
        limits: the bounds.
        prims: prims visited so far.
        triangles: triangles read so far.
        levels: the most levels that subdivision surfaces are refined to, by path (in their prototypes).
        refined: refined surfaces by the content of their control meshes, so that copies are refined once.
        skins: what moves the points of skinned meshes, by path.
        baked_skins: paths of the prims whose skinning was baked instead.
        links: the stage's light and shadow links; None: none (`tiscene.usd.lights.light_linking`).
        start: start of reading, seconds of the monotonic clock.
    """

    stage: str
    limits: Limits
    prims: int = 0
    triangles: int = 0
    levels: dict[Any, int] = field(default_factory=dict)
    refined: dict[bytes, Any] = field(default_factory=dict)
    skins: dict[Any, Any] = field(default_factory=dict)
    baked_skins: set[Any] = field(default_factory=set)
    links: Any = None
    start: float = field(default_factory=time.monotonic)

    def add_prim(self) -> None:
        """Count one more prim. Raises StageError if a limit is exceeded."""
        self.prims += 1
        if self.prims > self.limits.prims:
            self._stop("prims")
        if time.monotonic() - self.start > self.limits.seconds:
            self._stop("seconds")

    def add_mesh(self, triangles: int) -> None:
        """Count the triangles of one more mesh. Raises StageError if a limit is exceeded."""
        self.triangles += triangles
        if self.triangles > self.limits.triangles:
            self._stop("triangles")

    def _stop(self, name: str) -> None:
        raise StageError(self.stage, [self.limits.exceeded(name)])


_ROOT_ADVICE = "root= (--root) names the folder that may be read"


class RootFolder:
    """The folder that every layer and texture of a stage must be in. Paths are compared after resolving links.

    Args:
        folder: an existing folder, or None: files may be anywhere.

    Raises:
        ArgumentError: not a folder.
    """

    def __init__(self, folder: str | os.PathLike[str] | None) -> None:
        if not isinstance(folder, str | os.PathLike | None):
            raise ArgumentError(f"root={folder!r}: must be a folder")
        self.folder = None if folder is None else Path(folder).resolve()
        if self.folder is not None and not self.folder.is_dir():
            raise ArgumentError(f"root={str(folder)!r} is not a folder")

    def contains(self, file: str) -> bool:
        """Return whether a file, or a file inside a package ("room.usdz[wood.png]"), is in the folder."""
        return self.folder is None or Path(split_package(file)[0]).resolve().is_relative_to(self.folder)

    def refusal(self, file: str) -> str:
        """Return what to say of a file that is not in the folder."""
        return f"@{file}@ is outside {self.folder}; {_ROOT_ADVICE}"

    def check(self, stage: Usd.Stage, name: str) -> None:
        """Raise StageError if any layer of a stage is outside the folder.

        USD opens the layers of value clips when a value of them is read: they are checked after the stage is read.

        Args:
            stage: the stage.
            name: name of the stage in the error message.
        """
        used = [layer.realPath for layer in stage.GetUsedLayers() if not layer.anonymous]
        outside = sorted(path for path in used if path and not self.contains(path))
        if outside:
            problems = [f"layer @{path}@ is outside {self.folder}" for path in outside]
            raise StageError(name, problems, _ROOT_ADVICE)
