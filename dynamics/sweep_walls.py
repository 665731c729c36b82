# SPDX-License-Identifier: Apache-2.0
"""Continuous collision detection of a moving body against walls: a Taichi function, one call per body.

Walls are half-spaces that a limited body may not leave. The tables are those of `dynamics.sweep_obstacles`.
"""

import taichi as ti

from dynamics.body_layout import (
    ACTIVE_TIME,
    ATTEMPTS,
    BOUNCES,
    FIRST_GROUP,
    GROUP_COUNT,
    KIND,
    LIMITED,
    MOVE,
    POSITION,
    RADIUS,
    STEP_TIME,
    TURN,
    WALL_PUSH,
    WALL_PUSHED,
)
from dynamics.contact import FAR, MAX_TOUCHES, SKIN, SLIDE_TOLERANCE, TOLERANCE, WALL, record_touch
from dynamics.kernel_types import Template
from dynamics.sweep_obstacles import ROUNDING_MARGIN, point_displacement, read3_f32, rotate_to_world, touch_band
from dynamics.tree_access import vec3, vector_at

WALLS = 6


@ti.func
def sweep_walls(
    bodies: Template,
    integers: Template,
    groups: Template,
    spheres: Template,
    planes: Template,
    touches: Template,
    counts: Template,
    body: ti.i32,
    until: ti.f32,
):
    """Compute when, before `until`, the attempted motion of a body makes it touch a wall.

    Args:
        planes: f32 [WALLS, 4], walls: inside where n . x + d >= 0.
        touches: Receives the touches of every group.
        counts: Number of touches of every group, updated.
        body: Row of the body.
        until: Latest time (0..1) of interest.

    Returns:
        Time, `until` without a contact; normal; row of the wall, -1 for none.
    """
    best = until
    best_normal = vec3(0.0)
    best_wall = -1
    if integers[body, LIMITED] > 0:
        origin = read3_f32(bodies, body, POSITION)
        move = read3_f32(bodies, body, MOVE)
        turn = read3_f32(bodies, body, TURN)
        radius = ti.cast(bodies[body, RADIUS], ti.f32)
        # A body outside the walls may not move farther outwards by itself while it is pushed inwards.
        wall_push = vec3(0.0)
        if integers[body, KIND] == BOUNCES and integers[body, WALL_PUSHED] > 0:
            part = ti.cast(bodies[body, STEP_TIME] / bodies[body, ACTIVE_TIME], ti.f32)
            wall_push = read3_f32(bodies, body, WALL_PUSH) * part
        must_enter = integers[body, KIND] != BOUNCES and integers[body, ATTEMPTS] == 0
        farthest = move.norm() + turn.norm() * radius + touch_band(bodies, integers, body)
        first = integers[body, FIRST_GROUP]
        for wall in range(WALLS):
            normal = vector_at(planes, wall, 0)
            height = normal.dot(origin) + planes[wall, 3] - SKIN
            if height < radius + farthest + ROUNDING_MARGIN:
                for group in range(first, first + integers[body, GROUP_COUNT]):
                    for sphere in range(groups[group, 1], groups[group, 1] + groups[group, 2]):
                        arm = rotate_to_world(bodies, body, vector_at(spheres, sphere, 0))
                        gap = height + normal.dot(arm) - spheres[sphere, 3]
                        if gap < farthest:
                            chord = point_displacement(turn, move, arm)
                            counts[group] = record_touch(
                                touches, group * MAX_TOUCHES, counts[group], normal, arm, gap, WALL
                            )
                            approach = -normal.dot(chord)
                            time = FAR
                            if approach > SLIDE_TOLERANCE:
                                time = ti.max(gap - 0.5 * TOLERANCE, 0.0) / approach
                                if gap < TOLERANCE:
                                    time = 0.0
                            if gap < -TOLERANCE and (must_enter or normal.dot(wall_push - chord) > SLIDE_TOLERANCE):
                                time = 0.0
                            if time < best:
                                best = time
                                best_normal = normal
                                best_wall = wall
    return best, best_normal, best_wall
