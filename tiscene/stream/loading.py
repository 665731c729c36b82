# SPDX-License-Identifier: Apache-2.0
"""Read a stage and start Taichi, at the same time where that saves time.

Before a first frame, kernels are compiled and the stage is read. If both take long, a child process reads the stage
while this process compiles.
"""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tiscene.device import runtime
from tiscene.frame.buffers import COLORS
from tiscene.render.render_settings import RenderSettings
from tiscene.render.warm_up import warm_up_steps
from tiscene.scene.description import SceneDescription
from tiscene.usd.core.limits import Limits
from tiscene.usd.read.stage_reader import read_stage
from tiscene.usd.read.subprocess_reader import SubprocessFailed, SubprocessReader, has_unsaved_layers


def load(
    path: Path,
    buffers: Sequence[str],
    settings: RenderSettings,
    arch: str | None,
    untrusted: bool,
    limits: Limits | None = None,
    **options: Any,
) -> tuple[SceneDescription, str]:
    """Read a stage and start Taichi.

    Args:
        path: the stage.
        buffers: of the frames to come; they decide which kernels are compiled.
        settings: of the frames to come.
        arch: "cpu", "cuda" or None for the default.
        untrusted: read in a child process with limits, and with the file's folder as root.
        limits: bounds of time and memory, for trusted files too; a file is then always read in a child process.
        **options: further arguments of `read_stage`.

    Returns:
        The stage and the architecture.

    Raises:
        MissingFile, StageError, DeviceError: as `read_stage` and `runtime.start` do.
    """
    if not untrusted and is_worth_a_process(buffers):
        in_child = options | {"limits": limits, "isolate": False}
        with (
            contextlib.suppress(SubprocessFailed),
            SubprocessReader(read_stage, path, in_child, limits, probe_emission=True) as reading,
        ):
            arch = runtime.start(arch)
            _warm_up(buffers, settings, reading)
            return reading.result(), arch
    return read_stage(path, untrusted=untrusted, limits=limits, **options), runtime.start(arch)


@runtime.one_thread_at_a_time
def _warm_up(buffers: Sequence[str], settings: RenderSettings, reading: SubprocessReader) -> None:
    """Compile kernels until the stage has been read."""
    for _ in warm_up_steps(buffers, settings, reading.has_emission):
        if reading.done():
            break


def is_worth_a_process(buffers: Sequence[str]) -> bool:
    """Return whether kernels must be compiled, a second processor is free, and a child process reads the same stage."""
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    is_python = "python" in Path(sys.executable or "").name.lower() and not hasattr(sys, "frozen")
    must_compile = runtime.running() is None and not COLORS.isdisjoint(buffers)
    return must_compile and processors > 1 and is_python and not has_unsaved_layers()
