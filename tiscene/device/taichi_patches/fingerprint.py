# SPDX-License-Identifier: Apache-2.0
"""What a kernel is made of, as a short text: it is another one if anything in its sources is.

Sources are the files of all functions that can be reached by name from the kernel's, and the values of all else that
they name. Taichi, numpy and some of Python's own modules count by their versions. Where a name stands for something
that is neither a number nor a text, a type, an array of numpy or several of these, there is no fingerprint.
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

_PLAIN = (bool, int, float, complex, str, bytes, type(None), np.generic, np.dtype)
# Whose functions say the same whenever they are asked, unlike those of `os` or `random`.
_PURE = ("abc", "builtins", "collections", "dataclasses", "enum", "functools", "inspect", "math", "operator", "typing")
_BY_VERSION = {"taichi", "numpy", *_PURE}
_VERSIONS = (sys.version, sys.byteorder, ti.__version__, core.get_commit_hash(), np.__version__)
_WRITERS = tuple(f"tiscene.device.taichi_patches.{name}" for name in ("fingerprint", "ast_recorder", "recording_file"))
# What the configuration says of how Taichi runs, not of what it makes.
_RUNNING = ("cache", "print", "verbose", "threads", "timeline", "memory", "random_seed")


class NoFingerprint(Exception):
    """Something is named of which nobody can say whether it is the same in another process."""


@dataclasses.dataclass(eq=False)
class Fingerprint:
    """text: hexadecimal digits. files: the modules whose source counts."""

    text: str
    files: set[str]

    def is_true(self) -> bool:
        """Whether the sources are still what they were when the fingerprint was taken."""
        return all(_digest(module) == source_digest(module) for module in self.files)


def fingerprint(kernel: Kernel, args: Any, features: Any) -> Fingerprint:
    """Of a kernel for arguments of which Taichi says these features. Raises NoFingerprint."""
    walk, runtime, config = _Walk(), impl.get_runtime(), impl.current_cfg()
    walk.note(_VERSIONS, [source_digest(module) for module in _WRITERS])
    walk.note(runtime.short_circuit_operators, runtime.unrolling_limit)
    for name in dir(config):
        if not name.startswith("_") and not any(part in name for part in _RUNNING):
            walk.note(name, getattr(config, name))
    for parameter, value, feature in zip(kernel.arguments, args, features, strict=True):
        walk.note(parameter.name, value if isinstance(parameter.annotation, template) else feature)
    walk.function(kernel.func, kernel)
    walk.finish()
    return Fingerprint(walk.digest.hexdigest(), walk.files)


@functools.cache
def source_digest(module: str) -> str:
    """Of a module's source, as it was when this was asked first. Raises NoFingerprint for one without."""
    return _digest(module)


def _digest(module: str) -> str:
    file = getattr(sys.modules.get(module), "__file__", None)
    try:
        return hashlib.sha256(Path(file or "").read_bytes()).hexdigest()
    except OSError as error:
        raise NoFingerprint(f"{module} has no source") from error


