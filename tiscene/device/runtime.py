# SPDX-License-Identifier: Apache-2.0
"""Start Taichi, once per process, and check that it is still the one in which arrays were made.

No other module calls ``ti.init``: a second start would destroy every array. A Taichi that the user started is used as
it is. docs/taichi.md describes how tiscene shares a process with the user's own Taichi code.
"""

import contextlib
import functools
import io
import os
import tempfile
from collections.abc import Callable, Iterator
from typing import ParamSpec, TypeVar

import taichi as ti

from tiscene.device import restart
from tiscene.device.taichi_patches import patched_kernel
from tiscene.device.worker_affinity import bind_workers, running_threads
from tiscene.errors import ArgumentError, DeviceError

ARCHITECTURES = ("cpu", "cuda")
VARIABLE = "TISCENE_ARCH"  # the environment variable with the architecture where none is asked for
Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

_process: int | None = None  # in which `start` was called
ONE_THREAD = patched_kernel.LOCK  # no array can be made while a kernel is compiled, by whatever thread

patched_kernel.install()  # before kernel modules are imported, since their decorators gain by it


def one_thread_at_a_time(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Decorate a function so that of all functions so decorated, only one thread at a time runs any.

    Taichi's front end keeps its state in globals: an array cannot be made while another thread compiles a kernel.

    Raises:
        DeviceError: The process was forked, perhaps while another thread held the lock.
    """

    @functools.wraps(function)
    def locked(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        check_process()
        with ONE_THREAD:
            return function(*args, **kwargs)

    return locked


def running() -> str | None:
    """Return the architecture that Taichi runs on, "cpu" or "cuda"; None before the start."""
    if ti.lang.impl.get_runtime().prog is None:
        return None
    return "cuda" if ti.cfg.arch == ti.cuda else "cpu"


@one_thread_at_a_time
def start(arch: str | None = None, threads: int | None = None) -> str:
    """Start Taichi if it does not run yet.

    Args:
        arch: "cpu" or "cuda". None: what Taichi runs on, else the environment variable TISCENE_ARCH, else "cpu".
        threads: CPU threads. None: all.

    Returns:
        The architecture.

    Raises:
        ArgumentError: The architecture is unknown.
        DeviceError: Taichi runs on another architecture or with options that change results, or it cannot start.
    """
    preset = os.environ.get(VARIABLE) or "cpu"
    for name, value in (("arch", arch), (VARIABLE, preset)):
        if value is not None and value not in ARCHITECTURES:
            raise ArgumentError(f"{name}={value!r}: must be one of {', '.join(ARCHITECTURES)}")
    global _process
    _process = os.getpid()
    restart.watch()
    present = running()
    if present is not None:
        if arch not in (None, present):
            raise DeviceError(
                f"arch={arch!r}, but this process already runs Taichi on {present!r}, as the first stream or sampled "
                f"scenario had it. Use a new process, with {VARIABLE}={arch} in its environment"
            )
        _check_options()
        return present
    chosen = arch or preset
    options = {"cpu_max_num_threads": threads} if threads else {}
    others = running_threads()
    try:
        with contextlib.redirect_stdout(io.StringIO()), _usable_cache_folder():
            ti.init(
                arch=getattr(ti, chosen),
                enable_fallback=False,
                fast_math=False,
                advanced_optimization=False,  # LLVM optimizes too; the shading kernel compiles 12 times as fast
                log_level=ti.ERROR,
                **options,
            )
        ti.lang.impl.get_runtime().materialize()  # must happen in this thread; kernels may run in any
    except RuntimeError as error:
        raise DeviceError(f"arch={chosen!r}: Taichi finds no such device here; use arch='cpu'") from error
    if chosen == "cpu":
        bind_workers(running_threads() - others, ti.cfg.cpu_max_num_threads)
    return chosen


@contextlib.contextmanager
def _usable_cache_folder() -> Iterator[None]:
    """Turn Taichi's offline cache off inside the context if its folder cannot be created.

    Taichi 1.7.4 crashes at the exit of the process otherwise. An existing folder that cannot be written is fine.
    """
    variables = {"TI_OFFLINE_CACHE_FILE_PATH": tempfile.gettempdir(), "TI_OFFLINE_CACHE": "0"}
    before = {name: os.environ.get(name) for name in variables}
    folder = before["TI_OFFLINE_CACHE_FILE_PATH"] or ti.lang.impl.default_cfg().offline_cache_file_path
    try:
        os.makedirs(folder, exist_ok=True)
    except OSError:
        os.environ.update(variables)  # they take precedence over arguments of ti.init
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _check_options() -> None:
    """Raise DeviceError if the user started Taichi with options that change the results of tiscene's kernels."""
    runtime = ti.lang.impl.get_runtime()
    given = {"fast_math": ti.cfg.fast_math, "default_fp": runtime.default_fp, "default_ip": runtime.default_ip}
    required = {"fast_math": False, "default_fp": ti.f32, "default_ip": ti.i32}
    for name, value in given.items():
        if value != required[name]:
            text, needed = (
                each if isinstance(each, bool) else f"ti.{each.to_string()}" for each in (value, required[name])
            )
            raise DeviceError(
                f"this process started Taichi with {name}={text}, which changes the results of tiscene's kernels. "
                f"Start it with ti.init({name}={needed}, ...), or let tiscene start it"
            )


def session() -> object:
    """Return a token of the running Taichi, to be passed to `check_session` before arrays made in it are used."""
    return ti.lang.impl.get_runtime()


def check_session(made_in: object) -> None:
    """Check that arrays made in a session can still be used.

    Args:
        made_in: What `session` returned when the arrays were made.

    Raises:
        DeviceError: This process was forked from the one that made them, or Taichi was restarted since.
    """
    check_process()
    if made_in is not session():
        raise restart.destroyed_error()


def check_process() -> None:
    """Raise DeviceError in a fork of the process that started Taichi, where kernels would wait for ever."""
    if _process not in (None, os.getpid()):
        raise DeviceError(
            "this process was forked from one in which Taichi runs, whose threads do not exist here. Spawn workers "
            "instead (multiprocessing_context='spawn' of a DataLoader, context='spawn' of an AsyncVectorEnv), or make "
            "the first Stream in the worker"
        )
