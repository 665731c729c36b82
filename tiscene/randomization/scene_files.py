# SPDX-License-Identifier: Apache-2.0
"""Scenes and templates that scenarios are drawn for; those read last are kept."""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping
from pathlib import Path

from tiscene import catalog
from tiscene.scenario.scenario import Scenario
from tiscene.scene.description import SceneDescription
from tiscene.usd.read.inspection import stage_facts
from tiscene.usd.read.stage_reader import read_stage
from tiscene.usd.read.template import read_template

KEPT = 4


def stage_of(scenario: Scenario) -> SceneDescription:
    """Return the stage of a scenario with its variants, as authored: without overrides.

    Raises:
        SceneNotFound, MissingFile, StageError: it cannot be read.
    """
    file = catalog.find_scene(scenario.scene)
    return _stage(file, file.stat().st_mtime_ns, json.dumps(scenario.variants, sort_keys=True))


def variant_sets_of(scenario: Scenario) -> Mapping[str, tuple[str, tuple[str, ...]]]:
    """Return the variant sets of a scenario's stage: {"/Prim{set}": (selected by the stage, all variants)}."""
    file = catalog.find_scene(scenario.scene)
    return _variant_sets(file, file.stat().st_mtime_ns)


def templates_of(scenario: Scenario, up_axis: str) -> list[SceneDescription]:
    """Return the templates of a scenario's objects, in the order of first use.

    Args:
        scenario: the scenario.
        up_axis: of its stage.

    Raises:
        TemplateNotFound, MissingFile, StageError: one cannot be read.
    """
    names = dict.fromkeys(each.template for each in scenario.objects if not catalog.is_prim_path(each.template))
    stage = {template.name: template.description for template in stage_of(scenario).templates}
    return [stage[name] if name in stage else _template(name, up_axis) for name in names]


@functools.lru_cache(maxsize=KEPT)
def _stage(file: Path, modified: int, variants: str) -> SceneDescription:
    """Read a stage; `modified` invalidates the cache."""
    return read_stage(file, variants=json.loads(variants) or None)


@functools.lru_cache(maxsize=KEPT)
def _variant_sets(file: Path, modified: int) -> Mapping[str, tuple[str, tuple[str, ...]]]:
    return stage_facts(file).variants


@functools.lru_cache(maxsize=64)
def _template(name: str, up_axis: str) -> SceneDescription:
    file, variants = catalog.find_template(name), catalog.template_variants(name)[1]
    return read_template(file, up_axis="Z" if up_axis == "Z" else "Y", variants=variants).description
