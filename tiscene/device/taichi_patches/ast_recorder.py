# SPDX-License-Identifier: Apache-2.0
"""What Taichi's front end tells the builder of a kernel is kept beside Taichi's cache; the next process tells it again.

Taichi 1.7.4 finds a kernel in its cache by the syntax tree that it makes in Python from all sources, at every start.
Here the calls by which the tree is made are written down the first time, under the fingerprint of the sources, and made
again where that is the same: the same tree, and so the same name in Taichi's cache, in a tenth of the time. What cannot
be written down (a field, a print, a function that is not inlined) is left to Taichi.
"""

from __future__ import annotations

import json
import operator
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from taichi._lib import core
from taichi.lang import impl
from taichi.lang.kernel_impl import AutodiffMode, Kernel

from tiscene.device.taichi_patches.fingerprint import Fingerprint, NoFingerprint, fingerprint
from tiscene.device.taichi_patches.recording_file import (
    CONFIG,
    FIRST,
    KERNEL,
    PLACE,
    NotKept,
    Tape,
    decoded,
    encoded,
    read_tape,
    write_tape,
)

FOLDER = "front_end"  # in that of Taichi's cache

_BOUND = core.Expr.__mro__[-2]  # what all objects of Taichi's library are
# What makes expressions, what puts them together, and what says what a kernel takes and gives.
_FUNCTIONS = {
    name: function
    for name, function in vars(core).items()
    if type(function) is type(len)
    and str(function.__doc__).split("\n")[0].endswith((".Expr", ".Expr]", ".TypeFactory"))
}
_TOLD = {
    core.ASTBuilder: ("",),
    core.Expr: ("type_check",),
    core.ExprGroup: ("push_back",),
    core.TypeFactory: ("get_",),
    core.Kernel: ("insert_", "finalize_", "ast_builder"),
}
_METHODS = {
    (kind, name): method
    for kind, wanted in _TOLD.items()
    for name, method in vars(kind).items()
    if not name.startswith("_") and name.startswith(wanted)
}
_CALLS: dict[str, Callable[..., Any]] = {
    **_FUNCTIONS,
    **{f"{kind.__name__}.{name}": method for (kind, name), method in _METHODS.items()},
    "ExprGroup": core.ExprGroup,
    "item": operator.getitem,
    "list": lambda *values: list(values),
}
# These change something. Of the others those are made again whose results are asked for.
_EFFECTS = {
    f"{kind.__name__}.{name}" for kind, name in _METHODS if kind is not core.TypeFactory and name != "ast_builder"
}


def prepare(kernel: Kernel, key: Any, args: Any, features: Any, own_way: Callable[..., None]) -> None:
    """Make a kernel's syntax tree, as Taichi's `Kernel.materialize`, which is the own way."""
    kernel.runtime.materialize()
    made_of = _made_of(kernel, key, args, features)
    if made_of is None:
        own_way(kernel, key=key, args=args, arg_features=features)
        return
    path = Path(impl.current_cfg().offline_cache_file_path, FOLDER, f"{made_of.text}.calls")
    tape = read_tape(path)
    if tape is not None:
        name = f"{kernel.func.__name__}_c{kernel.kernel_counter}_{key[1]}"
        program = impl.get_runtime().prog
        kernel.compiled_kernels[key] = program.create_kernel(partial(_play, tape), name, kernel.autodiff_mode)
        return
    with _recording() as reel:
        own_way(kernel, key=key, args=args, arg_features=features)
    if reel.kept and not kernel.has_print and made_of.is_true():
        write_tape(path, reel.tape())


def _made_of(kernel: Kernel, key: Any, args: Any, features: Any) -> Fingerprint | None:
    """None where the tree is not to be kept."""
    config = impl.current_cfg()
    plain = key is not None and kernel.autodiff_mode == AutodiffMode.NONE and not kernel.runtime.inside_kernel
    if not plain or not config.offline_cache or config.debug:
        return None
    try:
        return fingerprint(kernel, args, features)
    except NoFingerprint:
        return None


def _play(tape: Tape, kernel: Any) -> None:
    """Make the calls again."""
    values = [kernel, impl.get_runtime().prog.config(), core.DebugInfo(), *map(decoded, tape.constants)]
    calls = {name: _call(name) for name in set(tape.calls)}
    at, arguments, add = 0, tape.arguments, values.append
    for name, count in zip(tape.calls, tape.counts, strict=True):
        add(calls[name](*[values[place] for place in arguments[at : at + count]]))
        at += count


