# SPDX-License-Identifier: Apache-2.0
"""SubprocessReader: run a USD reading function in a child process, with limits of time and memory.

USD itself can hang, crash or exhaust memory on a damaged file, and cannot be interrupted from within a process.
`read_in_subprocess` bounds that: the child process is stopped at the first limit exceeded, and its crash is an ordinary
StageError here. `tiscene.stream.loading` uses the same child process to read a stage while kernels are compiled.

The child (`subprocess_worker`) writes its result to a file: a pickle followed by the raw arrays. The child is not
trusted: only the classes that scenes are made of are unpickled.
"""

from __future__ import annotations

import io
import os
import pickle
import signal
import struct
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar, cast

from pxr import Sdf

from tiscene import errors
from tiscene.errors import StageError, StageWarning, TisceneError
from tiscene.usd.core.limits import Limits
from tiscene.usd.core.report import outer_level

Result = TypeVar("Result")

WORKER_PROGRAM = "import sys; from tiscene.usd.read.subprocess_worker import run; run(*sys.argv[1:])"
ALIGNMENT = 64  # bytes; each part of a result file starts at a multiple of this
EMISSION_FILE = "emission"  # written by the child as soon as emission is known; empty: no material emits
_EMISSION_TIMEOUT = 2.0  # s

# Classes that a result may contain. Any other name in the pickle is refused.
_SCENE_MODULES = (
    "tiscene.scene.animation",
    "tiscene.scene.camera",
    "tiscene.scene.description",
    "tiscene.scene.input_track",
    "tiscene.scene.lens_keyframes",
    "tiscene.scene.light_description",
    "tiscene.scene.material_description",
    "tiscene.scene.room_volume",
    "tiscene.scene.skinned_deformation",
)
_NUMPY_NAMES = {
    ("numpy", "ndarray"),
    ("numpy", "dtype"),
    ("numpy._core.multiarray", "_reconstruct"),
    ("numpy._core.numeric", "_frombuffer"),
}


class SubprocessFailed(StageError):
    """The child process could not start reading; the file itself may be fine."""


def read_in_subprocess(
    function: Callable[..., Result], path: str | Path, options: dict[str, Any], limits: Limits
) -> Result:
    """Return `function(path, **options)`, run in a child process that is stopped at the first limit exceeded.

    Args:
        function: module-level function that reads a USD file. Its result must consist of scene descriptions, arrays and
            built-in types.
        path: the file.
        options: keyword arguments of the function; they must be picklable.
        limits: bounds of time and memory.

    Raises:
        StageError: a limit was exceeded, or the file crashes USD.
        SubprocessFailed: no child process could be started.
        TisceneError: whatever the function raised.
    """
    with SubprocessReader(function, path, options, limits) as reader:
        return cast(Result, reader.result())


