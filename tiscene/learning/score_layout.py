# SPDX-License-Identifier: Apache-2.0
"""What pages, comparisons and commands read of a score's JSON file, to name what a damaged or edited one lacks.

A layout is a type; a mapping of keys, of which "key?" may be missing and `str` stands for any; a list of the layout of
all its items; or a tuple of the layouts of a list of that length. Other keys are ignored: metrics have values of their
own.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dynamics import argument_checks
from tiscene.errors import ArgumentError, counted

NUMBER, MAYBE = int | float, int | float | None
ACCURACY = {"accuracy?": MAYBE, "curve?": [(int, NUMBER)]}
CHANGE = {"frame": int, "change": str, "before": MAYBE, "drop": MAYBE, "recovery": MAYBE, "adaptation": MAYBE}
MATRIX = {"R": [[MAYBE]]} | {f"{name}?": MAYBE for name in ("ACC", "BWT", "FWT", "forgetting", "held_out")}
LAYOUT: dict[Any, Any] = {
    "name": str,
    "learner": {},
    "course": {},
    "scores": {
        **dict.fromkeys(("online?", "online_frame?", "near_future?", "focus?"), ACCURACY),
        "adaptation?": {"events": [CHANGE]},
        "tests?": {"tests": [str], "rows": [str], "accuracy": MATRIX, "class_accuracy": MATRIX},
    },
    "labels": {"given": int, "undelivered?": int, "ledger": str},
    "clock": {"cost": NUMBER, "skipped": int},
    "resources": {
        "wall_seconds": {str: NUMBER},
        "cpu_seconds": {str: NUMBER},
        "calls": {str: int},
        "stored_bytes": int | None,
    },
    "frames": {"digests": [str]},
}


def check_score(content: Any) -> None:
    """Check the JSON values of a score.

    Raises:
        ArgumentError: a value is missing or wrong; the message names its place.
    """
    _check(content, LAYOUT, "")
    if (found := content["scores"].get("tests")) is not None:
        shape = [len(found["tests"])] * len(found["rows"])
        for measure in ("accuracy", "class_accuracy"):
            if [len(row) for row in found[measure]["R"]] != shape:
                size = f"{counted(len(shape), 'row')} of {counted(len(found['tests']), 'test')}"
                raise ArgumentError(f"scores.tests.{measure}.R: must be {size}; the file is damaged")


def _check(value: Any, layout: Any, path: str) -> None:
    match layout:
        case dict():
            _check_type(value, Mapping, "an object", path)
            for key, part in layout.items():
                name = "" if key is str else key.removesuffix("?")
                if key == name and name not in value:
                    raise ArgumentError(f"{_member(path, name)}: is missing; the file is damaged")
                for each in value if key is str else value.keys() & {name}:
                    _check(value[each], part, _member(path, each))
        case list() | tuple():
            _check_type(value, list, "a list", path)
            parts = layout if isinstance(layout, tuple) else layout * len(value)
            if len(value) != len(parts):
                raise ArgumentError(f"{path}: must have {counted(len(parts), 'value')}; the file is damaged")
            for row, (each, part) in enumerate(zip(value, parts, strict=True)):
                _check(each, part, f"{path}[{row}]")
        case _:
            expected = {str: "a text", int: "a whole number", NUMBER: "a number"}.get(layout, "a number or null")
            _check_type(value, layout, expected, path)


def _check_type(value: Any, kind: Any, expected: str, path: str) -> None:
    if not isinstance(value, kind) or isinstance(value, bool):
        raise ArgumentError(f"{path}={argument_checks.brief(value)}: must be {expected}; the file is damaged")


def _member(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name
