# SPDX-License-Identifier: Apache-2.0
"""SubprocessReader in a process of its own, which hands back arrays: files that may be damaged or hostile, with limits; and any
file while this process does something else."""

from __future__ import annotations

import io
import os
import pickle
import struct
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path
from types import TracebackType
from typing import Any

from pxr import Sdf

from tiscene import errors
from tiscene.errors import StageError, StageWarning, TisceneError
from tiscene.usd.core.limits import Limits

_PROGRAM = "import sys; from tiscene.usd.read.subprocess_worker import read_here; read_here(*sys.argv[1:])"
# What a result may be made of. Whatever else a pickle names is refused: the process that wrote it is not trusted.
_MODULES = ("tiscene.scene.description", "tiscene.scene.animation", "tiscene.scene.camera")
_NAMES = {
    ("numpy", "ndarray"),
    ("numpy", "dtype"),
    ("numpy._core.multiarray", "_reconstruct"),
    ("numpy.core.multiarray", "_reconstruct"),
    ("numpy._core.numeric", "_frombuffer"),
    ("numpy.core.numeric", "_frombuffer"),
}


ALIGNMENT = 64  # bytes; the parts of a result start at multiples of this
EMISSION_FILE = "emission"  # exists once it is known; empty: no material emits
_MOMENT = 2.0  # s
_KILLED = -9  # what a process returns that the system stopped (SIGKILL, which Windows does not know)


class SubprocessFailed(StageError):
    """The other process could not even begin."""


class SubprocessReader:
    """`read_stage(path, **options)` in a process of its own, which has begun. To be used in a `with`, which ends it."""

    def __init__(self, path: str | Path, options: dict[str, Any], limits: Limits | None = None) -> None:
        """limits: what the process may take of time and memory; None: what it likes."""
        self._path = str(path)
        self._limits = limits
        self._began = time.monotonic()
        self._folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        request, self._result = Path(self._folder.name, "request"), Path(self._folder.name, "result")
        request.write_bytes(pickle.dumps((os.getpid(), self._path, limits, options)))
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-c", _PROGRAM, str(request), str(self._result)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                start_new_session=True,  # Ctrl-C is for this process, which then ends the other
                env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
            )
        except OSError as error:
            self._folder.cleanup()
            raise SubprocessFailed(self._path, [f"no process to read it in: {error}"]) from error

    def __enter__(self) -> SubprocessReader:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        with self._process:
            self._process.kill()
        self._folder.cleanup()

    def done(self) -> bool:
        """Whether the result is there, or an error."""
        return self._process.poll() is not None

    def glows(self) -> bool:
        """Whether some material of the stage seems to give light; False if nobody can say so in a moment."""
        said, end = Path(self._folder.name, EMISSION_FILE), time.monotonic() + _MOMENT
        while not said.exists() and not self.done() and time.monotonic() < end:
            time.sleep(0.005)
        return said.exists() and said.stat().st_size > 0

    def result(self) -> Any:
        """What was read. Its errors and warnings are given here.

        Raises StageError too for a file that crashes USD, or takes more time or memory than it may; SubprocessFailed.
        """
        left = None if self._limits is None else max(0.0, self._began + self._limits.seconds - time.monotonic())
        try:
            _, said = self._process.communicate(timeout=left)
        except subprocess.TimeoutExpired:
            assert self._limits is not None
            raise StageError(self._path, [f"reading it took longer than {self._limits.seconds:g} s"]) from None
        code = self._process.returncode
        if code != 0 or not self._result.is_file():
            refused = SubprocessFailed if code > 0 else StageError
            raise refused(self._path, [_reason(code, said, self._limits)])
        try:
            kind, content, told = _loaded(self._result)
        except (pickle.UnpicklingError, ValueError, TypeError, EOFError, AttributeError, struct.error) as error:
            raise StageError(self._path, [f"the process that read it answered nonsense: {error}"]) from None
        for text in told:
            warnings.warn(StageWarning(str(text)), stacklevel=3)
        if kind == "read":
            return content
        name, message, stage, problems = content
        if name == "StageError":
            raise StageError(str(stage), [str(problem) for problem in problems])
        known = getattr(errors, str(name), TisceneError)
        refusal = known.__new__(known)
        Exception.__init__(refusal, str(message))
        raise refusal


def unsaved() -> bool:
    """Whether this process has changed a layer that another one would read as it is on disk."""
    return any(layer.dirty and not layer.anonymous for layer in Sdf.Layer.GetLoadedLayers())


def _reason(code: int, said: bytes, limits: Limits | None) -> str:
    if limits and (b"MemoryError" in said or b"bad_alloc" in said or code == _KILLED):
        return f"reading it took more memory than {limits.memory / 2**30:.3g} GiB"
    if code < 0:
        return f"it crashes USD (signal {-code}): it is damaged, or made to do harm"
    last = said.decode("utf-8", "replace").strip().splitlines()
    return f"reading it failed: {last[-1] if last else f'status {code}'}"


class _ResultReader(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        found = super().find_class(module, name) if module in _MODULES or (module, name) in _NAMES else None
        if (module, name) in _NAMES or (isinstance(found, type) and found.__module__ == module):
            return found
        raise pickle.UnpicklingError(f"{module}.{name} is no part of a scene")


def _loaded(path: Path) -> Any:
    """What `_dump` has written. Arrays are where they were read to; nothing is copied."""
    content = bytearray(path.stat().st_size)
    with path.open("rb") as file:
        file.readinto(content)
    view = memoryview(content)
    (count,) = struct.unpack_from("<Q", view)
    at, parts = 8 * (count + 1), []
    for length in struct.unpack_from(f"<{count}Q", view, 8):
        at += -at % ALIGNMENT
        parts.append(view[at : at + length])
        at += length
    return _ResultReader(io.BytesIO(parts[0]), buffers=parts[1:]).load()
