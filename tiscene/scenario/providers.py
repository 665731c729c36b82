# SPDX-License-Identifier: Apache-2.0
"""Functions of higher packages that `Scenario` and `World` call by name, so that neither imports anything above it."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

# Imported at first use: neither Taichi nor USD is needed to write a scenario down.
PROVIDERS = {
    "read_usd": "tiscene.usd.scenario.read:read_scenario",
    "write_usd": "tiscene.usd.scenario.write:write_scenario",
    "sample": "tiscene.randomization.sampler:sample",
    "ranges": "tiscene.randomization.ranges:ScenarioRanges",
    "free_places": "tiscene.randomization.free_places:FreePlaces",
    "sample_difficulty": "tiscene.randomization.difficulty_search:sample_difficulty",
    "with_factor": "tiscene.randomization.factors:with_factor",
}


def provider(name: str) -> Callable[..., Any]:
    """Import and return the function registered as `name`."""
    module, function = PROVIDERS[name].split(":")
    result: Callable[..., Any] = getattr(importlib.import_module(module), function)
    return result
