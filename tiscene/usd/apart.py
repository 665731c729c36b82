"""Reading in a process of its own, which hands back arrays: files that may be damaged or hostile, with limits; and any
file while this process does something else."""

from __future__ import annotations

import io
import os
import pickle
import shutil
import struct
import subprocess
import sys
import tempfile
import time
import warnings
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any

from pxr import Sdf, Usd

from tiscene import errors
from tiscene.errors import StageError, StageWarning, TisceneError
from tiscene.files import write_atomically
from tiscene.scene.texture_copies import coarser_copies
from tiscene.usd.limits import Limits

_PROGRAM = "import sys; from tiscene.usd.apart import read_here; read_here(*sys.argv[1:])"
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


# Numbers and arrays begin at multiples of so many bytes of a result.
_STEP = 64
_GLOWS = "glows"  # a file, empty for no
_MOMENT = 2.0  # s
_KILLED = -9  # what a process returns that the system stopped (SIGKILL, which Windows does not know)


class NoAnswer(StageError):
    """The other process could not even begin."""


class Reading:
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
            raise NoAnswer(self._path, [f"no process to read it in: {error}"]) from error

    def __enter__(self) -> Reading:
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
        said, end = Path(self._folder.name, _GLOWS), time.monotonic() + _MOMENT
        while not said.exists() and not self.done() and time.monotonic() < end:
            time.sleep(0.005)
        return said.exists() and said.stat().st_size > 0

    def result(self) -> Any:
        """What was read. Its errors and warnings are given here.

        Raises StageError too for a file that crashes USD, or takes more time or memory than it may; NoAnswer.
        """
        left = None if self._limits is None else max(0.0, self._began + self._limits.seconds - time.monotonic())
        try:
            _, said = self._process.communicate(timeout=left)
        except subprocess.TimeoutExpired:
            assert self._limits is not None
            raise StageError(self._path, [f"reading it took longer than {self._limits.seconds:g} s"]) from None
        code = self._process.returncode
        if code != 0 or not self._result.is_file():
            refused = NoAnswer if code > 0 else StageError
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


def read_here(request: str, result: str) -> None:
    """What the other process does. request, result: files."""
    asked_by, path, limits, options = pickle.loads(Path(request).read_bytes())
    if limits is not None:
        _limit(limits)
    from tiscene.usd import read_stage

    stage = _looked_at(path, options.get("variants"), Path(result).with_name(_GLOWS)) if limits is None else None
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
    from tiscene.usd.stage import open_stage, quiet

    try:
        with quiet():
            stage = open_stage(path, variants)
            prims = (prim for root in (stage.GetPseudoRoot(), *stage.GetPrototypes()) for prim in Usd.PrimRange(root))
            colors = (prim.GetAttribute("inputs:emissiveColor") for prim in prims)
            glows = any(each and (each.HasAuthoredConnections() or any(each.Get() or ())) for each in colors)
    except TisceneError:  # which reading it gives again
        return None
    write_atomically(answer, b"glows" if glows else b"")
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
            file.write(bytes(-len(part) % _STEP))


def _loaded(path: Path) -> Any:
    """What `_dump` has written. Arrays are where they were read to; nothing is copied."""
    content = bytearray(path.stat().st_size)
    with path.open("rb") as file:
        file.readinto(content)
    view = memoryview(content)
    (count,) = struct.unpack_from("<Q", view)
    at, parts = 8 * (count + 1), []
    for length in struct.unpack_from(f"<{count}Q", view, 8):
        at += -at % _STEP
        parts.append(view[at : at + length])
        at += length
    return _ResultReader(io.BytesIO(parts[0]), buffers=parts[1:]).load()


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
