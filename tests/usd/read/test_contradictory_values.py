# SPDX-License-Identifier: Apache-2.0
"""Attributes of other types, sizes and values than their schemas say: named, without any other exception or warning."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pxr import Gf, Sdf, Tf, Vt

from tiscene.errors import StageError, StageWarning
from tiscene.usd.read.stage_reader import read_stage

TEXT = Path(__file__).with_name("everything.usda").read_text(encoding="utf-8")
NUMBERS = {
    "nan": {float: math.nan},
    "infinite": {float: math.inf},
    "huge": {float: 1e38, int: 2**31 - 1, str: "bogus"},
    "negative": {float: -5.0, int: -1, str: ""},
    "zero": {float: 0.0, int: 0},
}
KINDS = ("empty", "short", "long", *NUMBERS, "strings", "pair", "removed", "blocked")


def layer() -> Sdf.Layer:
    result = Sdf.Layer.CreateAnonymous(".usda")
    assert result.ImportFromString(TEXT)
    return result


def attributes() -> list[Sdf.Path]:
    found: list[Sdf.Path] = []
    source = layer()

    def visit(path: Sdf.Path) -> None:
        if isinstance(source.GetObjectAtPath(path), Sdf.AttributeSpec):
            found.append(path)

    source.Traverse("/", visit)
    return found


def other_number(value: Any, kind: str) -> Any:
    """Return a number, text or vector with the value of a kind; None if there is none."""
    if isinstance(value, bool):
        return None
    if isinstance(value, int | float | str):
        return NUMBERS[kind].get(type(value))
    if hasattr(value, "__len__") and len(value) and isinstance(value[0], float):
        return type(value)(*[NUMBERS[kind].get(float)] * len(value))
    return None


def other_value(value: Any, kind: str) -> Any:
    """Return a value of the same type; None if the kind does not apply."""
    if not isinstance(value, Vt.IntArray | Vt.FloatArray) and "Array" not in type(value).__name__:
        return None if kind in ("empty", "short", "long") else other_number(value, kind)
    items = list(value)
    if kind == "empty":
        return type(value)()
    if not items:
        return None
    if kind in ("short", "long"):
        return type(value)(items[:-1] if kind == "short" else [*items, items[-1]])
    last = other_number(items[-1], kind)
    return None if last is None else type(value)([*items[:-1], last])


def changed(path: Sdf.Path, kind: str) -> str | None:
    """Return the stage with one attribute changed; None if the kind does not apply to it."""
    source = layer()
    prim, spec = source.GetPrimAtPath(path.GetPrimPath()), source.GetAttributeAtPath(path)
    if kind == "removed":
        prim.RemoveProperty(spec)
    elif kind == "blocked":
        spec.default = Sdf.ValueBlock()
    elif kind in ("strings", "pair"):
        name, variability = spec.name, spec.variability
        prim.RemoveProperty(spec)
        types = Sdf.ValueTypeNames
        spec = Sdf.AttributeSpec(prim, name, types.StringArray if kind == "strings" else types.Int2, variability)
        spec.default = Vt.StringArray(["a", "b"]) if kind == "strings" else Gf.Vec2i(1, 2)
    else:
        times = source.ListTimeSamplesForPath(path)
        value = source.QueryTimeSample(path, times[-1]) if times else spec.default
        try:
            value = None if value is None else other_value(value, kind)
            if value is None:
                return None
            if times:
                source.SetTimeSample(path, times[-1], value)
            else:
                spec.default = value
        except (Tf.ErrorException, TypeError, ValueError, OverflowError):
            return None  # a type that cannot hold the value
    return source.ExportToString()


def cases(step: int) -> Iterator[tuple[Sdf.Path, str, str]]:
    pairs = [(path, kind) for path in attributes() for kind in KINDS]
    for path, kind in pairs[::step]:
        text = changed(path, kind)
        if text is not None:
            yield path, kind, text


@pytest.mark.parametrize("step", [23, pytest.param(1, marks=pytest.mark.slow)])
def test_contradictory_values_are_named(tmp_path: Path, step: int) -> None:
    count = 0
    for path, kind, text in cases(step):
        count += 1
        file = tmp_path / f"stage_{count}.usda"
        file.write_text(text, encoding="utf-8")
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                description = read_stage(file)
            except StageError:
                pytest.fail(f"{path} {kind}: one attribute refused the stage")
        assert all(issubclass(each.category, StageWarning) for each in caught), f"{path} {kind}"
        assert len(description.instances) >= 8, f"{path} {kind}: more than one part is lost"
        file.unlink()
    assert count > 1000 / step


def test_attributes_of_other_types_are_named_with_theirs(tmp_path: Path) -> None:
    file = tmp_path / "stage.usda"
    text = changed(Sdf.Path("/World/Grid.faceVertexIndices"), "strings")
    assert text is not None
    file.write_text(text, encoding="utf-8")
    with pytest.warns(StageWarning, match=r"</World/Grid> .*: faceVertexIndices is string\[\], expected int"):
        read_stage(file)
