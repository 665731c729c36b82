# SPDX-License-Identifier: Apache-2.0
"""Factors of variation of a scenario, by name: the registry of `Scenario.with_factor` and of drift schedules.

A factor takes a scenario to the same scenario with one aspect drawn anew: a counterfactual. Each factor has random
numbers of its own, keyed by (seed, factor, object or light), so that no factor changes another one's draws. Applied
twice, the second time counts, except for `speed`, whose factors multiply, and for `instances`, `categories` and
`rooms`, which draw another one than the one before.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import replace
from typing import Any, get_args

from dynamics.argument_checks import integer
from tiscene.device import runtime
from tiscene.errors import UnknownName
from tiscene.randomization.clutter_factor import with_clutter
from tiscene.randomization.draws import Draws
from tiscene.randomization.furniture_factor import with_furniture
from tiscene.randomization.illumination_factor import with_illumination
from tiscene.randomization.material_factor import with_materials_drawn
from tiscene.randomization.object_factors import with_categories, with_instances, with_speed
from tiscene.randomization.path_factors import with_occlusion, with_room
from tiscene.randomization.scene_files import stage_of, templates_of
from tiscene.randomization.view_factor import with_view
from tiscene.scenario.overrides import LightOverride, MaterialOverride, Override
from tiscene.scenario.scenario import Scenario

# Functions of (scenario, value, draws), whose docstrings say what values they take.
FACTORS: dict[str, Callable[[Scenario, Any, Callable[[str], Draws]], Scenario]] = {
    "categories": with_categories,
    "instances": with_instances,
    "views": with_view,
    "clutter": with_clutter,
    "occlusion": with_occlusion,
    "rooms": with_room,
    "illumination": with_illumination,
    "materials": with_materials_drawn,
    "furniture": with_furniture,
    "speed": with_speed,
}


@runtime.one_thread_at_a_time
def with_factor(scenario: Scenario, name: str, value: Any = None, *, seed: int = 0) -> Scenario:
    """Return a scenario with one factor drawn anew, and everything else as it was.

    Args:
        scenario: the scenario.
        name: one of FACTORS.
        value: value or ranges of the factor, as its function takes it; None: a typical range.
        seed: 0 to 2^64 - 1. Of the same seed, no other factor's draws change.

    Raises:
        UnknownName: there is no such factor.
        ArgumentError: the value is wrong.
        ScenarioError: the scenario cannot have it.
    """
    if name not in FACTORS:
        raise UnknownName("factor", str(name), FACTORS)
    seed = integer(seed, "seed", 0, 2**64 - 1)
    drawn = FACTORS[name](scenario, value, lambda part: factor_draws(seed, name, part))
    return without_missing(drawn) if drawn.overrides else drawn


def without_missing(scenario: Scenario) -> Scenario:
    """Return a scenario without overrides of lights and materials that its variants and templates do not have.

    The others are ordered by their kind, so that the order in which factors are applied does not matter.
    """
    stage = stage_of(scenario)
    lights = {name for each in stage.lights for name in (each.prim_path, each.name)}
    descriptions = [stage, *templates_of(scenario).values()]
    materials = [{name for each in one.materials for name in (each.prim_path, each.name)} for one in descriptions]

    def exists(each: Override) -> bool:
        if isinstance(each, LightOverride):
            return each.prim in lights
        if isinstance(each, MaterialOverride):
            return any(each.prim in names and each.like in (None, *names) for names in materials)
        return True

    kept = [each for each in scenario.overrides if exists(each)]
    return replace(scenario, overrides=sorted(kept, key=lambda each: get_args(Override).index(type(each))))


def factor_draws(seed: int, factor: str, part: str = "") -> Draws:
    """Return the random numbers of a factor for one object, light or material; "" for the scenario."""
    digest = hashlib.sha256(f"{factor}\n{part}".encode()).digest()
    return Draws(seed, int.from_bytes(digest[:8], "little"))
