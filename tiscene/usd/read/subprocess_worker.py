# SPDX-License-Identifier: Apache-2.0
"""The child process of `subprocess_reader`: run a reading function within limits and write its result to a file.

The operating system enforces the limits (address space, CPU time, file size, an alarm), so that they hold even where
USD hangs, and where the parent process is gone.
"""

from __future__ import annotations

import math
import os
import pickle
import shutil
import signal
import struct
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

from pxr import Usd

from tiscene.errors import StageError, StageWarning
from tiscene.files import write_atomically
from tiscene.scene.description import SceneDescription
from tiscene.scene.textures.mipmaps import coarser_copies
from tiscene.usd.core.limits import Limits
from tiscene.usd.core.prims import distinct_prims
from tiscene.usd.core.stage import open_stage, quiet
from tiscene.usd.read.subprocess_reader import ALIGNMENT, EMISSION_FILE

_ALARM_DELAY = 5  # s after the time limit, when the parent should have stopped this process already
_MAX_THREADS = 64  # threads that the limit of CPU time allows for


def run(request: str, result: str) -> None:
    """Run the requested function and write its result, or its error. Main function of the child process.

    Args:
        request: file that `SubprocessReader` has written.
        result: file to write.
    """
    parent, function, path, limits, options, probe_emission = pickle.loads(Path(request).read_bytes())
    if limits is not None:
        apply_limits(limits)
    answer: Any
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            variants, emission_file = options.get("variants"), Path(result).with_name(EMISSION_FILE)
            stage = _probe_emission(path, variants, emission_file) if probe_emission else None
            answer = ("result", _with_mipmaps(function(path, **options)))
            del stage  # kept open until here: opening its layers again costs nothing
        except Exception as error:
            refusal = error if isinstance(error, StageError) else StageError("", ())
            facts = refusal.stage, refusal.problems, refusal.advice
            answer = ("error", (type(error).__name__, str(error), *facts))
    texts = [str(each.message) for each in caught if isinstance(each.message, StageWarning)]
    if _has_ended(parent):  # then this process has to delete the temporary files
        shutil.rmtree(Path(result).parent, ignore_errors=True)
    else:
        _write_result((*answer, texts), Path(result))


def apply_limits(limits: Limits) -> None:
    """Let the operating system stop this process at limits of time and memory. Does nothing on Windows."""
    try:
        import resource
    except ImportError:
        return
    seconds = math.ceil(limits.seconds)
    signal.alarm(seconds + _ALARM_DELAY)  # SIGALRM ends a process that does not handle it
    for kind, bound in (
        (resource.RLIMIT_AS, limits.memory),
        (resource.RLIMIT_CPU, seconds * _MAX_THREADS),
        (resource.RLIMIT_FSIZE, limits.memory),
        (resource.RLIMIT_CORE, 0),
    ):
        _, hard = resource.getrlimit(kind)
        bound = bound if hard == resource.RLIM_INFINITY else min(bound, hard)
        resource.setrlimit(kind, (bound, hard))


def _with_mipmaps(result: Any) -> Any:
    """Return a scene description with the coarser copies of its textures; any other result as it is."""
    if not isinstance(result, SceneDescription):
        return result
    return replace(result, textures=tuple(replace(each, copies=coarser_copies(each)) for each in result.textures))


def _has_ended(process: int) -> bool:
    """Return whether a process is gone. False on Windows, where signal 0 is Ctrl-C."""
    try:
        if os.name == "posix":
            os.kill(process, 0)
    except ProcessLookupError:
        return True
    except OSError:  # it exists, and belongs to another user
        pass
    return False


def _probe_emission(path: str, variants: Any, file: Path) -> Usd.Stage | None:
    """Write at once whether any material seems to emit light: an empty file for no.

    Returns:
        The open stage; None if it cannot be read, which the reading function reports.
    """
    stage, emits = None, False
    try:
        with quiet():
            stage = open_stage(path, variants)
            colors = (prim.GetAttribute("inputs:emissiveColor") for prim in distinct_prims(stage))
            emits = any(
                each and (each.HasAuthoredConnections() or each.GetNumTimeSamples() or any(each.Get() or ()))
                for each in colors
            )
    except Exception:
        return None
    write_atomically(file, b"emits" if emits else b"")
    return stage


def _write_result(answer: Any, path: Path) -> None:
    """Write a pickle and, behind it, its arrays: number of parts, length of each part (uint64), the parts."""
    buffers: list[pickle.PickleBuffer] = []
    head = pickle.dumps(answer, protocol=5, buffer_callback=buffers.append)
    parts = [memoryview(head), *(buffer.raw() for buffer in buffers)]
    lengths = struct.pack(f"<{len(parts) + 1}Q", len(parts), *map(len, parts))
    with path.open("wb") as file:
        for part in (memoryview(lengths), *parts):
            file.write(part)
            file.write(bytes(-len(part) % ALIGNMENT))
