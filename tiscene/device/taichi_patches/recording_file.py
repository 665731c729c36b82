# SPDX-License-Identifier: Apache-2.0
"""Calls of Taichi's library in their order, as files."""

from __future__ import annotations

import json
import os
import zlib
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from taichi._lib import core

from tiscene.files import write_atomically

MOST = 1000  # files in a folder; those go that were not used for longest
KERNEL, CONFIG, PLACE = range(3)  # the first values: the kernel, the configuration, where a call stands
FIRST = 3  # those after them

_TYPES = {each.to_string(): each for name, each in vars(core).items() if name.startswith("DataType_")}


class NotKept(Exception):
    """What a call is given cannot be written down."""


@dataclass
class Tape:
    """The calls by which the syntax tree of a kernel is made.

    constants: what calls are given that is no result, in the words of `encoded`. calls: which, by name. counts: of how
    many values. arguments: their places, call after call. Values are the three above, the constants, and the result of
    each call.
    """

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


def read_tape(path: Path) -> Tape | None:
    """None if the file is not there or damaged."""
    try:
        head, _, rest = zlib.decompress(path.read_bytes()).partition(b"\n")
        os.utime(path)  # used now
    except (OSError, zlib.error):
        return None
    constants, names, count = json.loads(head)
    numbers = np.frombuffer(rest, "<u4").tolist()
    calls = [names[number] for number in numbers[:count]]
    return Tape(constants, calls, numbers[count : 2 * count], numbers[2 * count :])


def write_tape(path: Path, tape: Tape) -> None:
    """Write a file, whole or not at all. Nothing happens where nothing can be written."""
    names = {name: number for number, name in enumerate(dict.fromkeys(tape.calls))}
    head = json.dumps([tape.constants, list(names), len(tape.calls)]).encode()
    numbers = np.array([*(names[name] for name in tape.calls), *tape.counts, *tape.arguments], "<u4")
    with suppress(OSError):
        write_atomically(path, zlib.compress(head + b"\n" + numbers.tobytes()))
        files = sorted(path.parent.glob("*" + path.suffix), key=lambda file: file.stat().st_mtime)
        for file in files[:-MOST]:
            file.unlink()
