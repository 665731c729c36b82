# SPDX-License-Identifier: Apache-2.0
"""Continuous collision detection of a moving body against other movers: a Taichi function, one call per body.

Movers are tested against where the others were at the start of the substep: each of two may close a share of the gap
between them, in proportion to how far it can move. The tables are those of `dynamics.sweep_obstacles`. In addition:

- `frozen`, f32 [n, 3]: centers of all spheres at the start of the substep, world, m;
- `frozen_groups`, f32 [g, 3], and `frozen_bodies`, f32 [b, 3]: centers of all groups and origins of all bodies then.
"""

import taichi as ti

from dynamics.body_layout import (
    ACTIVE_TIME,
    BOUNCES,
    FIRST_GROUP,
    GROUP_COUNT,
    KIND,
    MAX_DISPLACEMENT,
    MOVE,
    POSITION,
    RADIUS,
    TIME_LEFT,
    TURN,
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
    record_touch,
)
from dynamics.kernel_types import Template
from dynamics.sweep_obstacles import ROUNDING_MARGIN, point_displacement, read3_f32, rotate_to_world, touch_band
from dynamics.tree_access import vec3, vector_at

CONTACT_GAP = 3.0 * SKIN  # m: movers nearer than this are in contact
DEEP_PENETRATION = 20.0 * SKIN  # m: deeper than any motion leads; such bodies were placed in each other


@ti.func
def group_gap(bounding: Template, frozen_groups: Template, group: ti.i32, other: ti.i32) -> ti.f32:
    """Return the gap, m, between the bounding spheres of two groups at the start of the substep."""
    away = vector_at(frozen_groups, group, 0) - vector_at(frozen_groups, other, 0)
    return away.norm() - bounding[group, 3] - bounding[other, 3]


@ti.func
def nearest_groups(
    bodies: Template, integers: Template, bounding: Template, frozen_groups: Template, frozen_bodies: Template,
    gaps: Template, body: ti.i32, other: ti.i32,
):  # fmt: skip
    """Find the nearest pair of groups of two bodies.

    Args:
        gaps: Receives a lower bound of the gap between each group of `body` and those of `other`, m.

    Returns:
        Their gap, m, the group of `body` and that of `other`.
    """
    first, other_first = integers[body, FIRST_GROUP], integers[other, FIRST_GROUP]
    nearest, nearest_group, nearest_other = FAR, first, other_first
    for group in range(first, first + integers[body, GROUP_COUNT]):
        away = vector_at(frozen_groups, group, 0) - vector_at(frozen_bodies, other, 0)
        least = away.norm() - bounding[group, 3] - ti.cast(bodies[other, RADIUS], ti.f32)
        if least < nearest:
            least = FAR
            for each in range(other_first, other_first + integers[other, GROUP_COUNT]):
                gap = group_gap(bounding, frozen_groups, group, each)
                least = ti.min(least, gap)
                if gap < nearest:
                    nearest, nearest_group, nearest_other = gap, group, each
        gaps[group] = least
    return nearest, nearest_group, nearest_other


@ti.func
def penetrate_deeply(groups: Template, spheres: Template, frozen: Template, group: ti.i32, other: ti.i32):
    """Return whether spheres of two groups are deeper in each other than any motion leads."""
    deep = False
    for a in range(groups[group, 1], groups[group, 1] + groups[group, 2]):
        for b in range(groups[other, 1], groups[other, 1] + groups[other, 2]):
            distance = (vector_at(frozen, a, 0) - vector_at(frozen, b, 0)).norm()
            if distance - spheres[a, 3] - spheres[b, 3] < -DEEP_PENETRATION:
                deep = True
    return deep


@ti.func
def time_of_contact(gap: ti.f32, left: ti.f32, approach: ti.f32, slack: ti.f32) -> ti.f32:
    """Return when (0..1) a sphere has closed what is left of its share of a gap, FAR for never.

    Args:
        gap: At the start of the substep, m.
        left: Of the body's share of it, m.
        approach: Of the attempted motion, m.
        slack: Largest distance between the true path of the sphere's center and its chord, m.
    """
    time = FAR
    if left < TOLERANCE:
        if approach > SLIDE_TOLERANCE:
            time = 0.0
        if gap < 0.5 * SKIN and approach > -4.0 * slack - 1e-9:
            time = 0.0
    elif approach > 0.0:
        time = (left - 0.5 * TOLERANCE) / approach
    return time


@ti.func
def sweep_movers(
    bodies: Template,
    integers: Template,
    groups: Template,
    spheres: Template,
    bounding: Template,
    frozen: Template,
    frozen_groups: Template,
    frozen_bodies: Template,
    neighbors: Template,
    touches: Template,
    gaps: Template,
    counts: Template,
    body: ti.i32,
    until: ti.f32,
):
    """Compute when, before `until`, the attempted motion of a body makes it touch another mover.

    Args:
        neighbors: i32 [b, b + 1], the number of movers that each body might touch in this substep, then their rows.
        touches: Receives the touches of every group.
        gaps: Scratch, one per group.
        counts: Number of touches of every group, updated.
        body: Row of the body.
        until: Latest time (0..1) of interest.

    Returns:
        Time, `until` without a contact; normal; MOVER, WAIT or NOTHING; row of the mover, -1 for none.
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
    bound = ti.cast(bodies[body, MAX_DISPLACEMENT], ti.f32)
    reach = move.norm() + turn.norm() * ti.cast(bodies[body, RADIUS], ti.f32)
    touch_range = reach + band  # smaller gaps are recorded as touches
    moved = bound  # upper bound of the motion since the start of the substep
    if integers[body, KIND] == BOUNCES:
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
        nearest, nearest_group, nearest_other = nearest_groups(
            bodies, integers, bounding, frozen_groups, frozen_bodies, gaps, body, other
        )
        # A body placed deep inside another, where spheres disagree on the way out, moves away from the other's origin.
        outward = vector_at(frozen_bodies, body, 0) - vector_at(frozen_bodies, other, 0)
        if outward.norm() < 1e-6:
            outward = vec3(0.0, ti.select(body > other, -1.0, 1.0), 0.0)
        outward = outward.normalized()
        deep = False
        if nearest < 0.0:
            deep = penetrate_deeply(groups, spheres, frozen, nearest_group, nearest_other)
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
                                    kind = ti.select(gap < CONTACT_GAP, MOVER, WAIT)
                                    if left < touch_range:
                                        counts[group] = record_touch(
                                            touches, group * MAX_TOUCHES, counts[group], normal, arm, left, kind
                                        )
                                    time = time_of_contact(gap, left, -normal.dot(chord), slack)
                                    if time < best:
                                        best = time
                                        best_normal = normal
                                        best_kind = kind
                                        best_row = other
    return best, best_normal, best_kind, best_row
