# SPDX-License-Identifier: Apache-2.0
"""`tiscene list`: the names of scenes, object templates and buffers."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from typing import Any

from tiscene import catalog
from tiscene.errors import StageError
from tiscene.frame.buffers import BUFFERS


def run(args: argparse.Namespace) -> None:
    """Print scenes and templates with their files and buffers with their meaning, as text or as JSON."""
    if args.json:
        print(json.dumps(contents(), indent=1, ensure_ascii=False))
        return
    _print_section("Scenes", {name: scene.path for name, scene in catalog.scenes().items()})
    _print_section("Templates", {name: template.path for name, template in catalog.templates().items()})
    _print_section("Buffers", {name: buffer.doc for name, buffer in BUFFERS.items()})


def contents() -> dict[str, list[dict[str, Any]]]:
    """Return the rows of `scenes`, `templates`, `categories` and `buffers` as JSON values.

    The category of a template is "" if it has none and None if its file cannot be read.
    """
    return {
        "scenes": [{"name": scene.name, "path": str(scene.path)} for scene in catalog.scenes().values()],
        "templates": [
            {"name": template.name, "category": _category(template), "path": str(template.path)}
            for template in catalog.templates().values()
        ],
        "categories": [{"name": name, "id": id} for name, id in catalog.categories().items()],
        "buffers": [
            {"name": name, "dtype": buffer.dtype, "unit": buffer.unit, "meaning": buffer.doc}
            for name, buffer in BUFFERS.items()
        ],
    }


def _category(template: catalog.TemplateEntry) -> str | None:
    try:
        return template.category
    except StageError:
        return None


def _print_section(title: str, lines: Mapping[str, object]) -> None:
    print(f"{title}:" if lines else f"{title}: none")
    width = max((len(name) for name in lines), default=0)
    for name, text in lines.items():
        print(f"  {name:<{width}}  {text}")
