# SPDX-License-Identifier: Apache-2.0
"""The child process of `subprocess_reader`: reads a stage within limits and writes the result to a file."""

from __future__ import annotations

import os
import pickle
import shutil
import struct
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

from pxr import Usd

from tiscene.errors import StageError, StageWarning, TisceneError
from tiscene.files import write_atomically
from tiscene.scene.textures.mipmaps import coarser_copies
from tiscene.usd.core.limits import Limits
from tiscene.usd.core.stage import open_stage, quiet
from tiscene.usd.read.stage_reader import read_stage
from tiscene.usd.read.subprocess_reader import ALIGNMENT, EMISSION_FILE


def read_here(request: str, result: str) -> None:
    """What the other process does. request, result: files."""
    asked_by, path, limits, options = pickle.loads(Path(request).read_bytes())
    if limits is not None:
        _limit(limits)
    stage = _looked_at(path, options.get("variants"), Path(result).with_name(EMISSION_FILE)) if limits is None else None
    answer: Any
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            description = read_stage(path, limits=limits, **options)
            textures = tuple(replace(each, copies=coarser_copies(each)) for each in description.textures)
            answer = ("read", replace(description, textures=textures))
        except TisceneError as error:
            stage, problems = (error.stage, error.problems) if isinstance(error, StageError) else ("", ())
            answer = ("error", (type(error).__name__, str(error), stage, problems))
    del stage
    told = [str(each.message) for each in caught if isinstance(each.message, StageWarning)]
    if _is_gone(asked_by):  # nobody else takes its things away
        shutil.rmtree(Path(result).parent, ignore_errors=True)
    else:
        _dump((*answer, told), Path(result))


def _is_gone(process: int) -> bool:
    """Whether a process was killed. Not asked on Windows, where signal 0 is Ctrl-C."""
    try:
        if os.name == "posix":
            os.kill(process, 0)
    except ProcessLookupError:
        return True
    except OSError:  # it is there, and somebody else's
        pass
    return False


def _looked_at(path: str, variants: Any, answer: Path) -> Usd.Stage | None:
    """Say at once whether any material seems to glow. Returns the stage, which then is open; None if it is wrong."""
    try:
        with quiet():
            stage = open_stage(path, variants)
            prims = (prim for root in (stage.GetPseudoRoot(), *stage.GetPrototypes()) for prim in Usd.PrimRange(root))
            colors = (prim.GetAttribute("inputs:emissiveColor") for prim in prims)
            glows = any(each and (each.HasAuthoredConnections() or any(each.Get() or ())) for each in colors)
    except TisceneError:  # which reading it gives again
        return None
    write_atomically(answer, b"emits" if glows else b"")
    return stage


def _dump(answer: Any, path: Path) -> None:
    """Write a pickle and, behind it, the arrays that it refers to: how many parts, how long each is, the parts."""
    buffers: list[pickle.PickleBuffer] = []
    head = pickle.dumps(answer, protocol=5, buffer_callback=buffers.append)
    parts = [memoryview(head), *(buffer.raw() for buffer in buffers)]
    lengths = struct.pack(f"<{len(parts) + 1}Q", len(parts), *map(len, parts))
    with path.open("wb") as file:
        for part in (memoryview(lengths), *parts):
            file.write(part)
            file.write(bytes(-len(part) % ALIGNMENT))


def _limit(limits: Limits) -> None:
    """Bounds by the operating system, where it has such."""
    try:
        import resource
    except ImportError:
        return
    seconds = int(limits.seconds) + 1
    for kind, most in (
        (resource.RLIMIT_AS, limits.memory),
        (resource.RLIMIT_CPU, seconds * 64),  # of all threads
        (resource.RLIMIT_FSIZE, limits.memory),
        (resource.RLIMIT_CORE, 0),
    ):
        _, hard = resource.getrlimit(kind)
        most = most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(kind, (most, hard))
