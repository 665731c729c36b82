# SPDX-License-Identifier: Apache-2.0
"""A stage is read, and Taichi started. Where kernels have to be compiled first, another process reads meanwhile."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tiscene.device import runtime
from tiscene.frame.buffers import COLORS
from tiscene.render.renderer import RenderSettings
from tiscene.render.warm_up import rehearsal
from tiscene.scene.description import SceneDescription
from tiscene.usd.read.stage_reader import read_stage
from tiscene.usd.read.subprocess_reader import SubprocessFailed, SubprocessReader, unsaved


def load(
    path: Path, buffers: Sequence[str], quality: RenderSettings, arch: str | None, untrusted: bool, **options: Any
) -> tuple[SceneDescription, str]:
    """`read_stage(path, **options)`, and the architecture. buffers, quality: of the frames of the stage."""
    if not untrusted and _pays(buffers):
        with contextlib.suppress(SubprocessFailed), SubprocessReader(path, options) as reading:
            arch = runtime.start(arch)
            for _ in rehearsal(buffers, quality, reading.glows):
                if reading.done():
                    break
            return reading.result(), arch
    return read_stage(path, untrusted=untrusted, **options), runtime.start(arch)


def _pays(buffers: Sequence[str]) -> bool:
    """Whether there is enough to compile, a processor for it, and another Python that reads the same."""
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    is_python = "python" in Path(sys.executable or "").name.lower() and not hasattr(sys, "frozen")
    much = runtime.running() is None and not COLORS.isdisjoint(buffers)
    return much and processors > 1 and is_python and not unsaved()
