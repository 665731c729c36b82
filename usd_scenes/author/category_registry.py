# SPDX-License-Identifier: Apache-2.0
"""The registry of semantic categories, `usd_scenes/categories.json`: an id for every label of the shipped files.

Ids are the same in every scene and in every version: new labels are appended, and no entry is ever changed or removed.
`python -m usd_scenes.author` updates the file after it has written scenes and templates.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path

from pxr import Sdf

REGISTRY = Path(__file__).resolve().parents[1] / "categories.json"
LABELS = "semantics:labels:class"  # the attribute that `usd_writer.label` writes


def labels_in(folder: Path) -> set[str]:
    """Return the labels of all USD files below a folder, those of unselected variants included."""
    found: set[str] = set()
    for path in sorted(folder.rglob("*.usd?")):
        layer = Sdf.Layer.FindOrOpen(str(path))

        def visit(at: Sdf.Path, layer: Sdf.Layer = layer) -> None:
            if at.IsPropertyPath() and at.name == LABELS:
                found.update(layer.GetAttributeAtPath(at).default or ())

        layer.Traverse(Sdf.Path.absoluteRootPath, visit)
    return found


def extended(registry: Mapping[str, int], labels: Iterable[str]) -> dict[str, int]:
    """Return a registry with new labels appended in alphabetical order; present ids stay as they are."""
    result = dict(registry)
    for label in sorted(set(labels) - set(registry)):
        result[label] = max(result.values(), default=0) + 1
    return result


def update(folder: Path) -> None:
    """Write `categories.json` in a folder: the shipped registry, extended by the labels of the files in the folder."""
    registry = extended(json.loads(REGISTRY.read_text(encoding="utf-8")), labels_in(folder))
    text = json.dumps(registry, indent=1, ensure_ascii=False)
    (folder / REGISTRY.name).write_text(f"{text}\n", encoding="utf-8")
