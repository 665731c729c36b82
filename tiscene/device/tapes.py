"""Calls of Taichi's library in their order, as files."""

from __future__ import annotations

import json
import os
import zlib
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from taichi._lib import core

from tiscene.files import write_atomically

MOST = 1000  # files in a folder; those go that were not used for longest
OWNER, CONFIG, PLACE = range(3)  # the first values: the kernel or function, the configuration, where a call stands
FIRST = 3  # those after them

_TYPES = {each.to_string(): each for name, each in vars(core).items() if name.startswith("DataType_")}


class NotKept(Exception):
    """What a call is given cannot be written down."""


@dataclass
class Tape:
    """The calls by which the syntax tree of a kernel is made, or of a function that is not inlined.

    name: the function's module, its name, and what it takes; empty for a kernel. constants: what calls are given that
    is no result, in the words of `encoded`. calls: which, by name. counts: of how many values. arguments: their places,
    call after call. Values are the three above, the constants, and the result of each call.
    """

    name: list[Any]
    constants: list[Any] = field(default_factory=list)
    calls: list[str] = field(default_factory=list)
    counts: list[int] = field(default_factory=list)
    arguments: list[int] = field(default_factory=list)


def encoded(value: Any) -> Any:
    """A value in the words of JSON. Raises NotKept."""
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    if isinstance(value, np.generic):
        return encoded(value.item())
    if isinstance(value, (tuple, list)):
        return [type(value).__name__, *map(encoded, value)]
    if isinstance(value, core.DataType):
        if value.to_string() in _TYPES:
            return ["type", value.to_string()]
        with suppress(RuntimeError, TypeError):
            return ["tensor", list(value.shape()), encoded(value.element_type())]
    if hasattr(type(value), "__members__") and getattr(core, type(value).__name__, None) is type(value):
        return ["enum", type(value).__name__, int(value)]
    raise NotKept(f"{value!r} cannot be written down")


def decoded(words: Any) -> Any:
    """The value."""
    if not isinstance(words, list):
        return words
    kind, *what = words
    if kind == "type":
        return _TYPES[what[0]]
    if kind == "tensor":
        return core.get_type_factory_instance().get_tensor_type(what[0], decoded(what[1]))
    if kind == "enum":
        return getattr(core, what[0])(what[1])
    values = map(decoded, what)
    return tuple(values) if kind == "tuple" else list(values)


def read_tapes(path: Path) -> list[Tape] | None:
    """None if the file is not there or damaged."""
    try:
        head, _, rest = zlib.decompress(path.read_bytes()).partition(b"\n")
        os.utime(path)  # used now
    except (OSError, zlib.error):
        return None
    numbers = iter(np.frombuffer(rest, "<u4").tolist())
    tapes = []
    for name, constants, names, calls, arguments in json.loads(head):
        called = [names[number] for number in islice(numbers, calls)]
        tapes.append(Tape(name, constants, called, list(islice(numbers, calls)), list(islice(numbers, arguments))))
    return tapes


def write_tapes(path: Path, tapes: list[Tape]) -> None:
    """Write a file, whole or not at all. Nothing happens where nothing can be written."""
    head: list[Any] = []
    numbers: list[int] = []
    for tape in tapes:
        names = {name: number for number, name in enumerate(dict.fromkeys(tape.calls))}
        head.append((tape.name, tape.constants, list(names), len(tape.calls), len(tape.arguments)))
        numbers += [*(names[name] for name in tape.calls), *tape.counts, *tape.arguments]
    data = json.dumps(head).encode() + b"\n" + np.array(numbers, "<u4").tobytes()
    with suppress(OSError):
        write_atomically(path, zlib.compress(data))
        files = sorted(path.parent.glob("*" + path.suffix), key=lambda file: file.stat().st_mtime)
        for file in files[:-MOST]:
            file.unlink()