def _call(said: str) -> Callable[..., Any]:
    """What is called, by its name and by the names of its last arguments that are given by name."""
    name, *keywords = said.split()
    call = _CALLS[name]
    if not keywords:
        return call
    return lambda *values: call(*values[: -len(keywords)], **dict(zip(keywords, values[-len(keywords) :], strict=True)))


class _Reel:
    """A tape in the making. kept: whether all could be written down. Arguments of rows: the number of the row whose
    result it is, a constant in words, or what is always there."""

    def __init__(self) -> None:
        self.kept = True
        self._rows: list[tuple[str, list[tuple[str, Any]]]] = []
        self._results: dict[int, int] = {}
        self._alive: list[Any] = []
        self._checked: set[int] = set()

    def recorded(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """The call, and its row."""

        def recorded(*values: Any, **named: Any) -> Any:
            result = call(*values, **named)
            if self.kept:
                try:
                    self._add(" ".join([name, *named]), [*values, *named.values()], result)
                except NotKept:
                    self.kept = False
            return result

        return recorded

    def _add(self, call: str, values: list[Any], result: Any) -> None:
        if call == "Expr.type_check":  # which changes nothing the second time
            if id(values[0]) in self._checked:
                return
            self._checked.add(id(values[0]))
        self._know(result, self._row(call, values))
        if isinstance(result, list):
            for k, each in enumerate(result):
                if isinstance(each, _BOUND):
                    self._know(each, self._row("item", [result, k]))

    def _row(self, call: str, values: list[Any]) -> int:
        arguments = [self._argument(value) for value in values]
        self._rows.append((call, arguments))
        return len(self._rows) - 1

    def _know(self, result: Any, row: int) -> None:
        if isinstance(result, (_BOUND, list)):
            self._results.setdefault(id(result), row)
            self._alive.append(result)

    def _argument(self, value: Any) -> tuple[str, Any]:
        if id(value) in self._results:
            return "result", self._results[id(value)]
        for kind, place in ((core.Kernel, KERNEL), (core.CompileConfig, CONFIG), (core.DebugInfo, PLACE)):
            if isinstance(value, kind):
                return "always", place
        if isinstance(value, (list, tuple)) and any(isinstance(each, (_BOUND, list)) for each in value):
            return "result", self._row("list", list(value))
        return "constant", json.dumps(encoded(value))

    def tape(self) -> Tape:
        """Without calls that change nothing and whose results nobody takes."""
        needed = [call.split()[0] in _EFFECTS for call, _ in self._rows]
        for row in range(len(self._rows) - 1, -1, -1):
            if needed[row]:
                for kind, what in self._rows[row][1]:
                    if kind == "result":
                        needed[what] = True
        rows = [row for row, wanted in zip(self._rows, needed, strict=True) if wanted]
        constants = dict.fromkeys(what for _, arguments in rows for kind, what in arguments if kind == "constant")
        places = {words: FIRST + k for k, words in enumerate(constants)}
        results = FIRST + len(places) + np.cumsum([False, *needed])
        tape = Tape([json.loads(words) for words in places])
        for call, arguments in rows:
            tape.calls.append(call)
            tape.counts.append(len(arguments))
            for kind, what in arguments:
                place = int(results[what]) if kind == "result" else places[what] if kind == "constant" else what
                tape.arguments.append(place)
        return tape


@contextmanager
def _recording() -> Iterator[_Reel]:
    """Write down what Taichi's library is told."""
    reel = _Reel()
    group = core.ExprGroup
    try:
        for name, function in _FUNCTIONS.items():
            setattr(core, name, reel.recorded(name, function))
        for (kind, name), method in _METHODS.items():
            setattr(kind, name, reel.recorded(f"{kind.__name__}.{name}", method))
        core.ExprGroup = reel.recorded("ExprGroup", group)
        yield reel
    finally:
        for name, function in _FUNCTIONS.items():
            setattr(core, name, function)
        for (kind, name), method in _METHODS.items():
            setattr(kind, name, method)
        core.ExprGroup = group