class SubprocessReader:
    """A child process that runs `function(path, **options)`. It runs from construction on.

    Use it as a context manager: leaving the block ends the process and deletes its temporary files.
    """

    def __init__(
        self,
        function: Callable[..., Any],
        path: str | Path,
        options: dict[str, Any],
        limits: Limits | None = None,
        *,
        probe_emission: bool = False,
    ) -> None:
        """Start the process.

        Args:
            function: module-level function that reads a USD file.
            path: the file.
            options: keyword arguments of the function.
            limits: bounds of time and memory; None: unlimited.
            probe_emission: whether the child first looks for emissive materials, for `has_emission`.

        Raises:
            SubprocessFailed: no process could be started.
        """
        self._path = str(path)
        self._limits = limits
        self._start = time.monotonic()
        self._folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        self._emission_file = Path(self._folder.name, EMISSION_FILE) if probe_emission else None
        request, self._result_file = Path(self._folder.name, "request"), Path(self._folder.name, "result")
        request.write_bytes(pickle.dumps((os.getpid(), function, self._path, limits, options, probe_emission)))
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-c", WORKER_PROGRAM, str(request), str(self._result_file)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                start_new_session=True,  # Ctrl-C reaches this process only, which then ends the child
                env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
            )
        except OSError as error:
            self._folder.cleanup()
            raise SubprocessFailed(self._path, [f"cannot start a process to read it: {error}"]) from error

    def __enter__(self) -> SubprocessReader:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        with self._process:
            self._process.kill()
        self._folder.cleanup()

    def done(self) -> bool:
        """Return whether the process has ended, with a result or an error."""
        return self._process.poll() is not None

    def has_emission(self, timeout: float = _EMISSION_TIMEOUT) -> bool:
        """Return whether some material of the stage seems to emit light.

        Args:
            timeout: how long to wait for the child's answer, seconds.

        Returns:
            False also if the answer is not there in time or emission was not probed.
        """
        file, end = self._emission_file, time.monotonic() + timeout
        if file is None:
            return False
        while not file.exists() and not self.done() and time.monotonic() < end:
            time.sleep(0.005)
        return file.exists() and file.stat().st_size > 0

    def result(self) -> Any:
        """Wait for the child and return what the function returned; raise its errors and give its warnings.

        Raises:
            StageError: a limit was exceeded, or the file crashes USD.
            SubprocessFailed: the child ended before it started reading.
            TisceneError: whatever the function raised.
        """
        left = None if self._limits is None else max(0.0, self._start + self._limits.seconds - time.monotonic())
        try:
            _, output = self._process.communicate(timeout=left)
        except subprocess.TimeoutExpired:
            assert self._limits is not None
            raise StageError(self._path, [self._limits.exceeded("seconds")]) from None
        code = self._process.returncode
        if code != 0 or not self._result_file.is_file():
            failure = SubprocessFailed if code > 0 else StageError
            raise failure(self._path, [_exit_reason(code, output, self._limits)])
        try:
            kind, content, stage_warnings = _load(self._result_file)
        except (pickle.UnpicklingError, ValueError, TypeError, EOFError, AttributeError, struct.error) as error:
            raise StageError(self._path, [f"the child process returned an invalid result: {error}"]) from None
        for text in stage_warnings:
            warnings.warn(StageWarning(str(text)), stacklevel=outer_level())
        if kind == "result":
            return content
        name, message, stage, problems, advice = content
        if name == "StageError":
            raise StageError(str(stage), [str(problem) for problem in problems], str(advice))
        if name == "MemoryError" and self._limits is not None:
            raise StageError(self._path, [self._limits.exceeded("memory")])
        known = getattr(errors, str(name), None)
        if not (isinstance(known, type) and issubclass(known, TisceneError)):
            unexpected = StageError if self._limits else SubprocessFailed
            raise unexpected(self._path, [f"reading it failed: {name}: {message}"])
        raised = known.__new__(known)
        Exception.__init__(raised, str(message))
        raise raised


def has_unsaved_layers() -> bool:
    """Return whether this process holds unsaved changes of a layer, which a child process would not see."""
    return any(layer.dirty and not layer.anonymous for layer in Sdf.Layer.GetLoadedLayers())


def _exit_reason(code: int, output: bytes, limits: Limits | None) -> str:
    """Return why the child ended without a result, from its exit status and stderr."""
    if limits and code == -getattr(signal, "SIGALRM", 0):
        return limits.exceeded("seconds")
    if limits and (b"bad_alloc" in output or b"MemoryError" in output or code == -getattr(signal, "SIGKILL", 0)):
        return limits.exceeded("memory")
    if code < 0:
        return f"it crashes USD (signal {-code}): the file is damaged or malicious"
    last = output.decode("utf-8", "replace").strip().splitlines()
    return f"the process to read it failed: {last[-1] if last else f'status {code}'}"


class _ResultUnpickler(pickle.Unpickler):
    """An unpickler that refuses every class that is not part of a scene."""

    def find_class(self, module: str, name: str) -> Any:
        found = super().find_class(module, name) if module in _SCENE_MODULES or (module, name) in _NUMPY_NAMES else None
        if (module, name) in _NUMPY_NAMES or (isinstance(found, type) and found.__module__ == module):
            return found
        raise pickle.UnpicklingError(f"{module}.{name} is not part of a scene")


def load_result(file: io.BufferedIOBase, buffers: Any = ()) -> Any:
    """Unpickle a child's result. Raises UnpicklingError for a class that is not part of a scene."""
    return _ResultUnpickler(file, buffers=buffers).load()


def _load(path: Path) -> Any:
    """Read the file that the child has written. Arrays are views of one buffer; nothing is copied."""
    content = bytearray(path.stat().st_size)
    with path.open("rb") as file:
        file.readinto(content)
    view = memoryview(content)
    (count,) = struct.unpack_from("<Q", view)
    offset, parts = 8 * (count + 1), []
    for length in struct.unpack_from(f"<{count}Q", view, 8):
        offset += -offset % ALIGNMENT
        parts.append(view[offset : offset + length])
        offset += length
    return load_result(io.BytesIO(parts[0]), parts[1:])
