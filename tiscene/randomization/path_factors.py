# SPDX-License-Identifier: Apache-2.0
"""Factors that draw the places of objects anew: "occlusion" and "rooms". Templates, sizes and speeds stay."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynamics import (
    CatmullWaypoints,
    Composite,
    Dynamic,
    LinearWaypoints,
    Still,
    UniformMovementRandomBounce,
    Waypoint,
)
from tiscene import catalog
from tiscene.errors import ScenarioError
from tiscene.randomization.clutter_factor import with_clutter
from tiscene.randomization.draws import Draws
from tiscene.randomization.free_space import FreeSpace
from tiscene.randomization.object_factors import is_distractor, is_kept
from tiscene.randomization.object_paths import loop_length
from tiscene.randomization.object_placer import ObjectPlacer, tally
from tiscene.randomization.point_pools import PointPools
from tiscene.randomization.ranges import ScenarioRanges, range_of, words_of
from tiscene.randomization.scene_files import free_space_of, stage_of
from tiscene.randomization.template_extent import template_extent
from tiscene.scenario.objects import Object
from tiscene.scenario.scenario import Scenario

Array = NDArray[np.float64]
Path = LinearWaypoints | CatmullWaypoints
TYPICAL_OCCLUSION = (0.1, 0.5)
LEAST_IN_VIEW = 0.5  # fraction of a path, of an object that is to be occluded


def with_occlusion(scenario: Scenario, value: Any, draws: Callable[[str], Draws]) -> Scenario:
    """Return a scenario whose objects take other paths, on which the scene hides them more or less.

    Args:
        scenario: the scenario.
        value: fraction of the path in view during which an object's center is hidden, or (low, high); None:
            (0.1, 0.5).
        draws: returns the random numbers of an object, by its id.

    Raises:
        ScenarioError: no such path is found, or an object's trajectory is of another kind.
    """
    occlusion = range_of(TYPICAL_OCCLUSION if value is None else value, "occlusion", 1.0)
    in_view = (LEAST_IN_VIEW, 1.0) if occlusion[1] > 0.0 else (1.0, 1.0)
    return _placed_anew(scenario, {"occlusion": occlusion, "in_view": in_view}, draws, "occlusion")


def with_room(scenario: Scenario, value: Any, draws: Callable[[str], Draws]) -> Scenario:
    """Return a scenario in another scene, with places of their own there for its objects.

    What belongs to the old scene is dropped: its camera, variants, lights in motion and overrides.

    Args:
        scenario: the scenario.
        value: name or file of a scene, or several to draw from; None: all shipped scenes but its own.
        draws: returns the random numbers of an object, by its id; "" for the scenario.

    Raises:
        SceneNotFound: there is no such scene.
        ScenarioError: the scenario was edited or moves prims of its scene, or its objects do not fit there.
    """
    if scenario.edits:
        raise ScenarioError(
            "rooms: the scenario has edits, whose places are of its own scene; draw from an unedited one"
        )
    if scenario.moved_prims:
        raise ScenarioError(f"rooms: the prim {scenario.moved_prims[0]!r} that the scenario moves is of its own scene")
    names = [name for name in catalog.scenes() if name != scenario.scene] if value is None else value
    names = words_of([names] if isinstance(names, str) else names, "rooms")
    name = names[draws("").whole("scene", 0, 0, len(names) - 1)]
    catalog.find_scene(name)
    moved = [each for each in scenario.objects if not is_distractor(each)]
    other = Scenario(
        name,
        moved,
        timings=scenario.timings,
        frustum=scenario.frustum,
        exposure_compensation=scenario.exposure_compensation,
    )
    other = _placed_anew(other, {}, draws, "rooms")
    distractors = [each for each in scenario.objects if is_distractor(each)]
    if distractors:
        templates = list(dict.fromkeys(each.template for each in distractors))
        scales = [float(np.max(each.scale)) for each in distractors]
        ranges = {"count": len(distractors), "templates": templates, "scale": (min(scales), max(scales))}
        other = with_clutter(other, ranges, draws)
    return other


def _placed_anew(scenario: Scenario, ranges: dict[str, Any], draws: Callable[[str], Draws], factor: str) -> Scenario:
    """Return a scenario whose objects have other places and paths; distractors stay."""
    space, up_axis = free_space_of(scenario), stage_of(scenario).up_axis
    objects: list[Object] = []
    starts: list[tuple[Array, float]] = []
    for each in scenario.objects:
        if is_kept(each):
            objects.append(each)
            continue
        placed, radius = _object_anew(each, ranges, draws(each.id), space, up_axis, starts, factor)
        objects.append(placed)
        starts.append((np.asarray(placed.position), radius))
    return replace(scenario, objects=objects)


def _object_anew(
    each: Object,
    ranges: dict[str, Any],
    own: Draws,
    space: FreeSpace,
    up_axis: str,
    starts: Sequence[tuple[Array, float]],
    factor: str,
) -> tuple[Object, float]:
    """Return an object at another place, and its radius, m."""
    path, spin = _parts(each, factor)
    count = len(path.waypoints) if path is not None else 2
    limits = ScenarioRanges(waypoints=(count, count), min_size=0.0, **ranges)
    extent = template_extent(each.template, up_axis)
    scale = float(np.max(each.scale))
    radius = extent.radius * scale
    placer = ObjectPlacer(space, limits, own, PointPools(space, limits, own), radius, extent.diameter * scale, starts)
    points = placer.position() if path is None else placer.loop(type(path))
    if points is None:
        where = f"{factor}: object {each.id!r} ({radius:.2f} m about its origin)"
        raise ScenarioError(f"{where} fits nowhere: {tally(placer.reasons)}")
    if path is None:
        x, y, z = points.tolist()
        return replace(each, position=(x, y, z)), radius
    rotations = [waypoint.rotation for waypoint in path.waypoints]
    waypoints = [Waypoint(tuple(place), turn) for place, turn in zip(points.tolist(), rotations, strict=True)]
    speed = loop_length(path) / path.total_time
    moved: Dynamic = replace(path, waypoints=waypoints, total_time=1.0)
    moved = replace(moved, total_time=loop_length(moved) / speed)  # type: ignore[type-var, arg-type]
    x, y, z = points[0].tolist()
    dynamic: Dynamic = Composite((moved, *spin)) if spin else moved  # type: ignore[arg-type]
    return replace(each, position=(x, y, z), dynamic=dynamic), radius


def _parts(each: Object, factor: str) -> tuple[Path | None, tuple[Dynamic, ...]]:
    """Return the loop of an object, and what turns it on its way; None for an object that stays or bounces."""
    dynamic = each.dynamic or Still()
    parts = tuple(dynamic.parts) if isinstance(dynamic, Composite) else (dynamic,)
    if isinstance(parts[0], Path):
        return parts[0], parts[1:]
    if isinstance(dynamic, Still | UniformMovementRandomBounce):
        return None, ()
    kind = type(parts[0]).__name__
    raise ScenarioError(f"{factor}: object {each.id!r} moves by {kind}; only waypoints and bounces are drawn anew")
