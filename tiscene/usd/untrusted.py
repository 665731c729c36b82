"""Reading files that may be damaged or hostile: in a process of their own, with limits, that hands back arrays."""

from __future__ import annotations

import io
import pickle
import signal
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any

from tiscene import errors
from tiscene.errors import StageError, StageWarning, TisceneError
from tiscene.usd.limits import Limits

_PROGRAM = "import sys; from tiscene.usd.untrusted import read_here; read_here(*sys.argv[1:])"
# What a result may be made of. Whatever else a pickle names is refused: the process that wrote it is not trusted.
_MODULES = ("tiscene.scene.description", "tiscene.scene.animation", "tiscene.camera")
_NAMES = {
    ("numpy", "ndarray"),
    ("numpy", "dtype"),
    ("numpy._core.multiarray", "_reconstruct"),
    ("numpy.core.multiarray", "_reconstruct"),
    ("numpy._core.numeric", "_frombuffer"),
    ("numpy.core.numeric", "_frombuffer"),
}


def read_apart(path: str | Path, limits: Limits, **options: Any) -> Any:
    """`read_stage(path, limits=limits, **options)` in a process of its own. Its errors and warnings are given here.

    Raises StageError too for a file that crashes USD, or takes more time or memory than it may.
    """
    with tempfile.TemporaryDirectory() as folder:
        request, result = Path(folder, "request"), Path(folder, "result")
        request.write_bytes(pickle.dumps((str(path), limits, options)))
        command = [sys.executable, "-c", _PROGRAM, str(request), str(result)]
        try:
            done = subprocess.run(command, capture_output=True, timeout=limits.seconds, check=False)
        except subprocess.TimeoutExpired:
            raise StageError(str(path), [f"reading it took longer than {limits.seconds:g} s"]) from None
        if done.returncode != 0 or not result.is_file():
            raise StageError(str(path), [_reason(done.returncode, done.stderr, limits)])
        try:
            answer = _ResultReader(io.BytesIO(result.read_bytes())).load()
            kind, content, told = answer
        except (pickle.UnpicklingError, ValueError, TypeError, EOFError, AttributeError) as error:
            raise StageError(str(path), [f"the process that read it answered nonsense: {error}"]) from None
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


def _reason(code: int, said: bytes, limits: Limits) -> str:
    if b"MemoryError" in said or b"bad_alloc" in said or code == -signal.SIGKILL:
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


def read_here(request: str, result: str) -> None:
    """What the other process does. request, result: files with pickles."""
    path, limits, options = pickle.loads(Path(request).read_bytes())
    _limit(limits)
    from tiscene.usd import read_stage

    answer: Any
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            answer = ("read", read_stage(path, limits=limits, **options))
        except TisceneError as error:
            stage, problems = (error.stage, error.problems) if isinstance(error, StageError) else ("", ())
            answer = ("error", (type(error).__name__, str(error), stage, problems))
    told = [str(each.message) for each in caught if isinstance(each.message, StageWarning)]
    Path(result).write_bytes(pickle.dumps((*answer, told)))


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
