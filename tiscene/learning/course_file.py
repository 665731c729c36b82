# SPDX-License-Identifier: Apache-2.0
"""Courses as JSON. Scenarios stand in a table of their own; phases that show the same one refer to it by its key."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from typing import Any

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
    scenarios = {name: Scenario.from_json(each) for name, each in content.get("scenarios", {}).items()}

    def scenario(name: Any, path: str) -> Scenario:
        if name not in scenarios:
            raise ArgumentError(f"{path}={name!r}: no such key in scenarios; there are {', '.join(scenarios)}")
        return scenarios[name]

    def phase(each: Any, path: str) -> Phase:
        if not isinstance(each, Mapping):
            raise ArgumentError(f"{path}={each!r}: must be an object")
        members = dict(each)
        arguments: dict[str, Any] = {"scenario": scenario(members.pop("scenario", None), f"{path}.scenario")}
        drifts = []
        for row, drift in enumerate(members.pop("drift", ())):
            if drift.get("factor") == SCENARIO:
                values = [scenario(name, f"{path}.drift[{row}].values") for name in drift["values"]]
                schedule = serialization.decode(drift["schedule"], FIELDS, FIELDS["schedule"], f"{path}.drift[{row}]")
                drifts.append(Drift(SCENARIO, values, schedule, drift.get("seed", 0)))
            else:
                drifts.append(serialization.decode(drift, FIELDS, FIELDS["drift"], f"{path}.drift[{row}]"))
        for name, value in members.items():
            if name not in Phase.__dataclass_fields__:
                raise ArgumentError(f"{path}.{name}: a phase has no such key")
            arguments[name] = serialization.decode(value, FIELDS, FIELDS.get(name), f"{path}.{name}")
        return Phase(**arguments, drift=drifts)

    return {
        "settings": serialization.decode(content.get("settings", {}), FIELDS, {}, "settings"),
        "boundaries": content.get("boundaries", "hidden"),
        "observed": tuple(content.get("observed", ("rgb",))),
        "pixels": content.get("pixels", "objects"),
        "phases": [phase(each, f"phases[{row}]") for row, each in enumerate(content.get("phases", ()))],
        "tests": [phase(each, f"tests[{row}]") for row, each in enumerate(content.get("tests", ()))],
    }
