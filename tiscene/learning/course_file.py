# SPDX-License-Identifier: Apache-2.0
"""Courses as JSON. Scenarios stand in a table of their own; phases that show the same one refer to it by its key."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from typing import Any

from dynamics import argument_checks
from tiscene.errors import ArgumentError
from tiscene.learning.drift import SCENARIO, Drift, Schedule
from tiscene.learning.phase import Phase
from tiscene.learning.supervision_rules import SupervisionRules
from tiscene.learning.teaching_policies import Policy
from tiscene.scenario import serialization
from tiscene.scenario.scenario import Scenario
from tiscene.scenario.serialization import DerivedClasses

FORMAT, VERSION = "tiscene.course", 1
UNSAVED = ("arch", "progress", "limits")  # settings that change no frame


# Which classes a field holds, by its name; see `tiscene.scenario.serialization`.
FIELDS: dict[str, Mapping[str, type]] = {
    "drift": {"Drift": Drift},
    "parts": DerivedClasses(Policy),
    "policy": DerivedClasses(Policy),
    "schedule": DerivedClasses(Schedule),
    "supervision": {"SupervisionRules": SupervisionRules},
    "values": {},
}


def encode(members: Mapping[str, Any]) -> dict[str, Any]:
    """Return a course's members as JSON values.

    Raises:
        ArgumentError: a setting cannot be written.
    """
    scenarios: dict[str, Any] = {}
    keys: dict[str, str] = {}

    def key(scenario: Scenario) -> str:
        content = scenario.to_json()
        text = serialization.dumps(content)
        if text not in keys:
            keys[text] = str(len(keys) + 1)
            scenarios[keys[text]] = content
        return keys[text]

    def phase(each: Phase, path: str) -> dict[str, Any]:
        content: dict[str, Any] = {}
        for field in fields(Phase):
            value = getattr(each, field.name)
            if value == field.default:
                continue
            if field.name == "scenario":
                content[field.name] = key(value)
            elif field.name == "drift":
                content[field.name] = [_drift(drift, key, f"{path}.drift") for drift in value]
            else:
                content[field.name] = serialization.encode(
                    value, FIELDS, FIELDS.get(field.name), f"{path}.{field.name}"
                )
        return content

    settings = {name: value for name, value in members["settings"].items() if name not in UNSAVED}
    return {
        "format": FORMAT,
        "version": VERSION,
        "settings": serialization.encode(settings, FIELDS, {}, "settings"),
        "boundaries": members["boundaries"],
        "observed": list(members["observed"]),
        "pixels": members["pixels"],
        "phases": [phase(each, f"phases[{row}]") for row, each in enumerate(members["phases"])],
        "tests": [phase(each, f"tests[{row}]") for row, each in enumerate(members["tests"])],
        "scenarios": scenarios,
    }


def _drift(drift: Drift, key: Callable[[Scenario], str], path: str) -> dict[str, Any]:
    values: Any = drift.values
    if drift.factor == SCENARIO:
        values = [key(each) for each in values]
    schedule = serialization.encode(drift.schedule, FIELDS, FIELDS["schedule"], f"{path}.schedule")
    return {
        "factor": drift.factor,
        "values": serialization.encode(values, FIELDS, {}, f"{path}.values"),
        "schedule": schedule,
        "seed": drift.seed,
    }


def decode(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of a course from JSON values.

    Raises:
        ArgumentError, ScenarioError: a value is wrong; the message names its place.
    """
    if not isinstance(content, Mapping) or content.get("format") != FORMAT:
        raise ArgumentError(f'not a course: it should be an object with "format": "{FORMAT}"')
    if content.get("version") != VERSION:
        raise ArgumentError(f"version: {content.get('version')!r}, but this tiscene reads version {VERSION}")
    known = {"format", "version", "settings", "boundaries", "observed", "pixels", "phases", "tests", "scenarios"}
    if unknown := sorted(set(content) - known):
        raise ArgumentError(f"{unknown[0]}: a course has no such key; there are {', '.join(sorted(known))}")

    def member(name: str, kind: type, default: Any) -> Any:
        value = content.get(name, default)
        if not isinstance(value, kind):
            expected = "an object" if kind is Mapping else "a list"
            raise ArgumentError(f"{name}={argument_checks.brief(value)}: must be {expected}")
        return value

    scenarios = {name: Scenario.from_json(each) for name, each in member("scenarios", Mapping, {}).items()}

    def scenario(name: Any, path: str) -> Scenario:
        if not isinstance(name, str) or name not in scenarios:
            raise ArgumentError(f"{path}={name!r}: no such key in scenarios; there are {', '.join(scenarios)}")
        return scenarios[name]

    def drift(each: Any, path: str) -> Any:
        is_of_scenarios = isinstance(each, Mapping) and each.get("factor") == SCENARIO
        if is_of_scenarios and isinstance(each.get("values"), list):
            return {**each, "values": [scenario(name, f"{path}.values") for name in each["values"]]}
        return each

    def phase(each: Any, path: str) -> Any:
        if not isinstance(each, Mapping):
            raise ArgumentError(f"{path}={argument_checks.brief(each)}: must be an object")
        found = {**each, "scenario": scenario(each.get("scenario"), f"{path}.scenario")}
        if isinstance(found.get("drift"), list):
            found["drift"] = [drift(one, f"{path}.drift[{row}]") for row, one in enumerate(found["drift"])]
        return serialization.decode(found, FIELDS, {"Phase": Phase}, path)

    return {
        "settings": serialization.decode(member("settings", Mapping, {}), FIELDS, {}, "settings"),
        "boundaries": content.get("boundaries", "hidden"),
        "observed": content.get("observed", ("rgb",)),
        "pixels": content.get("pixels", "objects"),
        "phases": [phase(each, f"phases[{row}]") for row, each in enumerate(member("phases", list, []))],
        "tests": [phase(each, f"tests[{row}]") for row, each in enumerate(member("tests", list, []))],
    }
