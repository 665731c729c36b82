"""What Taichi's front end tells the builder of a kernel is kept beside Taichi's cache; the next process tells it again.

Taichi 1.7.4 finds a kernel in its cache by the syntax tree that it makes in Python from all sources, at every start.
Here the calls by which the tree is made are written down the first time, under the fingerprint of the sources, and made
again where that is the same: the same tree, and so the same name in Taichi's cache, in a tenth of the time. What cannot
be written down (a field, a print) is left to Taichi.
"""

from __future__ import annotations

import json
import operator
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from taichi._lib import core
from taichi.lang import impl
from taichi.lang.kernel_impl import AutodiffMode, Func, Kernel

from tiscene.device.fingerprints import Fingerprint, NoFingerprint, fingerprint
from tiscene.device.tapes import CONFIG, FIRST, OWNER, PLACE, NotKept, Tape, decoded, encoded, read_tapes, write_tapes

FOLDER = "front_end"  # in that of Taichi's cache

_BOUND = core.Expr.__mro__[-2]  # what all objects of Taichi's library are
# What makes expressions, what puts them together, and what says what a kernel or function takes and gives.
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
    core.Function: ("insert_", "finalize_", "ast_builder"),
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

_functions: dict[int, tuple[Any, list[Tape]]] = {}  # not inlined ones, by id: with the tapes of those they call, first
_compile = Func.do_compile


def prepare(kernel: Kernel, key: Any, args: Any, features: Any, own_way: Callable[..., None]) -> None:
    """Make a kernel's syntax tree, as Taichi's `Kernel.materialize`, which is the own way."""
    kernel.runtime.materialize()
    made_of = _made_of(kernel, key, args, features)
    if made_of is None:
        own_way(kernel, key=key, args=args, arg_features=features)
        return
    path = Path(impl.current_cfg().offline_cache_file_path, FOLDER, f"{made_of.text}.calls")
    tapes = read_tapes(path)
    if tapes is not None and all(_function(tape, made_of) for tape in tapes[:-1]):
        name = f"{kernel.func.__name__}_c{kernel.kernel_counter}_{key[1]}"
        kernel.compiled_kernels[key] = impl.get_runtime().prog.create_kernel(
            lambda made: _play(tapes[-1], made, made_of), name, kernel.autodiff_mode
        )
        return
    with _recording() as recorder:
        own_way(kernel, key=key, args=args, arg_features=features)
    if recorder.kept and not kernel.has_print and made_of.is_true():
        write_tapes(path, recorder.tapes())


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


def _function(tape: Tape, made_of: Fingerprint) -> bool:
    """Make a function that is not inlined, if it is not there. False if the sources have none of this name."""
    function = made_of.functions.get((tape.name[0], tape.name[1]))
    if function is None:
        return False
    instance = _instance(function, tape.name[2])
    if function.compiled is None:
        function.compiled = {}
    if instance not in function.compiled:
        key = core.FunctionKey(function.func.__name__, function.func_id, instance)
        made = impl.get_runtime().prog.create_function(key)
        function.taichi_functions[instance] = made
        function.compiled[instance] = lambda: _play(tape, made, made_of)
        made.set_function_body(function.compiled[instance])
        called = [_found(words[1:], made_of) for words in tape.constants if _is_function(words)]
        _functions[id(made)] = made, _together([*(_functions[id(each)][1] for each in called), [tape]])
    return True


def _instance(function: Func, features: list[Any]) -> int:
    """Taichi's number of a function for arguments of these types."""
    mapping: dict[Any, int] = function.mapper.mapping
    return mapping.setdefault(tuple(map(decoded, features)), len(mapping))


def _found(name: list[Any], made_of: Fingerprint) -> Any:
    function = made_of.functions[name[0], name[1]]
    assert function is not None
    return function.taichi_functions[_instance(function, name[2])]


def _is_function(words: Any) -> bool:
    return isinstance(words, list) and words[0] == "function"


def _together(tapes: list[list[Tape]]) -> list[Tape]:
    """Each once, in their order."""
    result: list[Tape] = []
    for each in tapes:
        result += [tape for tape in each if tape not in result]
    return result


