# SPDX-License-Identifier: Apache-2.0
"""Frozen dataclasses to JSON values and back, strictly: unknown keys and wrong values name their place in the file.

A table maps a field's name to the classes that it may hold. If there are several, the JSON object carries the class's
name as "type". A field with an empty table holds a plain mapping. All other values are numbers, strings, booleans, null
and arrays of them, which the classes validate when they are constructed.
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from inspect import isabstract
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from tiscene.errors import ArgumentError, ExportError, MissingFile, ScenarioError, did_you_mean, export_errors
from tiscene.files import write_atomically

Classes = Mapping[str, type]
Made = TypeVar("Made")
LINE_LENGTH = 110
LISTS = ("objects", "edits", "lights", "overrides", "joints")  # fields of a scenario


class DerivedClasses(Mapping[str, type]):
    """The dataclasses that are derived from a base class, by name; users may add to them.

    Args:
        base: the base class.
        others: further classes; none of them can be replaced.
    """

    def __init__(self, base: type, others: Classes | None = None) -> None:
        self._base, self._others = base, dict(others or {})

    def _all(self) -> dict[str, type]:
        found: dict[str, type] = {}
        pending: list[type] = [self._base]
        while pending:
            derived: list[type] = pending.pop().__subclasses__()
            found |= {cls.__name__: cls for cls in derived if dataclasses.is_dataclass(cls) and not isabstract(cls)}
            pending += derived
        return found | self._others

    def __getitem__(self, name: str) -> type:
        return self._all()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._all())

    def __len__(self) -> int:
        return len(self._all())


def encode(value: Any, table: Mapping[str, Classes], classes: Classes | None = None, path: str = "") -> Any:
    """`value` as what `json` writes. table: field name to the classes it may hold. Raises ScenarioError."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        name = type(value).__name__
        if classes is None or classes.get(name) is not type(value):
            raise ScenarioError(f"{path}: a {name} cannot be written to a file; only {_names(classes or {})} can")
        tag = {"type": name} if len(classes) > 1 else {}
        return tag | {
            field.name: encode(getattr(value, field.name), table, table.get(field.name), _member(path, field.name))
            for field in dataclasses.fields(value)
        }
    if isinstance(value, tuple | list):
        return [encode(item, table, classes, f"{path}[{index}]") for index, item in enumerate(value)]
    if isinstance(value, Mapping) and classes is not None and not classes:
        return {str(key): encode(item, table, classes, f"{path}[{key!r}]") for key, item in value.items()}
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | str) or (isinstance(value, float) and math.isfinite(value)):
        return value
    cure = f"; make {type(value).__name__} a dataclass" if classes and not isinstance(value, type) else ""
    raise ScenarioError(f"{path}={value!r}: cannot be written to a file{cure}")


def decode(value: Any, table: Mapping[str, Classes], classes: Classes | None = None, path: str = "") -> Any:
    """What `encode` was given. Raises ScenarioError that begins with the place, as `objects[2].dynamic.total_time`."""
    if isinstance(value, list):
        return tuple(decode(item, table, classes, f"{path}[{index}]") for index, item in enumerate(value))
    if not isinstance(value, Mapping):
        return value
    if classes is None:
        raise ScenarioError(f"{path}: must be a plain value or a list, not an object {{...}}")
    if not classes:
        return {str(key): decode(item, table, classes, f"{path}[{key!r}]") for key, item in value.items()}
    if path in LISTS:
        raise ScenarioError(f"{path}: must be a list, not an object {{...}}")
    members = dict(value)
    kind = _class_of(members, classes, path)
    fields = {field.name: field for field in dataclasses.fields(kind)}
    for name in members:
        if name not in fields:
            raise ScenarioError(f"{_member(path, name)}: {kind.__name__} has no such key{did_you_mean(name, fields)}")
    for name, field in fields.items():
        optional = field.default is not dataclasses.MISSING or field.default_factory is not dataclasses.MISSING
        if name not in members and not optional:
            raise ScenarioError(f"{_member(path, name)}: is missing")
    arguments = {name: decode(item, table, table.get(name), _member(path, name)) for name, item in members.items()}
    try:
        return kind(**arguments)
    except (TypeError, ValueError) as error:
        raise ScenarioError(_located(path, str(error), fields)) from error


