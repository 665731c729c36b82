# SPDX-License-Identifier: Apache-2.0
"""Draw random scenarios from ranges, for `Scenario.sample`.

An object is drawn as a kind of trajectory, a scale, a template and a place. A template that fits nowhere within the
ranges is replaced by another one.
"""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynamics import (
    AllTogether,
    CatmullWaypoints,
    Composite,
    Dynamic,
    LinearWaypoints,
    Orbit,
    Still,
    UniformMovementRandomBounce,
    Waypoint,
)
from dynamics.argument_checks import integer
from tiscene import catalog
from tiscene.device import runtime
from tiscene.errors import ScenarioError, counted
from tiscene.randomization.draws import Draws
from tiscene.randomization.free_space import FreeSpace
from tiscene.randomization.object_paths import loop_length
from tiscene.randomization.object_placer import ATTEMPTS, LoopClass, ObjectPlacer, tally
from tiscene.randomization.point_pools import DECIMALS, PointPools
from tiscene.randomization.ranges import ScenarioRanges
from tiscene.randomization.scene_files import free_space_of, stage_of
from tiscene.randomization.template_extent import template_extent
from tiscene.scenario.objects import Frustum, Object
from tiscene.scenario.scenario import Scenario
from tiscene.scene.camera import Camera, Vector3

Array = NDArray[np.float64]
MAX_TEMPLATES = 32  # templates that are tried for one object
SCENARIO = 2**64 - 1  # number of the draws that belong to no object


@runtime.one_thread_at_a_time
def sample(
    scene: str | os.PathLike[str],
    *,
    seed: int = 0,
    camera: Camera | str | None = None,
    variants: Mapping[str, str] | None = None,
    **ranges: Any,
) -> Scenario:
    """Draw a scenario.

    Args:
        scene: name or file of the scene.
        seed: 0 to 2^64 - 1.
        camera: the scenario's camera; its pose at the start counts.
        variants: variant selections of the scene.
        **ranges: fields of `ScenarioRanges`.

    Raises:
        ArgumentError: the ranges contradict themselves.
        ScenarioError: nothing in the scene fits the ranges.
    """
    seed = integer(seed, "seed", 0, 2**64 - 1)
    limits = ScenarioRanges(**ranges)
    names = sorted(catalog.templates()) if limits.templates is None else limits.templates
    for name in limits.templates or ():
        catalog.find_template(name)
    bare = Scenario(os.fspath(scene), camera=camera, variants=variants or {})
    space, up_axis = free_space_of(bare, aspect=limits.aspect), stage_of(bare).up_axis
    count = Draws(seed, SCENARIO).whole("objects", 0, *limits.objects)
    objects: list[Object] = []
    starts: list[tuple[Array, float]] = []
    for number in range(count):
        made, radius = _ObjectSampler(limits, space, up_axis, Draws(seed, number), number).draw(names, starts)
        objects.append(made)
        starts.append((np.array(made.position), radius))
    # Bouncing objects that must stay in view need walls.
    walled = limits.in_view[0] == 1.0 and "bounce" in limits.dynamics
    frustum = Frustum(limits.depth[1]) if walled else None
    return replace(bare, objects=objects, timings=AllTogether(limits.wait_time), frustum=frustum)


