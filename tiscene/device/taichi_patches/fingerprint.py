# SPDX-License-Identifier: Apache-2.0
"""Identify a kernel by everything that its AST depends on.

The walk starts at the kernel's function and follows every name in it: to the source files of all functions and classes
that can be reached, and to the values of everything else. Taichi, NumPy and some modules of the standard library enter
with their versions. A name that stands for anything but a module, a number, a string, a type, a NumPy array or a
container of the last four has no fingerprint: nobody could tell which members of a module in a container are used.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import inspect
import sys
import types
from collections.abc import Iterator
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
import taichi as ti
from taichi._lib import core
from taichi.lang import impl
from taichi.lang.kernel_impl import Func, Kernel
from taichi.lang.matrix import Matrix, MatrixType
from taichi.lang.struct import StructType
from taichi.types.annotations import template
from taichi.types.ndarray_type import NdarrayType

_VALUE_TYPES = (bool, int, float, complex, str, bytes, type(None), np.generic, np.dtype)
# Modules whose functions return the same at any time, unlike those of `os` or `random`.
_PURE = ("abc", "builtins", "collections", "dataclasses", "enum", "functools", "inspect", "math", "operator", "typing")
_BY_VERSION = {"taichi", "numpy", *_PURE}
_VERSIONS = (sys.version, sys.byteorder, ti.__version__, core.get_commit_hash(), np.__version__)
_WRITERS = tuple(
    f"tiscene.device.taichi_patches.{name}"
    for name in ("fingerprint", "ast_recorder", "recorded_calls", "recording_file", "simplified_calls")
)
# Parts of names of configuration entries that concern how Taichi runs, not what it compiles.
_RUN_OPTIONS = ("cache", "print", "verbose", "threads", "timeline", "memory", "random_seed")


class NoFingerprint(Exception):
    """A kernel names something that may differ in another process."""


@dataclasses.dataclass(eq=False)
class Fingerprint:
    """The identity of a kernel's AST.

    Attributes:
        text: Hexadecimal digits.
        modules: The modules whose source files it covers.
    """

    text: str
    modules: set[str]

    def is_current(self) -> bool:
        """Return whether the source files are unchanged since they were first read."""
        return all(_digest(module) == source_digest(module) for module in self.modules)


def fingerprint(kernel: Kernel, args: Any, features: Any) -> Fingerprint:
    """Return the fingerprint of a kernel for the given arguments.

    Args:
        kernel: The kernel.
        args: The arguments of a call.
        features: What Taichi compiles the kernel for, one entry an argument.

    Raises:
        NoFingerprint: The kernel names something that may differ in another process.
    """
    walk, runtime, config = _SourceWalk(), impl.get_runtime(), impl.current_cfg()
    walk.note(_VERSIONS, [source_digest(module) for module in _WRITERS])
    walk.note(runtime.short_circuit_operators, runtime.unrolling_limit)
    for name in dir(config):
        if not name.startswith("_") and not any(part in name for part in _RUN_OPTIONS):
            walk.note(name, getattr(config, name))
    for parameter, value, feature in zip(kernel.arguments, args, features, strict=True):
        walk.note(parameter.name, value if isinstance(parameter.annotation, template) else feature)
    walk.add_function(kernel.func, kernel)
    walk.finish()
    return Fingerprint(walk.digest.hexdigest(), walk.modules)


@functools.cache
def source_digest(module: str) -> str:
    """Return the SHA-256 of a module's source file at the time of the first call. Raises NoFingerprint without one."""
    return _digest(module)


def _digest(module: str) -> str:
    file = getattr(sys.modules.get(module), "__file__", None)
    try:
        return hashlib.sha256(Path(file or "").read_bytes()).hexdigest()
    except OSError as error:
        raise NoFingerprint(f"{module} has no source") from error


