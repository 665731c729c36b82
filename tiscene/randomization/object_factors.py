# SPDX-License-Identifier: Apache-2.0
"""Factors of a scenario's objects: their speed, their instances and their categories. Paths and ids stay."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

import dynamics
from dynamics import Dynamic
from dynamics.argument_checks import is_number
from tiscene import catalog
from tiscene.errors import ArgumentError, ScenarioError
from tiscene.randomization.draws import Draws
from tiscene.randomization.ranges import range_of, words_of
from tiscene.randomization.template_extent import template_extent
from tiscene.scenario.objects import Object
from tiscene.scenario.scenario import Scenario
from tiscene.usd.read.inspection import stage_facts

TYPICAL_SPEED = (0.5, 2.0)
ROOM_TO_SPARE = 1.1  # a template that is that much larger than the one it replaces is used as it is
DISTRACTOR = "distractor_"  # the ids of distractors begin so


def is_distractor(each: Object) -> bool:
    """Return whether an object was drawn as clutter."""
    return each.id.startswith(DISTRACTOR)


def is_kept(each: Object) -> bool:
    """Return whether no factor changes an object's template and path: a distractor's, or those of the stage's own."""
    return is_distractor(each) or catalog.is_prim_path(each.template)


def with_speed(scenario: Scenario, value: Any, draws: Callable[[str], Draws]) -> Scenario:
    """Return a scenario whose objects move along the same paths at other speeds.

    Args:
        scenario: the scenario.
        value: factor of all speeds; (low, high): drawn for each object, on a logarithmic scale; None: (0.5, 2).
        draws: returns the random numbers of an object.
    """
    low, high = range_of(TYPICAL_SPEED if value is None else value, "speed", 1e3, 1e-3)
    objects = []
    for each in scenario.objects:
        drawn = float(np.exp(draws(each.id).between("speed", 0, np.log(low), np.log(high))))
        factor = low if low == high else drawn
        dynamic = None if each.dynamic is None else faster(each.dynamic, factor, each.id)
        objects.append(replace(each, dynamic=dynamic))
    return replace(scenario, objects=objects)


def faster(dynamic: Dynamic, factor: float, name: str) -> Dynamic:
    """Return a trajectory along the same path, at a multiple of its speed.

    Args:
        dynamic: the trajectory.
        factor: factor of its speed.
        name: the object's id, for messages.

    Raises:
        ScenarioError: a trajectory of a user's class without a `total_time`, `period` or `speed`.
    """
    if isinstance(dynamic, dynamics.Still):
        return dynamic
    if isinstance(dynamic, dynamics.Composite):
        return replace(dynamic, parts=tuple(faster(part, factor, name) for part in dynamic.parts))  # type: ignore[misc]
    if isinstance(dynamic, dynamics.LookAt):
        return replace(dynamic, motion=faster(dynamic.motion, factor, name))  # type: ignore[arg-type]
    if isinstance(dynamic, dynamics.Keyframes):
        return replace(dynamic, times=tuple(time / factor for time in dynamic.times))
    changes = {field: getattr(dynamic, field) / factor for field in ("total_time", "period") if hasattr(dynamic, field)}
    changes |= {
        field: getattr(dynamic, field) * factor for field in ("speed", "angular_speed") if hasattr(dynamic, field)
    }
    if not changes or not all(is_number(each) for each in changes.values()):
        kind = type(dynamic).__name__
        raise ScenarioError(f"object {name!r} moves by {kind}, whose speed is unknown: give it a field `speed`, in m/s")
    return replace(dynamic, **changes)  # type: ignore[type-var]


