"""The maps in the docstrings of packages: they name all of their modules, and nothing that is gone."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
# An indented line of names; what stands after two spaces explains them.
LINE = re.compile(r"^ {4,}((?:\w+, )*\w+)(?: {2,}.*)?$", re.MULTILINE)


@pytest.mark.parametrize("package", ["dynamics", "tiscene", "tiscene/sailenv", "tiscene/scene", "tiscene/usd"])
def test_a_map_names_what_is_there(package):
    folder = ROOT / package
    docstring = ast.get_docstring(ast.parse((folder / "__init__.py").read_text("utf-8"))) or ""
    named = [name for names in LINE.findall(docstring) for name in names.split(", ")]
    there = {path.stem for path in folder.glob("*.py")} | {path.parent.name for path in folder.glob("*/__init__.py")}
    assert sorted(named) == sorted(name for name in there if not name.startswith("__"))
