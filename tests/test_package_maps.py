# SPDX-License-Identifier: Apache-2.0
"""The maps in the docstrings of packages: they name all of their modules, and nothing that is gone."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
# An indented line of names; what stands after two spaces explains them.
LINE = re.compile(r"^ {4,}((?:\w+, )*\w+)(?: {2,}.*)?$", re.MULTILINE)


PACKAGES = [path.parent for name in ("tiscene", "dynamics") for path in sorted((ROOT / name).rglob("__init__.py"))]


@pytest.mark.parametrize("folder", PACKAGES, ids=lambda folder: str(folder.relative_to(ROOT)))
def test_a_map_names_what_is_there(folder):
    docstring = ast.get_docstring(ast.parse((folder / "__init__.py").read_text("utf-8"))) or ""
    named = [name for names in LINE.findall(docstring) for name in names.split(", ")]
    there = {path.stem for path in folder.glob("*.py")} | {path.parent.name for path in folder.glob("*/__init__.py")}
    assert sorted(named) == sorted(name for name in there if not name.startswith("__"))
