# SPDX-License-Identifier: Apache-2.0
"""Record the calls that build a kernel's AST; replay them, simplified, now and in later processes.

Taichi 1.7.4 finds a kernel in its offline cache by the AST, which its Python front end builds from the sources at every
start. Here the calls into Taichi's C++ library that build it are recorded the first time, in a file named by the
`fingerprint` of the sources, and replayed where the fingerprint is the same: the same AST, hence the same cache entry,
in a tenth of the time. What `simplified_calls` leaves out, the compiler need not remove.

What cannot be recorded (fields, prints, functions that are not inlined) is left to Taichi. A recording that fails to
replay is deleted, and Taichi builds the AST.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

from taichi._lib import core
from taichi.lang import impl
from taichi.lang.kernel_impl import AutodiffMode, Kernel

from tiscene.device.taichi_patches.fingerprint import Fingerprint, NoFingerprint, fingerprint
from tiscene.device.taichi_patches.recorded_calls import CALLS, FUNCTIONS, METHODS
from tiscene.device.taichi_patches.recording_file import (
    CONFIG,
    DEBUG_INFO,
    FIRST_CONSTANT,
    KERNEL,
    CallRecording,
    NotRecordable,
    decode,
    encode,
    read_recording,
    write_recording,
)
from tiscene.device.taichi_patches.simplified_calls import simplified

FOLDER = "front_end"  # in the folder of Taichi's cache

# Calls whose results have a type of their own; beginnings of their names.
_TYPED = ("expr_", "make_const_expr_", "value_cast", "ASTBuilder.expr_var", "ASTBuilder.expr_subscript")

_NATIVE = core.Expr.__mro__[-2]  # the base class of all objects of Taichi's library


def materialize(kernel: Kernel, key: Any, args: Any, features: Any) -> None:
    """Create a kernel's AST, as `Kernel.materialize` does, from a recording if there is one.

    Args:
        kernel: The kernel.
        key: The key of `kernel.compiled_kernels`.
        args: The arguments of the call.
        features: What Taichi compiles the kernel for: types of arrays, values of templates.
    """
    kernel.runtime.materialize()
    identity = _fingerprint_of(kernel, key, args, features)
    if identity is None:
        Kernel.materialize(kernel, key=key, args=args, arg_features=features)
        return
    path = Path(impl.current_cfg().offline_cache_file_path, FOLDER, f"{identity.text}.calls")
    recording = read_recording(path)
    if recording is not None:
        if _materialize_from(recording, kernel, key):
            return
        with suppress(OSError):  # whatever is wrong with the file, Taichi can still build the AST
            path.unlink(missing_ok=True)
    with _recording() as recorder:
        Kernel.materialize(kernel, key=key, args=args, arg_features=features)
    if recorder.complete and not kernel.has_print:
        recording = recorder.recording()
        # The replayed kernel takes the place of the one that was recorded: it compiles faster.
        if _materialize_from(recording, kernel, key) and identity.is_current():
            write_recording(path, recording)


def _fingerprint_of(kernel: Kernel, key: Any, args: Any, features: Any) -> Fingerprint | None:
    """Return None where the AST is not to be recorded."""
    config = impl.current_cfg()
    supported = key is not None and kernel.autodiff_mode == AutodiffMode.NONE and not kernel.runtime.inside_kernel
    if not supported or not config.offline_cache or config.debug:
        return None
    try:
        return fingerprint(kernel, args, features)
    except NoFingerprint:
        return None


def _materialize_from(recording: CallRecording, kernel: Kernel, key: Any) -> bool:
    """Replay a recording; return whether it succeeds."""
    name = f"{kernel.func.__name__}_c{kernel.kernel_counter}_{key[1]}"
    try:
        compiled = impl.get_runtime().prog.create_kernel(partial(_replay, recording), name, kernel.autodiff_mode)
    except Exception:  # of whatever type: the recording may be damaged
        return False
    kernel.compiled_kernels[key] = compiled
    return True


def _replay(recording: CallRecording, kernel: Any) -> None:
    """Make the recorded calls."""
    values = [kernel, impl.get_runtime().prog.config(), core.DebugInfo(), *map(decode, recording.constants)]
    calls = {name: _callable(name) for name in set(recording.calls)}
    begin, arguments, append = 0, recording.arguments, values.append
    for name, count in zip(recording.calls, recording.counts, strict=True):
        append(calls[name](*[values[place] for place in arguments[begin : begin + count]]))
        begin += count


def _callable(recorded_name: str) -> Callable[..., Any]:
    """Return what a recorded name stands for: the call's name, then the keywords of its last arguments."""
    name, *keywords = recorded_name.split()
    call = CALLS[name]
    if not keywords:
        return call
    return lambda *values: call(*values[: -len(keywords)], **dict(zip(keywords, values[-len(keywords) :], strict=True)))


