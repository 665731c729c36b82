# SPDX-License-Identifier: Apache-2.0
"""The factor "furniture": movable objects of the scene elsewhere on their support, and in other variants.

An object is moved if its author made it movable (UsdPhysics rigid bodies), it stands on something, nothing of the scene
or of the scenario rests on it, and its new place neither penetrates the scene nor crosses the path of an object of the
scenario. An object for which no such place is drawn stays.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynamics.argument_checks import is_number
from tiscene.randomization.draws import Draws
from tiscene.randomization.factor_ranges import FurnitureRanges
from tiscene.randomization.object_paths import clear_of, resting_edges, swept_balls
from tiscene.randomization.scene_collisions import SceneCollisions, about, box_of, horizontal, transformed
from tiscene.randomization.scene_files import stage_of, variant_sets_of
from tiscene.scenario.overrides import ObjectOverride, Override
from tiscene.scenario.scenario import Scenario
from tiscene.scene.animation import quaternions
from tiscene.scene.assembly import object_matrices, rigid
from tiscene.scene.description import SceneDescription

Array = NDArray[np.float64]
ATTEMPTS = 24
LEAST_SUPPORT = 0.3  # fraction of an object's lowest points, of an object that stands
KEPT_SUPPORT = 0.9  # fraction of its support that it must keep
SCENE_WIDE = ("lighting", "appearance")  # variant sets that are not of one object
DECIMALS = 4


def with_furniture(scenario: Scenario, value: Any, draws: Callable[[str], Draws]) -> Scenario:
    """Return a scenario with its furniture elsewhere, and in other variants. Overrides of objects are replaced.

    Args:
        scenario: the scenario.
        value: ranges; a number, how far objects are moved, m; None: typical ranges.
        draws: returns the random numbers of an object, by its prim's path.
    """
    if is_number(value):
        value = {"shift": value}
    ranges = FurnitureRanges.of(value, "furniture")
    if ranges.variants[1] > 0.0:
        scenario = _with_variants(scenario, ranges, draws)
    overrides: list[Override] = [each for each in scenario.overrides if not isinstance(each, ObjectOverride)]
    if ranges.shift[1] > 0.0 or ranges.turn[1] > 0.0:
        stage = stage_of(scenario)
        balls = swept_balls(scenario)
        resting = resting_edges(scenario)
        collisions = SceneCollisions(stage)
        animated = {stage.instances[row].object for track in stage.tracks for row in track.instances.tolist()}
        for number, each in enumerate(stage.objects):
            if each.movable and number not in animated:
                by = _moved(collisions, number, ranges, draws(each.prim_path), balls, resting)
                if by is not None:
                    collisions.move(number, by)
                    overrides.append(_override(stage, number, by))
    return replace(scenario, overrides=overrides)


def _with_variants(scenario: Scenario, ranges: FurnitureRanges, draws: Callable[[str], Draws]) -> Scenario:
    """Return a scenario with other variants of the scene's objects."""
    variants = dict(scenario.variants)
    for key, (_, names) in variant_sets_of(scenario).items():
        prim, _, variant_set = key.removesuffix("}").partition("{")
        own = draws(prim)
        chance = own.between("variant", 0, *ranges.variants)
        if variant_set in SCENE_WIDE or prim.count("/") < 2 or own.uniform("redraw", 0)[0] >= chance:
            continue
        variants[key] = names[own.whole(variant_set, 0, 0, len(names) - 1)]
    return replace(scenario, variants=variants)


def _moved(
    collisions: SceneCollisions, number: int, ranges: FurnitureRanges, own: Draws, balls: Array, resting: Array
) -> Array | None:
    """Return the 4x4 matrix to an object's new place, apart from balls [n, 4]; None if it stays.

    It stays if it carries something of the scene, or of the edges `resting`.
    """
    edges = collisions.edges_of(number)
    if not len(edges):
        return None
    collisions.select(number)
    before = collisions.support(edges)
    if before < LEAST_SUPPORT or collisions.carries(resting) or collisions.penetrates(edges, np.eye(4)):
        return None
    low, high = box_of(edges)
    center = 0.5 * (low + high)
    for attempt in range(ATTEMPTS):
        part = 1.0 - attempt / ATTEMPTS  # nearer places are freer
        least, most = ranges.shift
        distance = own.between("shift", attempt, least, least + (most - least) * part)
        direction = own.between("to", attempt, 0.0, 2.0 * math.pi)
        angle = math.radians(own.either_side("turn", ranges.turn, attempt))
        by = about(center, collisions.up, angle, distance * horizontal(collisions.up, direction))
        there = transformed(edges, by)
        if not clear_of(balls, *box_of(there)):
            continue
        if collisions.support(there) >= KEPT_SUPPORT * before and not collisions.penetrates(there, by):
            return by
    return None


def _override(stage: SceneDescription, number: int, by: Array) -> ObjectOverride:
    """Return the override that places an object by a rigid matrix."""
    pose = np.einsum("ij,jk->ik", by, rigid(object_matrices(stage)[number]))
    x, y, z = (round(each, DECIMALS) for each in pose[:3, 3].tolist())
    rotation = tuple(round(each, 6) for each in quaternions(pose[None, :3, :3])[0].tolist())
    return ObjectOverride(stage.objects[number].prim_path, (x, y, z), rotation)
