# SPDX-License-Identifier: Apache-2.0
"""Convert SAILenv's JSON to tiscene's scenario objects: objects, trajectories, timings, frustum walls.

A vector is {"x": 1, "y": 2, "z": 3} or a list of three numbers, in Unity's space (m, degrees). Every function raises
ScenarioError for content that cannot be converted.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

import dynamics
import tiscene.scenario.objects as native_objects
import tiscene.scenario.scenario as native
from dynamics import argument_checks
from tiscene.errors import ArgumentError, ArgumentTypeError, ScenarioError, TisceneError
from tiscene.sailenv.unity_coordinates import mirrored, mirrored_euler
from tiscene.scene.camera import Vector3

MAX_COORDINATE = 1e6  # m, or degrees
MAX_OBJECTS = 10_000  # of a scenario; other agents wait while it is read
ALL_TOGETHER = {"type": "all_together", "description": {"wait_time": 0.0}}
INVALID = TypeError, ValueError, LookupError, AttributeError, OverflowError  # what reading an invalid value raises


def vector(value: Any) -> Vector3:
    """Return the three numbers of a mapping with the keys x, y, z, or of a sequence."""
    try:
        x, y, z = (value[axis] for axis in "xyz") if isinstance(value, Mapping) else (value[axis] for axis in range(3))
        return (float(x), float(y), float(z))
    except INVALID as error:
        raise ScenarioError(f"{argument_checks.brief(value)}: must be three numbers x, y, z") from error


def integer(value: Any, name: str) -> int:
    """Return a whole number, which may be text, as ids are. Raises ArgumentTypeError."""
    try:
        return int(value)
    except INVALID as error:
        raise ArgumentTypeError(f"{name}={argument_checks.brief(value)}: must be an integer") from error


def number(value: Any, name: str) -> float:
    """Return a number, which may be text. Raises ArgumentTypeError."""
    try:
        return float(value)
    except INVALID as error:
        raise ArgumentTypeError(f"{name}={argument_checks.brief(value)}: must be a number") from error


def rounded(value: Any) -> float:
    """Return a number rounded to single precision, as the protocol and Unity have it."""
    try:
        return float(np.float32(value))
    except INVALID as error:
        raise ArgumentTypeError(f"{argument_checks.brief(value)}: must be a number") from error


def single_precision(value: Any) -> Vector3:
    """Return a vector rounded to single precision, as the protocol and Unity have it."""
    x, y, z = np.array(vector(value), np.float32).tolist()
    return (x, y, z)


def bounded(numbers: Vector3) -> Vector3:
    """Return a position or angles unchanged. Raises ArgumentError for a number that is nan or beyond MAX_COORDINATE."""
    if not all(abs(component) <= MAX_COORDINATE for component in numbers):
        raise ArgumentError(f"{numbers}: must be three numbers from -{MAX_COORDINATE:g} to {MAX_COORDINATE:g}")
    return numbers


def dynamic_of(kind: str, description: Mapping[str, Any]) -> dynamics.Dynamic:
    """Return the trajectory of an object.

    Args:
        kind: SAILenv's type: linear_waypoints, catmull_waypoints or uniform_movement_random_bounce.
        description: SAILenv's parameters of that type; missing ones have SAILenv's defaults.
    """
    with _error_context(f"dynamic of type {kind}"):
        given = {key: value for key, value in description.items() if value is not None}
        match kind:
            case "linear_waypoints" | "catmull_waypoints":
                loop = dynamics.LinearWaypoints if kind == "linear_waypoints" else dynamics.CatmullWaypoints
                contents = given.get("waypoints")
                if not isinstance(contents, list) or not all(isinstance(each, Mapping) for each in contents):
                    raise ScenarioError(f"waypoints={argument_checks.brief(contents)}: must be a list of waypoints")
                waypoints = [_waypoint(each) for each in contents]
                total_time = number(given.get("total_time", 10.0), "total_time")
                return loop(waypoints * 2 if len(waypoints) == 1 else waypoints, total_time)
            case "uniform_movement_random_bounce":
                return dynamics.UniformMovementRandomBounce(
                    speed=number(given.get("speed", 5.0), "speed"),
                    angular_speed=number(given.get("angular_speed", 2.0), "angular_speed"),
                    start_direction=mirrored(vector(given.get("start_direction", (0.0, 0.0, 1.0)))),
                    seed=integer(given.get("seed", 42), "seed"),
                )
        raise ScenarioError("must be linear_waypoints, catmull_waypoints or uniform_movement_random_bounce")


def timings_of(content: Any, names: Sequence[str], valid: Collection[str]) -> dynamics.Timing:
    """Return the timing of a scenario.

    Args:
        content: SAILenv's timings; None for all objects together without delay.
        names: The names of the scenario's objects in order.
        valid: The names of those objects that are valid; times of others are ignored.
    """
    with _error_context("timings"):
        content = content or ALL_TOGETHER
        description = content.get("description") or {}
        match content.get("type"):
            case "all_together":
                return dynamics.AllTogether(number(description.get("wait_time", 1.0), "wait_time"))
            case "wait_until_complete":
                return dynamics.WaitUntilComplete(number(description.get("wait_time", 0.0), "wait_time"))
            case "dict":
                known = frozenset(names)
                times = {
                    _object_name(key, names, known): number(seconds, f"times[{key!r}]")
                    for key, seconds in (description.get("times") or {}).items()
                }
                return dynamics.DictTimings([(name, seconds) for name, seconds in times.items() if name in valid])
        raise ScenarioError(f"type {content.get('type')!r}: must be all_together, wait_until_complete or dict")


def frustum_of(content: Any) -> native_objects.Frustum | None:
    """Return the walls of a view; None for none. Content: SAILenv's frustum, or a bool from early clients."""
    if not isinstance(content, Mapping):
        return native_objects.Frustum() if content else None
    if not content.get("spawn", True):
        return None
    with _error_context("frustum"):
        far = number(content.get("far_clip_plane", -1.0), "far_clip_plane")
        return native_objects.Frustum(far if far > 0.0 else -1.0)


