# SPDX-License-Identifier: Apache-2.0
"""Paths of a scenario's objects: the length of loops, and balls that drawn furniture and clutter keep clear of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynamics import Body, CatmullWaypoints, LinearWaypoints, RigidBody, Simulation, Still
from dynamics.dynamic import Pose
from dynamics.rotation import quaternion, rotate
from tiscene.randomization.scene_collisions import template_edges
from tiscene.randomization.scene_files import templates_of
from tiscene.randomization.template_extent import enclosing_radius
from tiscene.scenario.objects import Object
from tiscene.scenario.scenario import Scenario

Array = NDArray[np.float64]
SAMPLES = 512  # per path


def swept_balls(scenario: Scenario) -> Array:
    """Return balls [n, 4], center and radius in m, that enclose the objects of a scenario along their paths.

    A bouncing object counts at its start: where it goes depends on what it meets.
    """
    balls, templates = [np.zeros((0, 4))], templates_of(scenario)
    for each in scenario.objects:
        radius = enclosing_radius(templates[each.template], each.scale)
        points = path_of(each)
        gaps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        balls.append(np.column_stack([points, np.full(len(points), radius + 0.5 * gaps.max(initial=0.0))]))
    return np.concatenate(balls)


def resting_edges(scenario: Scenario) -> Array:
    """Return the edges of the objects that stand still or fall, at their start, float64 [n, 2, 3], m."""
    edges, templates = [np.zeros((0, 2, 3))], templates_of(scenario)
    for each in scenario.objects:
        if isinstance(each.dynamic, RigidBody | Still | None):
            own = template_edges(templates[each.template]) * each.scale
            edges.append(rotate(quaternion(each.rotation), own) + each.position)
    return np.concatenate(edges)


def path_of(each: Object) -> Array:
    """Return points [n, 3] of an object's path at equal times, m; its start for one that has no closed form."""
    body = Body(each.dynamic or Still(), each.position, each.rotation)
    if not body.duration:
        return np.array([each.position], np.float64)
    return Simulation([body]).poses_at([body.duration * k / SAMPLES for k in range(SAMPLES)])[:, 0, :3]


def loop_length(path: LinearWaypoints | CatmullWaypoints) -> float:
    """Return the length of a loop, m."""
    (track,) = replace(path, pacing="arc_length", rotation="quaternion").tracks(Pose())
    assert track.lengths is not None  # of pacing="arc_length"
    return float(track.lengths[-1, -1])


def clear_of(balls: Array, low: Array, high: Array) -> bool:
    """Return whether no ball [n, 4] touches the axis-aligned box between two corners."""
    nearest = np.clip(balls[:, :3], low, high)
    distances = np.linalg.norm(balls[:, :3] - nearest, axis=1)
    return bool((distances > balls[:, 3]).all())
