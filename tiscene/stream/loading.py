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
from tiscene.render.render_settings import RenderSettings
from tiscene.render.warm_up import rehearsal
from tiscene.scene.description import SceneDescription
from tiscene.usd.core.limits import Limits
from tiscene.usd.read.stage_reader import read_stage
from tiscene.usd.read.subprocess_reader import SubprocessFailed, SubprocessReader, has_unsaved_layers


def load(
    path: Path,
    buffers: Sequence[str],
    quality: RenderSettings,
    arch: str | None,
    untrusted: bool,
    limits: Limits | None = None,
    **options: Any,
) -> tuple[SceneDescription, str]:
    """`read_stage(path, **options)`, and the architecture. buffers, quality: of the frames of the stage.

    limits: bounds of reading, of trusted files too; with them a file is always read in a child process.
    """
    if not untrusted and _pays(buffers):
        in_child = options | {"limits": limits, "isolate": False}
        with (
            contextlib.suppress(SubprocessFailed),
            SubprocessReader(read_stage, path, in_child, limits, probe_emission=True) as reading,
        ):
            arch = runtime.start(arch)
            for _ in rehearsal(buffers, quality, reading.has_emission):
                if reading.done():
                    break
            return reading.result(), arch
    return read_stage(path, untrusted=untrusted, limits=limits, **options), runtime.start(arch)


def _pays(buffers: Sequence[str]) -> bool:
    """Whether there is enough to compile, a processor for it, and another Python that reads the same."""
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    is_python = "python" in Path(sys.executable or "").name.lower() and not hasattr(sys, "frozen")
    much = runtime.running() is None and not COLORS.isdisjoint(buffers)
    return much and processors > 1 and is_python and not has_unsaved_layers()
