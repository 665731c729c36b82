# SPDX-License-Identifier: Apache-2.0
"""Recorded calls of Taichi's library as files.

A file is one zlib stream: a line of JSON with the constants and the names of the calls, then the numbers as
little-endian 32-bit integers. Files appear whole or not at all, and processes that share a folder write one at a time.
A folder holds at most `MAX_FILES`; the least recently used are deleted.
"""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from taichi._lib import core

from tiscene.files import write_atomically

MAX_FILES = 1000
LOCK = ".lock"

# The first values of every replay: the kernel, the configuration, and an empty source location. Constants follow.
KERNEL, CONFIG, DEBUG_INFO = range(3)
FIRST_CONSTANT = 3

_DATA_TYPES = {each.to_string(): each for name, each in vars(core).items() if name.startswith("DataType_")}


class NotRecordable(Exception):
    """An argument of a call cannot be written to a file."""


@dataclass
class CallRecording:
    """The calls that build the AST of a kernel.

    The values of a replay are the three fixed ones, the constants, and the result of each call, in this order.

    Attributes:
        constants: Arguments that are not results, as `encode` returns them.
        calls: The name of each call, followed by the keywords of its last arguments.
        counts: The number of arguments of each call.
        arguments: The values that the calls take, as indices, call after call.
    """

    constants: list[Any] = field(default_factory=list)
    calls: list[str] = field(default_factory=list)
    counts: list[int] = field(default_factory=list)
    arguments: list[int] = field(default_factory=list)


def encode(value: Any) -> Any:
    """Return a value in JSON's types. Raises NotRecordable."""
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    if isinstance(value, np.generic):
        return encode(value.item())
    if isinstance(value, (tuple, list)):
        return [type(value).__name__, *map(encode, value)]
    if isinstance(value, core.DataType):
        if value.to_string() in _DATA_TYPES:
            return ["type", value.to_string()]
        with suppress(RuntimeError, TypeError):
            return ["tensor", list(value.shape()), encode(value.element_type())]
    if hasattr(type(value), "__members__") and getattr(core, type(value).__name__, None) is type(value):
        return ["enum", type(value).__name__, int(value)]
    raise NotRecordable(f"{value!r} cannot be recorded")


def decode(encoded: Any) -> Any:
    """Return the value that `encode` was given."""
    if not isinstance(encoded, list):
        return encoded
    kind, *content = encoded
    if kind == "type":
        return _DATA_TYPES[content[0]]
    if kind == "tensor":
        return core.get_type_factory_instance().get_tensor_type(content[0], decode(content[1]))
    if kind == "enum":
        return getattr(core, content[0])(content[1])
    values = map(decode, content)
    return tuple(values) if kind == "tuple" else list(values)


def read_recording(path: Path) -> CallRecording | None:
    """Read a file and mark it as used; return None if it does not exist or is damaged."""
    try:
        head, _, rest = zlib.decompress(path.read_bytes()).partition(b"\n")
        constants, names, count = json.loads(head)
        numbers = np.frombuffer(rest, "<u4").tolist()
        calls = [names[number] for number in numbers[:count]]
    except (OSError, zlib.error, ValueError, TypeError, IndexError):
        return None
    with suppress(OSError):  # a folder that can only be read is no reason not to use it
        os.utime(path)
    return CallRecording(constants, calls, numbers[count : 2 * count], numbers[2 * count :])


def write_recording(path: Path, recording: CallRecording) -> None:
    """Write a file, whole or not at all. Do nothing if the folder is not writable."""
    names = {name: number for number, name in enumerate(dict.fromkeys(recording.calls))}
    head = json.dumps([recording.constants, list(names), len(recording.calls)]).encode()
    numbers = np.array([*(names[name] for name in recording.calls), *recording.counts, *recording.arguments], "<u4")
    data = zlib.compress(head + b"\n" + numbers.tobytes())
    with suppress(OSError), _locked(path.parent):
        for unfinished in path.parent.glob(".*.part"):  # of processes that were killed: all others wait for the lock
            unfinished.unlink()
        write_atomically(path, data)
        files = sorted(path.parent.glob("*" + path.suffix), key=lambda file: file.stat().st_mtime)
        for file in files[:-MAX_FILES]:
            file.unlink()


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Make a folder, and hold its lock against other processes. The lock of a process that is killed is released."""
    folder.mkdir(parents=True, exist_ok=True)
    try:
        import fcntl
    except ImportError:  # not on Windows, where a file that is open cannot be replaced either
        yield
        return
    with (folder / LOCK).open("wb") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield
