# SPDX-License-Identifier: Apache-2.0
"""Continuous collision detection of a moving body against walls and other movers: a Taichi function, one call per body.

Movers are tested against where the others were at the start of the substep: each of two may close a share of the gap
between them, in proportion to how far it can move. The tables are those of `dynamics.sweep_obstacles`.
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
    MAX_DISPLACEMENT,
    MOVE,
    POSITION,
    RADIUS,
    STEP_TIME,
    TIME_LEFT,
    TURN,
    WALL_PUSH,
    WALL_PUSHED,
)
from dynamics.contact import (
    FAR,
    MAX_TOUCHES,
    MOVER,
    NOTHING,
    SKIN,
    SLIDE_TOLERANCE,
    TOLERANCE,
    WAIT,
    WALL,
    record_touch,
)
from dynamics.kernel_types import Template
from dynamics.sweep_obstacles import ROUNDING_MARGIN, point_displacement, read3_f32, rotate_to_world, touch_band
from dynamics.tree_access import vec3, vector_at

WALLS = 6
CONTACT_GAP = 3.0 * SKIN  # m: movers nearer than this are in contact
DEEP_PENETRATION = 20.0 * SKIN  # m: deeper than any motion leads; such bodies were placed in each other


@ti.func
def group_gap(bounding: Template, frozen_groups: Template, group: ti.i32, other: ti.i32) -> ti.f32:
    """Return the gap, m, between the bounding spheres of two groups at the start of the substep."""
    away = vector_at(frozen_groups, group, 0) - vector_at(frozen_groups, other, 0)
    return away.norm() - bounding[group, 3] - bounding[other, 3]


@ti.func
def sweep_walls_and_movers(
    bodies: Template,
    integers: Template,
    groups: Template,
    spheres: Template,
    bounding: Template,
    frozen: Template,
    frozen_groups: Template,
    frozen_bodies: Template,
    neighbors: Template,
    planes: Template,
    touches: Template,
    gaps: Template,
    counts: Template,
    body: ti.i32,
    until: ti.f32,
):
    """Compute when, before `until`, the attempted motion of a body makes it touch a wall or another mover.

    Args:
        frozen: f32 [n, 3], centers of all spheres at the start of the substep, world, m.
        frozen_groups: f32 [g, 3], centers of all groups then.
        frozen_bodies: f32 [b, 3], origins of all bodies then.
        neighbors: i32 [b, b + 1], the number of movers that each body might touch in this substep, then their rows.
        planes: f32 [WALLS, 4], walls: inside where n . x + d >= 0.
        touches: Receives the touches of every group.
        gaps: Scratch, one per group.
        counts: Number of touches of every group, updated.
        body: Row of the body.
        until: Latest time (0..1) of interest.

    Returns:
        Time, `until` without a contact; normal; WALL, MOVER, WAIT or NOTHING; row of the wall or mover, -1 for none.
    """
    origin = read3_f32(bodies, body, POSITION)
    move = read3_f32(bodies, body, MOVE)
    turn = read3_f32(bodies, body, TURN)
    slack = 0.125 * ti.cast(bodies[body, RADIUS], ti.f32) * turn.dot(turn)
    band = touch_band(bodies, integers, body)
    best = until
    best_normal = vec3(0.0)
    best_kind = NOTHING
    best_row = -1
    first = integers[body, FIRST_GROUP]
    end = first + integers[body, GROUP_COUNT]
    if integers[body, LIMITED] > 0:
        # A body outside the walls may not move farther outwards by itself while it is pushed inwards.
        wall_push = vec3(0.0)
        if integers[body, KIND] == BOUNCES and integers[body, WALL_PUSHED] > 0:
            wall_push = read3_f32(bodies, body, WALL_PUSH) * ti.cast(
                bodies[body, STEP_TIME] / bodies[body, ACTIVE_TIME], ti.f32
            )
        must_enter = integers[body, KIND] != BOUNCES and integers[body, ATTEMPTS] == 0
        farthest = move.norm() + turn.norm() * ti.cast(bodies[body, RADIUS], ti.f32) + band
        for wall in range(WALLS):
            normal = vector_at(planes, wall, 0)
            height = normal.dot(origin) + planes[wall, 3] - SKIN
            if height < ti.cast(bodies[body, RADIUS], ti.f32) + farthest + ROUNDING_MARGIN:
                for group in range(first, end):
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
                                best_kind = WALL
                                best_row = wall
    bound = ti.cast(bodies[body, MAX_DISPLACEMENT], ti.f32)
    reach = move.norm() + turn.norm() * ti.cast(bodies[body, RADIUS], ti.f32)
    bouncing = integers[body, KIND] == BOUNCES
    touch_range = reach + band  # smaller gaps are recorded as touches
    moved = bound  # upper bound of the motion since the start of the substep
    if bouncing:
        touch_range = SKIN
        moved *= ti.cast(1.0 - bodies[body, TIME_LEFT] / bodies[body, ACTIVE_TIME], ti.f32)
    for i in range(neighbors[body, 0]):
        other = neighbors[body, 1 + i]
        other_bound = ti.cast(bodies[other, MAX_DISPLACEMENT], ti.f32)
        share = 0.5
        if bound + other_bound > 0.0:
            share = bound / (bound + other_bound)
        other_first = integers[other, FIRST_GROUP]
        other_end = other_first + integers[other, GROUP_COUNT]
        # Test the nearest pair of groups first: its result bounds the search of the others.
        nearest = FAR
        nearest_group = first
        nearest_other = other_first
        for group in range(first, end):
            away = vector_at(frozen_groups, group, 0) - vector_at(frozen_bodies, other, 0)
            least = away.norm() - bounding[group, 3] - ti.cast(bodies[other, RADIUS], ti.f32)
            if least < nearest:
                least = FAR
                for each in range(other_first, other_end):
                    gap = group_gap(bounding, frozen_groups, group, each)
                    least = ti.min(least, gap)
                    if gap < nearest:
                        nearest = gap
                        nearest_group = group
                        nearest_other = each
            gaps[group] = least
        # A body placed deep inside another, where spheres disagree on the way out, moves away from the other's origin.
        outward = vector_at(frozen_bodies, body, 0) - vector_at(frozen_bodies, other, 0)
        if outward.norm() < 1e-6:
            outward = vec3(0.0, ti.select(body > other, -1.0, 1.0), 0.0)
        outward = outward.normalized()
        deep = False
        if nearest < 0.0:
            for sphere in range(groups[nearest_group, 1], groups[nearest_group, 1] + groups[nearest_group, 2]):
                for b in range(groups[nearest_other, 1], groups[nearest_other, 1] + groups[nearest_other, 2]):
                    distance_between = (vector_at(frozen, sphere, 0) - vector_at(frozen, b, 0)).norm()
                    if distance_between - spheres[sphere, 3] - spheres[b, 3] < -DEEP_PENETRATION:
                        deep = True
        for step in range(1 + end - first):
            group = first + step - 1
            begin = other_first
            stop = other_end
            if step == 0:
                group = nearest_group
                begin = nearest_other
                stop = nearest_other + 1
            farthest = ti.max(best * reach, touch_range) + moved + band + ROUNDING_MARGIN
            if share * (gaps[group] - SKIN) >= farthest:
                stop = begin
            for each in range(begin, stop):
                gap_here = group_gap(bounding, frozen_groups, group, each)
                done = step > 0 and group == nearest_group and each == nearest_other
                farthest = ti.max(best * reach, touch_range) + moved + band + ROUNDING_MARGIN
                if share * (gap_here - SKIN) < farthest and not done:
                    for sphere in range(groups[group, 1], groups[group, 1] + groups[group, 2]):
                        here = vector_at(frozen, sphere, 0)
                        radius = spheres[sphere, 3]
                        from_group = (here - vector_at(frozen_groups, each, 0)).norm() - radius - bounding[each, 3]
                        if share * (from_group - SKIN) < farthest:
                            for b in range(groups[each, 1], groups[each, 1] + groups[each, 2]):
                                away = here - vector_at(frozen, b, 0)
                                distance = away.norm()
                                gap = distance - radius - spheres[b, 3]
                                if share * (gap - SKIN) < farthest:
                                    normal = away / ti.max(distance, 1e-9)
                                    arm = rotate_to_world(bodies, body, vector_at(spheres, sphere, 0))
                                    chord = point_displacement(turn, move, arm)
                                    if deep:
                                        normal = outward
                                        arm = vec3(0.0)
                                        chord = move
                                    # Each of the two may close its share of the gap at the start of the substep.
                                    closed = -normal.dot(origin + arm - here)
                                    left = share * (gap - SKIN)
                                    if gap > SKIN:
                                        left -= closed
                                    kind = WAIT
                                    if gap < CONTACT_GAP:
                                        kind = MOVER
                                    if left < touch_range:
                                        counts[group] = record_touch(
                                            touches, group * MAX_TOUCHES, counts[group], normal, arm, left, kind
                                        )
                                    approach = -normal.dot(chord)
                                    time = FAR
                                    if left < TOLERANCE:
                                        if approach > SLIDE_TOLERANCE:
                                            time = 0.0
                                        if gap < 0.5 * SKIN and approach > -4.0 * slack - 1e-9:
                                            time = 0.0
                                    elif approach > 0.0:
                                        time = (left - 0.5 * TOLERANCE) / approach
                                    if time < best:
                                        best = time
                                        best_normal = normal
                                        best_kind = kind
                                        best_row = other
    return best, best_normal, best_kind, best_row