def object_of(content: Mapping[str, Any], name: str) -> native_objects.Object:
    """Return an object of a scenario.

    Args:
        content: SAILenv's object; its template is still SAILenv's name of it.
        name: Its name, unique in the scenario.
    """
    with _error_context(f"object {name!r}"):
        dynamic = content.get("dynamic")
        return native_objects.Object(
            name,
            str(content.get("prefab")),
            mirrored(bounded(vector(content.get("position", (0.0, 0.0, 0.0))))),
            mirrored_euler(bounded(vector(content.get("rotation", (0.0, 0.0, 0.0))))),
            dynamic_of(str(dynamic.get("type")), dynamic.get("description") or {}) if dynamic else None,
            frustum_limited=bool(content.get("frustum_limited", True)),
        )


def scenario_of(
    content: Mapping[str, Any], scene: str, find_template: Callable[[str], tuple[str, Vector3]], physics: bool = False
) -> tuple[native.Scenario, list[str], list[str]]:
    """Return a scenario without its invalid objects.

    Args:
        content: SAILenv's scenario.
        scene: The name of the scene in tiscene's catalog.
        find_template: Returns tiscene's name of a template and its scale, given SAILenv's name.
        physics: Whether objects without a dynamic fall and are pushed, if the content does not say (key `physics`).

    Returns:
        The scenario, the name of each object of the content, and a message for each invalid one.
    """
    contents = content.get("objects")
    contents = [] if contents is None else contents
    if not isinstance(contents, list) or not all(isinstance(each, dict) for each in contents):
        raise ScenarioError("objects: must be a list of objects")
    if len(contents) > MAX_OBJECTS:
        raise ScenarioError(f"objects: there are {len(contents)}; the limit is {MAX_OBJECTS}")
    names = object_names(contents)
    objects, problems = [], []
    for name, each in zip(names, contents, strict=True):
        try:
            made = object_of(each, name)
            template, scale = find_template(made.template)
            objects.append(replace(made, template=template, scale=scale))
        except TisceneError as error:
            problems.append(str(error))
    timings = timings_of(content.get("timings"), names, {each.id for each in objects})
    frustum = frustum_of(content.get("frustum", content.get("spawn_frustum")))  # early clients send the second key
    return (
        native.Scenario(scene, objects, timings, frustum, physics=bool(content.get("physics", physics))),
        names,
        problems,
    )


def object_names(contents: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return unique names of a scenario's objects: their ids, with a number where an id is repeated."""
    names: dict[str, None] = {}  # in order
    last: dict[str, int] = {}  # number of each id
    for row, content in enumerate(contents):
        id = str(content.get("id") or f"object_{row}")
        number, name = last.get(id, 1), id
        while name in names:
            number += 1
            name = f"{id} ({number})"
        last[id] = number
        names[name] = None
    return list(names)


def _waypoint(content: Mapping[str, Any]) -> dynamics.Waypoint:
    position, rotation = vector(content.get("position", (0, 0, 0))), vector(content.get("rotation", (0, 0, 0)))
    return dynamics.Waypoint(mirrored(bounded(position)), mirrored_euler(bounded(rotation)))


def _object_name(key: Any, names: Sequence[str], known: Collection[str]) -> str:
    """Return the name of the object that a key of timings refers to, by name or index; "" for none."""
    text = str(key)  # JSON turns an index into text
    if text in known:
        return text
    return names[int(text)] if text.isdecimal() and int(text) < len(names) else ""


@contextmanager
def _error_context(context: str) -> Iterator[None]:
    """Convert errors of invalid values to a ScenarioError whose message begins with the context."""
    try:
        yield
    except INVALID as error:
        raise ScenarioError(f"{context}: {error}") from error