def _play(tape: Tape, owner: Any, made_of: Fingerprint) -> None:
    """Make the calls again."""
    values = [owner, impl.get_runtime().prog.config(), core.DebugInfo()]
    values += [_found(words[1:], made_of) if _is_function(words) else decoded(words) for words in tape.constants]
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
    """A tape in the making. Arguments of rows: the number of the row whose result it is, a constant in words, or what
    is always there."""

    def __init__(self, name: list[Any]) -> None:
        self.name = name
        self.functions: list[list[Tape]] = []  # that are called
        self._rows: list[tuple[str, list[tuple[str, Any]]]] = []
        self._results: dict[int, int] = {}
        self._alive: list[Any] = []
        self._checked: set[int] = set()

    def add(self, call: str, values: list[Any], result: Any) -> None:
        if self.name and call == "Kernel.ast_builder":  # asked for by functions that are inlined, and not used
            return
        if call == "Expr.type_check":  # which changes nothing the second time
            if id(values[0]) in self._checked:
                return
            self._checked.add(id(values[0]))
        self._know(result, self._row(call, values))
        if isinstance(result, list):
            self._alive.append(result)
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
        if isinstance(value, core.CompileConfig):
            return "always", CONFIG
        if isinstance(value, core.DebugInfo):
            return "always", PLACE
        if isinstance(value, core.Function) and id(value) in _functions:
            tapes = _functions[id(value)][1]
            self.functions.append(tapes)
            return "constant", json.dumps(["function", *tapes[-1].name])
        if isinstance(value, core.Function if self.name else core.Kernel):
            return "always", OWNER
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
        tape = Tape(self.name, [json.loads(words) for words in places])
        for call, arguments in rows:
            tape.calls.append(call)
            tape.counts.append(len(arguments))
            for kind, what in arguments:
                place = int(results[what]) if kind == "result" else places[what] if kind == "constant" else what
                tape.arguments.append(place)
        return tape


class _Recorder:
    """kept: whether all could be written down."""

    def __init__(self) -> None:
        self.kept = True
        self._reels = [_Reel([])]

    def wrapped(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """The call, and a line on the tape."""

        def recorded(*values: Any, **named: Any) -> Any:
            result = call(*values, **named)
            if self.kept:
                try:
                    self._reels[-1].add(" ".join([name, *named]), [*values, *named.values()], result)
                except NotKept:
                    self.kept = False
            return result

        return recorded

    def compile(self, function: Func, key: Any, args: Any, arg_features: Any) -> None:
        """As Taichi compiles a function that is not inlined: on a tape of its own."""
        name: list[Any] = [function.func.__module__, function.func.__qualname__]
        try:
            name.append([encoded(each) for each in arg_features])
        except NotKept:
            self.kept = False
        self.kept = self.kept and not function.template_slot_locations
        self._reels.append(_Reel(name))
        try:
            _compile(function, key, args, arg_features)
        finally:
            reel = self._reels.pop()
        if self.kept:
            made = function.taichi_functions[key.instance_id]
            _functions[id(made)] = made, _together([*reel.functions, [reel.tape()]])

    def tapes(self) -> list[Tape]:
        """Those of the functions that are needed, and the kernel's."""
        (reel,) = self._reels
        return _together([*reel.functions, [reel.tape()]])


@contextmanager
def _recording() -> Iterator[_Recorder]:
    """Write down what Taichi's library is told."""
    recorder = _Recorder()
    group = core.ExprGroup
    try:
        for name, function in _FUNCTIONS.items():
            setattr(core, name, recorder.wrapped(name, function))
        for (kind, name), method in _METHODS.items():
            setattr(kind, name, recorder.wrapped(f"{kind.__name__}.{name}", method))
        core.ExprGroup = recorder.wrapped("ExprGroup", group)
        Func.do_compile = lambda *args, **named: recorder.compile(*args, **named)
        yield recorder
    finally:
        for name, function in _FUNCTIONS.items():
            setattr(core, name, function)
        for (kind, name), method in _METHODS.items():
            setattr(kind, name, method)
        core.ExprGroup = group
        Func.do_compile = _compile
