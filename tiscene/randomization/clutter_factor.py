# SPDX-License-Identifier: Apache-2.0
"""The factor "clutter": distractors, which rest on surfaces in view and keep clear of the objects' paths.

Distractors are objects of the scenario whose ids begin with "distractor_". They collide with nothing, so that they
change no other object's motion.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynamics.argument_checks import is_number
from tiscene import catalog
from tiscene.errors import ScenarioError, counted
from tiscene.randomization.draws import Draws
from tiscene.randomization.factor_ranges import ClutterRanges
from tiscene.randomization.free_space import FreeSpace
from tiscene.randomization.object_factors import DISTRACTOR, category_of, is_distractor
from tiscene.randomization.object_paths import clear_of, swept_balls
from tiscene.randomization.scene_collisions import about, box_of, template_edges, transformed
from tiscene.randomization.scene_files import collisions_of, free_space_of, stage_of, template_of
from tiscene.randomization.template_extent import template_extent
from tiscene.scenario.objects import Object
from tiscene.scenario.scenario import Scenario
from tiscene.scene.description import SceneDescription
from tiscene.world.overridden_stage import overridden

Array = NDArray[np.float64]
CANDIDATES = 2048  # points that are drawn for one template
PLACES = 96  # places below such points, at which it is tested
MAX_TEMPLATES = 12  # that are tried for one distractor
LEAST_SUPPORT = 0.5
DECIMALS = 4


def with_clutter(scenario: Scenario, value: Any, draws: Callable[[str], Draws]) -> Scenario:
    """Return a scenario with other distractors; those that it has are removed first.

    Args:
        scenario: the scenario.
        value: ranges; a number of distractors, which is rounded, or (low, high); None: typical ranges.
        draws: returns the random numbers of a distractor, by its id; "" for the scenario.

    Raises:
        ScenarioError: a distractor fits nowhere in view.
    """
    if is_number(value):
        value = {"count": round(value)}  # a drift may ramp it
    elif isinstance(value, Sequence) and not isinstance(value, str):
        value = {"count": value}
    ranges = ClutterRanges.of(value, "clutter")
    objects = [each for each in scenario.objects if not is_distractor(each)]
    bare = replace(scenario, objects=objects)
    count = draws("").whole("count", 0, *ranges.count)
    if not count:
        return bare
    names = list(ranges.templates or ())
    if not names:
        taken = {category_of(each.template) for each in objects if not catalog.is_prim_path(each.template)}
        names = [name for name, entry in catalog.templates().items() if entry.category not in taken]
    for name in names:
        catalog.find_template(name)
    placer = _DistractorPlacer(bare, ranges)
    for number in range(count):
        id = f"{DISTRACTOR}{number}"
        objects.append(placer.place(id, names, draws(id)))
    return replace(scenario, objects=objects)


class _DistractorPlacer:
    """Finds places for the distractors of one scenario."""

    def __init__(self, scenario: Scenario, ranges: ClutterRanges) -> None:
        stage = overridden(stage_of(scenario), scenario.overrides)
        self.ranges = ranges
        self.up_axis = stage.up_axis
        self.space: FreeSpace = free_space_of(scenario)
        self.balls = swept_balls(scenario)
        self.collisions = collisions_of(scenario)
        self.collisions.select()
        self.is_empty = not stage.instances
        self.boxes: list[tuple[Array, Array]] = []

    def place(self, id: str, names: Sequence[str], own: Draws) -> Object:
        """Return a distractor; raises ScenarioError where no template fits."""
        order = np.argsort(own.uniform("template", 0, len(names)), kind="stable")
        scale = round(own.between("scale", 0, *self.ranges.scale), DECIMALS)
        tried = 0
        for name in (names[row] for row in order.tolist()):
            if tried == MAX_TEMPLATES or not self._is_of_size(name, scale):
                continue
            tried += 1
            found = self._pose(template_of(name, self.up_axis), scale, own)
            if found is not None:
                (x, y, z), yaw = found
                rotation = (0.0, yaw, 0.0) if self.up_axis == "Y" else (0.0, 0.0, yaw)
                return Object(id, name, (x, y, z), rotation, frustum_limited=False, collide=False, scale=scale)
        raise ScenarioError(
            f"clutter: {id!r} rests nowhere in view, in up to {PLACES} places for each of "
            f"{counted(tried, 'template')}: lower count or scale, widen depth, or draw from smaller templates"
        )

    def _is_of_size(self, name: str, scale: float) -> bool:
        """Return whether a template is of the size that is drawn from the catalog; any is that the user names."""
        if self.ranges.templates is not None:
            return True
        low, high = self.ranges.size
        return low <= template_extent(name, self.up_axis).diameter * scale <= high

    def _pose(
        self, template: SceneDescription, scale: float, own: Draws
    ) -> tuple[tuple[float, float, float], float] | None:
        """Return the position of a template at rest, and its turn about the vertical in degrees; None if none fits."""
        edges = template_edges(template)
        up = self.collisions.up
        heights = edges * scale @ up
        lowest, height = float(heights.min()), float(np.ptp(heights))
        numbers = own.uniform("place", 0, 3 * CANDIDATES).reshape(-1, 3)
        near, far = self.ranges.depth
        points = self.space.points(numbers[:, 0], numbers[:, 1], np.cbrt(near**3 + numbers[:, 2] * (far**3 - near**3)))
        allowed = self.space.in_view(points) & ~self.space.hidden(points)
        rows = np.flatnonzero(allowed)
        below = np.zeros(len(points))
        if not self.is_empty:
            below[rows] = self.collisions.drop(points[rows], 2.0 * far)
            rows = rows[np.isfinite(below[rows])]
            resting = points[rows] - (below[rows] - 0.5 * height)[:, None] * up
            rows = rows[self.space.in_view(resting) & ~self.space.hidden(resting)]
        for row in rows[:PLACES].tolist():
            place = np.round(points[row] - (below[row] + lowest * (not self.is_empty)) * up, DECIMALS)
            yaw = round(own.between("yaw", row, -180.0, 180.0), DECIMALS)
            there = transformed(edges * scale, about(np.zeros(3), up, math.radians(yaw), place))
            low, high = box_of(there)
            if self._fits(there, low, high):
                self.boxes.append((low, high))
                x, y, z = place.tolist()
                return (x, y, z), yaw
        return None

    def _fits(self, edges: Array, low: Array, high: Array) -> bool:
        """Return whether an object is visible, rests on something, and is clear of all others."""
        center = 0.5 * (low + high)[None]
        if not self.space.in_view(center)[0] or self.space.hidden(center)[0]:
            return False
        if any((low < most).all() and (high > least).all() for least, most in self.boxes):
            return False
        if not clear_of(self.balls, low, high):
            return False
        if self.is_empty:
            return True
        return self.collisions.support(edges) >= LEAST_SUPPORT and not self.collisions.penetrates(edges)
