# SPDX-License-Identifier: Apache-2.0
"""SAILenv's JSON as tiscene's objects. Vectors may be {"x", "y", "z"} or three numbers in a row."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import dynamics
import tiscene.scenario.objects as native_objects
from tiscene.errors import ArgumentError, ScenarioError
from tiscene.sailenv.unity_coordinates import mirrored, mirrored_euler
from tiscene.scene.camera import Vector3

FARTHEST = 1e6  # m, and degrees
ALL_TOGETHER = {"type": "all_together", "description": {"wait_time": 0.0}}


def vector(value: Any) -> Vector3:
    """Three numbers, whatever holds them. Raises ScenarioError."""
    with _said(f"{value!r}: must be three numbers x, y, z"):
        x, y, z = (value[axis] for axis in "xyz") if isinstance(value, Mapping) else (value[axis] for axis in range(3))
        return (float(x), float(y), float(z))


def bounded(numbers: Vector3) -> Vector3:
    """A place, or angles. Raises ArgumentError for numbers that are none, or farther than anything here."""
    if not all(abs(component) <= FARTHEST for component in numbers):
        raise ArgumentError(f"{numbers}: must be three numbers from -{FARTHEST:g} to {FARTHEST:g}")
    return numbers


def dynamic_of(kind: str, description: Mapping[str, Any]) -> dynamics.Dynamic:
    """What moves an object, from its type and description. Raises ScenarioError."""
    with _said(f"dynamic of type {kind}"):
        given = {key: value for key, value in description.items() if value is not None}
        match kind:
            case "linear_waypoints" | "catmull_waypoints":
                loop = dynamics.LinearWaypoints if kind == "linear_waypoints" else dynamics.CatmullWaypoints
                waypoints = [_waypoint(each) for each in given["waypoints"]]
                return loop(waypoints * 2 if len(waypoints) == 1 else waypoints, float(given.get("total_time", 10.0)))
            case "uniform_movement_random_bounce":
                return dynamics.UniformMovementRandomBounce(
                    speed=float(given.get("speed", 5.0)),
                    angular_speed=float(given.get("angular_speed", 2.0)),
                    start_direction=mirrored(vector(given.get("start_direction", (0.0, 0.0, 1.0)))),
                    seed=int(given.get("seed", 42)),
                )
        raise ScenarioError("must be linear_waypoints, catmull_waypoints or uniform_movement_random_bounce")


def timings_of(content: Any, ids: Sequence[str], there: Collection[str]) -> dynamics.Timing:
    """When objects move. ids: of the scenario's objects; there: those that could be made. Raises ScenarioError."""
    with _said("timings"):
        content = content or ALL_TOGETHER
        description = content.get("description") or {}
        match content.get("type"):
            case "all_together":
                return dynamics.AllTogether(float(description.get("wait_time", 1.0)))
            case "wait_until_complete":
                return dynamics.WaitUntilComplete(float(description.get("wait_time", 0.0)))
            case "dict":
                turns = {_id(key, ids): float(seconds) for key, seconds in (description.get("times") or {}).items()}
                return dynamics.DictTimings([(id, seconds) for id, seconds in turns.items() if id in there])
        raise ScenarioError(f"type {content.get('type')!r}: must be all_together, wait_until_complete or dict")


def frustum_of(content: Any) -> native_objects.Frustum | None:
    """The walls of a view, None for none. Raises ScenarioError."""
    if not isinstance(content, Mapping):
        return native_objects.Frustum() if content else None
    if not content.get("spawn", True):
        return None
    with _said("frustum"):
        far = float(content.get("far_clip_plane", -1.0))
        return native_objects.Frustum(far if far > 0.0 else -1.0)


def object_of(content: Mapping[str, Any], id: str) -> native_objects.Object:
    """One object. id: its name, unique in the scenario. Raises ScenarioError."""
    with _said(f"object {id!r}"):
        dynamic = content.get("dynamic")
        return native_objects.Object(
            id,
            str(content.get("prefab")),
            mirrored(bounded(vector(content.get("position", (0.0, 0.0, 0.0))))),
            mirrored_euler(bounded(vector(content.get("rotation", (0.0, 0.0, 0.0))))),
            dynamic_of(str(dynamic.get("type")), dynamic.get("description") or {}) if dynamic else None,
            frustum_limited=bool(content.get("frustum_limited", True)),
        )


def object_ids(contents: Sequence[Mapping[str, Any]]) -> list[str]:
    """Names of a scenario's objects; one that was there already gets a number."""
    names: list[str] = []
    for row, content in enumerate(contents):
        wanted = str(content.get("id") or f"object_{row}")
        number, name = 1, wanted
        while name in names:
            number += 1
            name = f"{wanted} ({number})"
        names.append(name)
    return names


def _waypoint(content: Mapping[str, Any]) -> dynamics.Waypoint:
    position, rotation = vector(content.get("position", (0, 0, 0))), vector(content.get("rotation", (0, 0, 0)))
    return dynamics.Waypoint(mirrored(bounded(position)), mirrored_euler(bounded(rotation)))


def _id(key: Any, ids: Sequence[str]) -> str:
    """Of the object that a key of timings means, by its name or index, of which JSON has made a text; "" for none."""
    name = str(key)
    if name in ids:
        return name
    return ids[int(name)] if name.isdecimal() and int(name) < len(ids) else ""


@contextmanager
def _said(what: str) -> Iterator[None]:
    """Whatever goes wrong with values of the wrong kind, as a ScenarioError that says what they were for."""
    try:
        yield
    except (TypeError, ValueError, LookupError, AttributeError, OverflowError) as error:
        raise ScenarioError(f"{what}: {error}") from error
