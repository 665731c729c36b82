# SPDX-License-Identifier: Apache-2.0
"""Relative paths in JSON files of scenarios: they count from the file's folder, else from the working directory."""

from __future__ import annotations

import filecmp
import os
import warnings
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from tiscene import catalog
from tiscene.errors import StageWarning

FILES = catalog.STAGE_SUFFIXES + catalog.SCENARIO_SUFFIXES


def from_folder(content: Any, folder: Path) -> Any:
    """Return the scenario of a file in a folder, as JSON values, with paths from the working directory."""
    place = partial(beside, folder=folder)
    return with_files(content, place, place)


def with_files(content: Any, scene: Callable[[str], str], template: Callable[[str], str]) -> Any:
    """Return a scenario, as JSON values, with other files; values of the wrong kind stay, and are refused later.

    Args:
        content: The scenario.
        scene: Returns the scene in place of another.
        template: Returns the template, with its variants, in place of another.
    """
    if not isinstance(content, Mapping):
        return content
    result = dict(content)
    if isinstance(content.get("scene"), str):
        result["scene"] = scene(content["scene"])
    for part in ("objects", "edits"):
        if isinstance(content.get(part), list):
            result[part] = [_with_template(each, template) for each in content[part]]
    return result


def _with_template(content: Any, template: Callable[[str], str]) -> Any:
    """Return an object or an edit with another template."""
    if not isinstance(content, Mapping):
        return content
    return {
        key: template(value)
        if key == "template" and isinstance(value, str) and not catalog.is_prim_path(value)
        else _with_template(value, template)
        for key, value in content.items()
    }


def beside(name: str, folder: Path) -> str:
    """Return a scene or template that a file in a folder names, by a path from the working directory.

    A relative path counts from the folder, as in USD, or from the working directory if there is no such file. Warns
    where both have other contents.

    Args:
        name: A path, with or without the variants of a template; names in the catalog stay as they are.
        folder: The folder.
    """
    path, brace, variants = name.partition("{")
    if Path(path).suffix.lower() not in FILES or path.startswith("~"):
        return name
    mine, working = folder / path, Path(path)
    if not mine.is_file():
        return name
    if working.is_file():
        if os.path.samefile(mine, working):
            return name
        if not filecmp.cmp(mine, working, shallow=False):
            warnings.warn(StageWarning(
                f"{path!r} is in {str(folder)!r}, where the file is that names it, and in the working directory, with "
                "another content: that in the folder is used"
            ), stacklevel=2)  # fmt: skip
    return f"{mine}{brace}{variants}"