def with_instances(scenario: Scenario, value: Any, draws: Callable[[str], Draws]) -> Scenario:
    """Return a scenario whose objects are other instances of their categories, on the same paths.

    Args:
        scenario: the scenario.
        value: templates to draw from; None: the templates of each object's category, and their variants.
        draws: returns the random numbers of an object.

    Raises:
        TemplateNotFound: there is no such template.
        ScenarioError: a category has no other template or variant.
    """
    allowed = None if value is None else words_of([value] if isinstance(value, str) else value, "instances")

    def choices(each: Object) -> Sequence[str]:
        if allowed is not None:
            return allowed
        wanted = category_of(each.template)
        names = [name for name, entry in catalog.templates().items() if entry.category == wanted]
        known = [variant for name in names or [each.template] for variant in instances_of(name)]
        others = [name for name in known if not _same(name, each.template)]
        if not others:
            text = f"object {each.id!r}: {wanted!r} has no template or variant but {each.template!r}"
            raise ScenarioError(f"{text}; name templates to draw from")
        return others

    return _with_templates(scenario, choices, draws)


def with_categories(scenario: Scenario, value: Any, draws: Callable[[str], Draws]) -> Scenario:
    """Return a scenario whose objects are of other categories, on the same paths.

    Args:
        scenario: the scenario.
        value: names of categories to draw from; None: all that have a template.
        draws: returns the random numbers of an object.

    Raises:
        ArgumentError: a category has no template.
    """
    by_category: dict[str, list[str]] = {}
    for name, entry in catalog.templates().items():
        if entry.category:
            by_category.setdefault(entry.category, []).append(name)
    known = sorted(by_category)
    wanted = known if value is None else words_of([value] if isinstance(value, str) else value, "categories")
    for name in wanted:
        if name not in by_category:
            raise ArgumentError(f"categories: no template has the category {name!r}; there are {', '.join(known)}")

    def choices(each: Object) -> Sequence[str]:
        own = category_of(each.template)
        names = [name for name in wanted if name != own] or list(wanted)
        order = np.argsort(draws(each.id).uniform("category", 0, len(names)), kind="stable")
        return by_category[names[int(order[0])]]

    return _with_templates(scenario, choices, draws)


def instances_of(template: str) -> list[str]:
    """Return a template with each of its variants, but for those of its appearance: "Chair 01{color=oak}", ..."""
    name = catalog.template_variants(template)[0]
    sets = stage_facts(catalog.find_template(name)).variants
    result = [name]
    for prim, (selected, variants) in sets.items():
        path, _, variant_set = prim.removesuffix("}").partition("{")
        if path.count("/") == 1 and variant_set != "appearance":
            result += [f"{name}{{{variant_set}={each}}}" for each in variants if each != selected]
    return result


def category_of(template: str) -> str:
    """Return the category of a template, with or without variants."""
    name = catalog.template_variants(template)[0]
    known = catalog.templates().get(name)
    return (known or catalog.TemplateEntry(name, catalog.find_template(name))).category


def _same(a: str, b: str) -> bool:
    """Return whether two names of templates mean the same, whatever the order of their variants."""
    return catalog.template_variants(a) == catalog.template_variants(b)


def _with_templates(
    scenario: Scenario, choices: Callable[[Object], Sequence[str]], draws: Callable[[str], Draws]
) -> Scenario:
    """Return a scenario whose objects have templates that are drawn from the choices of each."""
    objects = [each if is_kept(each) else _replaced(each, choices(each), draws(each.id)) for each in scenario.objects]
    return replace(scenario, objects=objects)


def _replaced(each: Object, choices: Sequence[str], draws: Draws) -> Object:
    """Return an object of another template: one that has room on its path, else scaled so that it has."""
    size = _radius(each.template) * max(each.scale)  # type: ignore[arg-type]
    order = np.argsort(draws.uniform("template", 0, len(choices)), kind="stable").tolist()
    scale = float(max(each.scale))  # type: ignore[arg-type]
    for row in order:
        if _radius(choices[row]) * scale <= ROOM_TO_SPARE * size:
            return replace(each, template=choices[row], scale=scale)
    name = choices[order[0]]
    return replace(each, template=name, scale=round(size / _radius(name), 4))


def _radius(template: str) -> float:
    return template_extent(template, "Y").radius
