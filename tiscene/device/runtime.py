# SPDX-License-Identifier: Apache-2.0
"""Starts Taichi, once. No other module calls ``ti.init``: a second start would destroy every array.

The other modules here do in less time what Taichi 1.7.4, to which the project is pinned, does in Python before kernels.
"""

import contextlib
import io
import os

import taichi as ti

from tiscene.device.taichi_patches import patched_kernel
from tiscene.errors import ArgumentError, DeviceError

ARCHITECTURES = ("cpu", "cuda")

_process: int | None = None  # in which Taichi was started

patched_kernel.install()  # before kernel modules are imported, since their decorators gain by it


def running() -> str | None:
    """The architecture that Taichi runs on, "cpu" or "cuda"; None before the start."""
    if ti.lang.impl.get_runtime().prog is None:
        return None
    return "cuda" if ti.cfg.arch == ti.cuda else "cpu"


def start(arch: str | None = None, threads: int | None = None) -> str:
    """Start Taichi if nobody has; a running one is used as it is. Returns the architecture.

    arch: "cpu" (default) or "cuda". threads: CPU threads, default all.
    Raises ArgumentError for an unknown architecture, DeviceError if Taichi runs on another one or cannot start.
    """
    if arch is not None and arch not in ARCHITECTURES:
        raise ArgumentError(f"arch={arch!r}: must be one of {', '.join(ARCHITECTURES)}")
    check_process()
    global _process
    _process = os.getpid()
    present = running()
    if present is not None:
        if arch not in (None, present):
            raise DeviceError(f"arch={arch!r}, but this process already runs Taichi on {present!r}; use a new process")
        if ti.cfg.fast_math:
            raise DeviceError(
                "this process started Taichi with fast_math=True, which breaks infinities and exact replay; "
                "start it with fast_math=False, or let tiscene start it"
            )
        return present
    wanted = arch or "cpu"
    options = {"cpu_max_num_threads": threads} if threads else {}
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            ti.init(
                arch=getattr(ti, wanted),
                enable_fallback=False,
                fast_math=False,
                advanced_optimization=False,  # LLVM does it all again; the shading kernel compiles 12 times as fast
                log_level=ti.ERROR,
                offline_cache=True,
                **options,
            )
        ti.lang.impl.get_runtime().materialize()  # Taichi insists on this thread; kernels may run in any
    except RuntimeError as error:
        raise DeviceError(f"arch={wanted!r}: Taichi finds no such device here; use arch='cpu'") from error
    return wanted


def check_process() -> None:
    """Raises DeviceError in a fork of the process that started Taichi: kernels would wait there for ever."""
    if _process not in (None, os.getpid()):
        raise DeviceError(
            "this process was forked from one in which Taichi runs, whose threads are not here. Let workers be spawned "
            "(multiprocessing_context='spawn' of a DataLoader), or make the first Stream in the worker"
        )