class _SourceWalk:
    """Digests a kernel's function and everything that can be reached from it by name."""

    def __init__(self) -> None:
        self.digest = hashlib.sha256()
        self.modules: set[str] = set()
        self._numbers: dict[int, int] = {}  # of functions and classes, by id
        self._pending: list[tuple[types.FunctionType, Any]] = []

    def note(self, *values: Any) -> None:
        """Add values to the digest."""
        self.digest.update(repr([self._described(value) for value in values]).encode())

    def finish(self) -> None:
        """Add the functions found so far, and those that they lead to."""
        while self._pending:
            function, taichi = self._pending.pop()
            code = function.__code__
            self.note(self._source(function), function.__qualname__, code.co_firstlineno, code.co_code)
            self.note(function.__defaults__, function.__kwdefaults__)
            if taichi is not None:
                self.note(taichi.return_type, *((each.name, each.annotation) for each in taichi.arguments))
            for name, value in _named_values(function):
                # Its members are described where they are used.
                self.note(name, ("module", value.__name__) if isinstance(value, types.ModuleType) else value)

    def add_function(self, function: types.FunctionType, taichi: Any = None) -> Any:
        """Queue a function, once, and return its description. `taichi`: the Kernel or Func made of it, if any."""
        if id(function) not in self._numbers:
            self._numbers[id(function)] = len(self._numbers)
            self._pending.append((function, taichi))
        return "function", self._numbers[id(function)]

    def _source(self, value: Any) -> tuple[str, str]:
        self.modules.add(value.__module__)
        return value.__module__, source_digest(value.__module__)

    def _described(self, value: Any) -> Any:
        """Return a description of a value in tuples, lists, numbers and strings, the same in every process."""
        kind = type(value).__qualname__
        if isinstance(value, core.DataType):
            return kind, value.to_string()
        if isinstance(value, Enum):
            return kind, value.name, self._described(value.value)
        if hasattr(type(value), "__members__") and not isinstance(value, type):  # an enumeration of Taichi's library
            return kind, int(value)
        if isinstance(value, _VALUE_TYPES):
            return kind, repr(value)
        if isinstance(value, (tuple, list)):
            return kind, [self._described(each) for each in value]
        if isinstance(value, dict):
            return kind, [(self._described(key), self._described(each)) for key, each in value.items()]
        if isinstance(value, np.ndarray) and not value.dtype.hasobject:
            return kind, value.dtype.str, value.shape, hashlib.sha256(value.tobytes()).hexdigest()
        if isinstance(value, Matrix):
            return kind, self._described(value.to_list())
        if isinstance(value, (MatrixType, NdarrayType, StructType, template)):
            return kind, self._described(vars(value))
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            return kind, self._described(type(value)), self._described(vars(value))
        return self._described_code(value)

    def _described_code(self, value: Any) -> Any:
        if isinstance(value, types.ModuleType) and _is_identified_by_version(value.__name__):
            return "module", value.__name__
        if callable(value) and _is_identified_by_version(getattr(value, "__module__", None) or ""):
            return "outside", value.__module__, getattr(value, "__qualname__", "")
        if isinstance(value, types.BuiltinFunctionType) and isinstance(value.__self__, type):
            return "builtin", value.__qualname__
        if isinstance(value, type):
            return self._described_class(value)
        inner = inspect.unwrap(value) if callable(value) else value
        if isinstance(inner, types.FunctionType):
            taichi = getattr(value, "func", None)
            return self.add_function(inner, taichi if isinstance(taichi, Func) else None)
        raise NoFingerprint(f"{value!r} cannot be fingerprinted")

    def _described_class(self, value: type) -> Any:
        if id(value) in self._numbers:
            return "class", self._numbers[id(value)]
        self._numbers[id(value)] = len(self._numbers)
        members: list[Any] = []
        for name, each in vars(value).items():
            member = each.fget if isinstance(each, property) else getattr(each, "__func__", each)
            if isinstance(member, types.FunctionType) and member.__module__ != value.__module__:
                continue  # generated, such as a dataclass's
            if isinstance(member, types.FunctionType) or not (
                name.startswith("__") or inspect.isdatadescriptor(member)
            ):
                members.append((name, member))
        return self._source(value), value.__qualname__, self._described(value.__bases__), self._described(members)


def _named_values(function: types.FunctionType) -> Iterator[tuple[str, Any]]:
    """Yield everything that the names in a function may refer to: closures, globals, members of modules."""
    modules = []
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        value = cell.cell_contents
        yield name, value
        if isinstance(value, types.ModuleType) and not _is_identified_by_version(value.__name__):
            modules.append(value)
    names = sorted(set(_names(function.__code__)))
    for name in names:
        if name in function.__globals__:
            value = function.__globals__[name]
            yield name, value
            if isinstance(value, types.ModuleType) and not _is_identified_by_version(value.__name__):
                modules.append(value)
    for module in modules:  # grows: a module may be a member of another
        for name in names:
            if name in vars(module):
                value = vars(module)[name]
                yield f"{module.__name__}.{name}", value
                is_new = isinstance(value, types.ModuleType) and value not in modules
                if is_new and not _is_identified_by_version(value.__name__):
                    modules.append(value)


def _names(code: types.CodeType) -> Iterator[str]:
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _names(constant)


def _is_identified_by_version(module: str) -> bool:
    return module.partition(".")[0] in _BY_VERSION
