# SPDX-License-Identifier: Apache-2.0
"""The registry of semantic categories has every shipped label, and its ids never change."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

from tiscene.catalog import FIRST_UNREGISTERED_ID
from usd_scenes.author.category_registry import REGISTRY, extended, labels_in, update


def registry() -> dict[str, int]:
    ids: dict[str, int] = json.loads(REGISTRY.read_text(encoding="utf-8"))
    return ids


def test_every_shipped_label_is_registered() -> None:
    assert labels_in(REGISTRY.parent) <= set(registry()), "run `python -m usd_scenes.author object_view`"


def test_ids_count_from_one_in_the_order_of_the_file() -> None:
    assert list(registry().values()) == list(range(1, len(registry()) + 1))
    assert len(registry()) < FIRST_UNREGISTERED_ID
    assert all(name and name == name.strip() for name in registry())


def test_ids_of_version_0_1_0_are_unchanged() -> None:
    """Entries are appended only: data sets that were made before keep their meaning."""
    first = json.dumps(list(registry().items())[:91])
    assert hashlib.sha256(first.encode()).hexdigest()[:16] == "60e95360a025c69d"


def test_new_labels_are_appended_in_alphabetical_order() -> None:
    assert extended({"wall": 1, "bed": 2}, ["oven", "bed", "kettle"]) == {"wall": 1, "bed": 2, "kettle": 3, "oven": 4}
    assert extended({}, []) == {}


def test_update_keeps_ids_and_adds_labels_of_variants(tmp_path: Path) -> None:
    (tmp_path / "kitchen").mkdir()
    (tmp_path / "kitchen" / "scene.usda").write_text(
        '#usda 1.0\ndef Xform "Kitchen" (\n    variantSets = "size"\n)\n{\n'
        '    def Cube "A" (\n        prepend apiSchemas = ["SemanticsLabelsAPI:class"]\n    )\n    {\n'
        '        token[] semantics:labels:class = ["dishwasher", "wall"]\n'
        '        token[] semantics:labels:wikidata = ["Q1"]\n    }\n'
        '    variantSet "size" = {\n        "large" {\n            over "A"\n            {\n'
        '                token[] semantics:labels:class = ["hood"]\n            }\n        }\n    }\n}\n'
    )
    update(tmp_path)
    written = json.loads((tmp_path / "categories.json").read_text(encoding="utf-8"))
    assert written == {**registry(), "dishwasher": len(registry()) + 1, "hood": len(registry()) + 2}