def dumps(value: Any) -> str:
    """JSON for people: what fits on a line stands on one. Floats are written so that they read back exactly."""
    return _lines(value, "", "") + "\n"


def write(path: str | os.PathLike[str], value: Any) -> None:
    """The same into a file, whole or not at all. Raises ExportError."""
    path = Path(path)
    if not path.parent.is_dir():
        raise ExportError(f"cannot write {str(path)!r}: there is no folder {str(path.parent)!r}")
    with export_errors(path):
        write_atomically(path, dumps(value).encode())


def read(path: str | os.PathLike[str], make: Callable[[Any], Made]) -> Made:
    """Return what `make` makes of a JSON file's content.

    Raises:
        MissingFile: there is no such file.
        ArgumentError, ScenarioError: the content is wrong; the message names the file.
    """
    path = Path(path)
    try:
        return make(loads(path.read_text(encoding="utf-8-sig")))
    except FileNotFoundError as error:
        raise MissingFile(f"no file {str(path)!r} (looked from {str(Path.cwd())!r})") from error
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ScenarioError(f"{path}: not a text file in UTF-8") from error
    except (ArgumentError, ScenarioError) as error:
        raise type(error)(f"{path}: {error}") from error


def loads(text: str) -> Any:
    """Strict JSON: a key twice in one object, NaN and Infinity are refused. Raises ScenarioError."""
    try:
        return json.loads(text, object_pairs_hook=_unique, parse_constant=_refuse_constant)
    except json.JSONDecodeError as error:
        raise ScenarioError(f"line {error.lineno}, column {error.colno}: not JSON: {error.msg}") from error
    except ScenarioError:
        raise
    except (RecursionError, ValueError) as error:  # arrays within arrays without end, numbers of thousands of digits
        raise ScenarioError(f"not JSON that can be read: {error}") from error


def _class_of(members: dict[str, Any], classes: Classes, path: str) -> type:
    if len(classes) == 1:
        return next(iter(classes.values()))
    where = _member(path, "type")
    if "type" not in members:
        raise ScenarioError(f"{where}: is missing; must be one of {_names(classes)}")
    name = members.pop("type")
    if not isinstance(name, str) or name not in classes:
        hint = did_you_mean(str(name), classes) or f"; there are {_names(classes)}"
        raise ScenarioError(f"{where}: unknown type {name!r}{hint}")
    return classes[name]


def _member(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def _located(path: str, message: str, fields: Iterable[str]) -> str:
    """Return a message behind its place; where it begins with the name of a field, that name extends the path."""
    # Cameras say which one they are first.
    first = re.match(r"(?:camera '[^']*': )?((\w+).*)", message, re.DOTALL)
    if first and first.group(2) in fields:
        return _member(path, first.group(1))
    return f"{path}: {message}" if path else message


def _names(classes: Classes) -> str:
    return ", ".join(sorted(classes)) or "plain values"


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result: dict[str, Any] = {}
    for key, value in pairs:
        if key in result:
            raise ScenarioError(f"the key {key!r} stands twice in one object")
        result[key] = value
    return result


def _refuse_constant(name: str) -> None:
    raise ScenarioError(f"{name} is not a number of JSON")


def _lines(value: Any, indent: str, before: str) -> str:
    """The JSON text of `value`, to stand after `before` (such as a key) on a line indented by `indent`."""
    line = json.dumps(value, ensure_ascii=False, allow_nan=False)
    if len(indent) + len(before) + len(line) < LINE_LENGTH or not value or not isinstance(value, dict | list):
        return line
    inner = indent + "  "
    if isinstance(value, dict):
        parts = []
        for key, item in value.items():
            head = f"{json.dumps(key, ensure_ascii=False)}: "
            parts.append(f"{inner}{head}{_lines(item, inner, head)}")
        return "{\n" + ",\n".join(parts) + f"\n{indent}}}"
    return "[\n" + ",\n".join(f"{inner}{_lines(item, inner, '')}" for item in value) + f"\n{indent}]"