class _Walk:
    """From a kernel to all that is named, and what that names."""

    def __init__(self) -> None:
        self.digest = hashlib.sha256()
        self.files: set[str] = set()
        self._numbers: dict[int, int] = {}  # of functions and classes, by id
        self._waiting: list[tuple[types.FunctionType, Any]] = []

    def note(self, *values: Any) -> None:
        self.digest.update(repr([self._said(value) for value in values]).encode())

    def finish(self) -> None:
        while self._waiting:
            function, taichi = self._waiting.pop()
            code = function.__code__
            self.note(self._source(function), function.__qualname__, code.co_firstlineno, code.co_code)
            self.note(function.__defaults__, function.__kwdefaults__)
            if taichi is not None:
                self.note(taichi.return_type, *((each.name, each.annotation) for each in taichi.arguments))
            for name, value in _named(function):
                self.note(name, value)

    def function(self, function: types.FunctionType, taichi: Any = None) -> Any:
        """taichi: what Taichi has made of it."""
        if id(function) not in self._numbers:
            self._numbers[id(function)] = len(self._numbers)
            self._waiting.append((function, taichi))
        return "function", self._numbers[id(function)]

    def _source(self, value: Any) -> tuple[str, str]:
        self.files.add(value.__module__)
        return value.__module__, source_digest(value.__module__)

    def _said(self, value: Any) -> Any:
        """What there is to say of a value, in numbers and words."""
        kind = type(value).__qualname__
        if isinstance(value, core.DataType):
            return kind, value.to_string()
        if isinstance(value, Enum):
            return kind, value.name, self._said(value.value)
        if hasattr(type(value), "__members__") and not isinstance(value, type):  # an enumeration of Taichi's
            return kind, int(value)
        if isinstance(value, _PLAIN):
            return kind, repr(value)
        if isinstance(value, (tuple, list)):
            return kind, [self._said(each) for each in value]
        if isinstance(value, dict):
            return kind, [(self._said(key), self._said(each)) for key, each in value.items()]
        if isinstance(value, np.ndarray) and not value.dtype.hasobject:
            return kind, value.dtype.str, value.shape, hashlib.sha256(value.tobytes()).hexdigest()
        if isinstance(value, Matrix):
            return kind, self._said(value.to_list())
        if isinstance(value, (MatrixType, NdarrayType, StructType, template)):
            return kind, self._said(vars(value))
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            return kind, self._said(type(value)), self._said(vars(value))
        return self._said_of_code(value)

    def _said_of_code(self, value: Any) -> Any:
        if isinstance(value, types.ModuleType):
            return "module", value.__name__  # what is named of it is looked at where it is
        if callable(value) and _by_version(getattr(value, "__module__", None) or ""):
            return "outside", value.__module__, getattr(value, "__qualname__", "")
        if isinstance(value, types.BuiltinFunctionType) and isinstance(value.__self__, type):
            return "builtin", value.__qualname__
        if isinstance(value, type):
            return self._class(value)
        inner = inspect.unwrap(value) if callable(value) else value
        if isinstance(inner, types.FunctionType):
            taichi = getattr(value, "func", None)
            return self.function(inner, taichi if isinstance(taichi, Func) else None)
        raise NoFingerprint(f"{value!r} is nothing that another process could be asked for")

    def _class(self, value: type) -> Any:
        if id(value) in self._numbers:
            return "class", self._numbers[id(value)]
        self._numbers[id(value)] = len(self._numbers)
        members: list[Any] = []
        for name, each in vars(value).items():
            member = each.fget if isinstance(each, property) else getattr(each, "__func__", each)
            if isinstance(member, types.FunctionType) and member.__module__ != value.__module__:
                continue  # made by what made the class
            if isinstance(member, types.FunctionType) or not (
                name.startswith("__") or inspect.isdatadescriptor(member)
            ):
                members.append((name, member))
        return self._source(value), value.__qualname__, self._said(value.__bases__), self._said(members)


def _named(function: types.FunctionType) -> Iterator[tuple[str, Any]]:
    """All that a function may mean by the names in it."""
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        yield name, cell.cell_contents
    names = sorted(set(_names(function.__code__)))
    modules = []
    for name in names:
        if name in function.__globals__:
            value = function.__globals__[name]
            yield name, value
            if isinstance(value, types.ModuleType) and not _by_version(value.__name__):
                modules.append(value)
    for module in modules:  # which grow: a module may be named of another
        for name in names:
            if name in vars(module):
                value = vars(module)[name]
                yield f"{module.__name__}.{name}", value
                if isinstance(value, types.ModuleType) and not _by_version(value.__name__) and value not in modules:
                    modules.append(value)


def _names(code: types.CodeType) -> Iterator[str]:
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _names(constant)


def _by_version(module: str) -> bool:
    return module.partition(".")[0] in _BY_VERSION