class _ObjectSampler:
    """Draws one object."""

    def __init__(self, limits: ScenarioRanges, space: FreeSpace, up_axis: str, draws: Draws, number: int) -> None:
        self.limits = limits
        self.space = space
        self.up_axis = up_axis
        self.draws = draws
        self.number = number
        self.kind = limits.dynamics[draws.whole("dynamics", 0, 0, len(limits.dynamics) - 1)]
        self.scale = round(draws.between("scale", 0, *limits.scale), DECIMALS)
        self.pools = PointPools(space, limits, draws)

    def draw(self, names: Sequence[str], starts: Sequence[tuple[Array, float]]) -> tuple[Object, float]:
        """Draw the object.

        Args:
            names: templates to choose from.
            starts: center and radius of each object drawn before, at its start.

        Returns:
            The object, and its radius, m.

        Raises:
            ScenarioError: none of the templates that were tried fits.
        """
        order = np.argsort(self.draws.uniform("template", 0, len(names)), kind="stable")
        tried = [names[row] for row in order[:MAX_TEMPLATES].tolist()]
        reasons: Counter[str] = Counter()
        radii = []
        for name in tried:
            extent = template_extent(name, self.up_axis)
            radius, diameter = extent.radius * self.scale, extent.diameter * self.scale
            placer = ObjectPlacer(self.space, self.limits, self.draws, self.pools, radius, diameter, starts)
            placed = self._placed(placer)
            if placed is not None:
                return self._object(name, *placed), radius
            reasons += placer.reasons
            radii.append(radius)
        if len(tried) == 1:
            what, draws = f"object {self._id(tried[0])!r} ({self.kind}, {radii[0]:.2f} m about its origin)", ""
        else:
            sizes = f"{min(radii):.2f} to {max(radii):.2f} m about their origins"
            what = f"object {self.number} ({self.kind})"
            draws = f" of each of {counted(len(tried), 'template')} ({sizes})"
        raise ScenarioError(
            f"{what} fits nowhere in up to {ATTEMPTS} draws{draws}: {tally(reasons)}. "
            "Widen depth, region, in_view or occlusion, lower min_size, or draw from smaller templates"
        )

    def _placed(self, placer: ObjectPlacer) -> tuple[Vector3, Dynamic] | None:
        """Return the object's start and its trajectory; None if it fits nowhere."""
        if self.kind in ("still", "bounce"):
            start = placer.position()
            dynamic: Dynamic = self._bounce() if self.kind == "bounce" else Still()
        else:
            cls = LinearWaypoints if self.kind == "linear" else CatmullWaypoints
            points = placer.loop(cls)
            if points is None:
                return None
            start, dynamic = points[0], self._loop(cls, points)
        if start is None:
            return None
        x, y, z = start.tolist()
        return (x, y, z), dynamic

    def _bounce(self) -> UniformMovementRandomBounce:
        """Return a bouncing trajectory."""
        return UniformMovementRandomBounce(
            speed=self._speed(),
            angular_speed=self._spin(),
            start_direction=self._direction("heading"),
            seed=int(self.draws.uniform("bounces", 0)[0] * 2**31),
        )

    def _loop(self, cls: LoopClass, points: Array) -> Dynamic:
        """Return a closed path through waypoints [n, 3]."""
        loop = cls([Waypoint(tuple(place), self._rotation()) for place in points.tolist()], pacing="arc_length")
        loop = replace(loop, total_time=loop_length(loop) / self._speed())
        spin = self._spin()
        if spin == 0.0:
            return loop
        return Composite((loop, Orbit(period=2.0 * math.pi / spin, axis=self._direction("axis"))))

    def _speed(self) -> float:
        return self.draws.between("speed", 0, *self.limits.speed)

    def _spin(self) -> float:
        return self.draws.between("spin", 0, *self.limits.angular_speed)

    def _direction(self, purpose: str) -> Vector3:
        x, y, z = (round(each, DECIMALS) for each in self.draws.direction(purpose, 0))
        return (x, y, z)

    def _rotation(self) -> tuple[float, float, float]:
        """Return a random rotation about the vertical."""
        yaw = round(self.draws.between("yaw", 0, -180.0, 180.0), DECIMALS)
        return (0.0, yaw, 0.0) if self.up_axis == "Y" else (0.0, 0.0, yaw)

    def _id(self, template: str) -> str:
        """Return the object's id: the template's name and the object's number."""
        name = Path(template).stem if Path(template).suffix else template
        return f"{name.lower().replace(' ', '_')}_{self.number}"

    def _object(self, template: str, start: Vector3, dynamic: Dynamic) -> Object:
        """Return the object of a template at its start."""
        first, last = 0, None
        if self.limits.life is not None and self.limits.frames is not None:
            length = self.draws.whole("life", 0, *self.limits.life)
            first = self.draws.whole("first", 0, 0, self.limits.frames - length)
            last = first + length - 1
        return Object(
            self._id(template),
            template,
            start,
            self._rotation(),
            dynamic,
            first,
            last,
            frustum_limited=self.limits.in_view[0] == 1.0,
            scale=self.scale,
        )
