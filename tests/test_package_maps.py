# SPDX-License-Identifier: Apache-2.0
"""The module lists in the docstrings of packages name exactly the modules that exist."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
# An indented line of names; text after two spaces describes them.
LINE = re.compile(r"^ {4,}((?:\w+, )*\w+)(?: {2,}.*)?$", re.MULTILINE)


PACKAGES = [path.parent for name in ("tiscene", "dynamics") for path in sorted((ROOT / name).rglob("__init__.py"))]


@pytest.mark.parametrize("folder", PACKAGES, ids=lambda folder: str(folder.relative_to(ROOT)))
def test_package_docstring_lists_exactly_its_modules(folder):
    docstring = ast.get_docstring(ast.parse((folder / "__init__.py").read_text("utf-8"))) or ""
    listed = [name for names in LINE.findall(docstring) for name in names.split(", ")]
    existing = {path.stem for path in folder.glob("*.py")} | {path.parent.name for path in folder.glob("*/__init__.py")}
    assert sorted(listed) == sorted(name for name in existing if not name.startswith("__"))