class CallRecorder:
    """Records calls of one thread, each as a row: its name and its arguments.

    An argument is ("result", row of the call that returned it), ("constant", JSON text) or ("fixed", place).

    Attributes:
        complete: False once a call had an argument that cannot be recorded.
    """

    def __init__(self) -> None:
        self.complete = True
        self._thread = threading.get_ident()
        self._rows: list[tuple[str, list[tuple[str, Any]]]] = []
        self._row_of_result: dict[int, int] = {}  # by id
        self._alive: list[Any] = []  # results, so that no id is used twice

    def wrap(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function that makes a call and records it under a name."""

        def recorded(*values: Any, **keywords: Any) -> Any:
            result = call(*values, **keywords)
            if self.complete and threading.get_ident() == self._thread:
                try:
                    self._add(" ".join([name, *keywords]), [*values, *keywords.values()], result)
                except NotRecordable:
                    self.complete = False
            return result

        return recorded

    def _add(self, name: str, values: list[Any], result: Any) -> None:
        self._add_result(result, self._add_row(name, values))
        if isinstance(result, list):
            for k, item in enumerate(result):
                if isinstance(item, _NATIVE):
                    self._add_result(item, self._add_row("item", [result, k]))

    def _add_row(self, name: str, values: list[Any]) -> int:
        arguments = [self._argument(value) for value in values]
        self._rows.append((name, arguments))
        return len(self._rows) - 1

    def _add_result(self, result: Any, row: int) -> None:
        if isinstance(result, (_NATIVE, list)):
            self._row_of_result.setdefault(id(result), row)
            self._alive.append(result)

    def _argument(self, value: Any) -> tuple[str, Any]:
        if id(value) in self._row_of_result:
            return "result", self._row_of_result[id(value)]
        for kind, place in ((core.Kernel, KERNEL), (core.CompileConfig, CONFIG), (core.DebugInfo, DEBUG_INFO)):
            if isinstance(value, kind):
                return "fixed", place
        if isinstance(value, (list, tuple)) and any(isinstance(item, (_NATIVE, list)) for item in value):
            return "result", self._add_row("list", list(value))
        return "constant", json.dumps(encode(value))

    def _types(self) -> dict[int, str]:
        """Return the types of expressions that hold numbers, by row."""
        types: dict[int, str] = {}
        for value in self._alive:
            row = self._row_of_result[id(value)]
            if isinstance(value, core.Expr) and self._rows[row][0].startswith(_TYPED):
                types[row] = value.get_rvalue_type().to_string()
        return types

    def recording(self) -> CallRecording:
        """Return the recording, without calls that the compiler would have to undo."""
        rows = simplified(self._rows, self._types())
        constants = dict.fromkeys(content for _, arguments in rows for kind, content in arguments if kind == "constant")
        places = {text: FIRST_CONSTANT + k for k, text in enumerate(constants)}
        first_result = FIRST_CONSTANT + len(places)
        recording = CallRecording([json.loads(text) for text in places])
        for name, arguments in rows:
            recording.calls.append(name)
            recording.counts.append(len(arguments))
            for kind, content in arguments:
                if kind == "result":
                    content += first_result
                elif kind == "constant":
                    content = places[content]
                recording.arguments.append(content)
        return recording


@contextmanager
def _recording() -> Iterator[CallRecorder]:
    """Record the calls into Taichi's library that this thread makes inside the context."""
    recorder = CallRecorder()
    group = core.ExprGroup
    try:
        for name, function in FUNCTIONS.items():
            setattr(core, name, recorder.wrap(name, function))
        for (owner, name), method in METHODS.items():
            setattr(owner, name, recorder.wrap(f"{owner.__name__}.{name}", method))
        core.ExprGroup = recorder.wrap("ExprGroup", group)
        yield recorder
    finally:
        for name, function in FUNCTIONS.items():
            setattr(core, name, function)
        for (owner, name), method in METHODS.items():
            setattr(owner, name, method)
        core.ExprGroup = group
