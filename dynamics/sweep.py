"""When do moving bodies meet anything? The kernels that look: one thread for each group of proxy spheres.

A group is a row of `groups`, i32 [g, 3]: its body, first sphere, number of spheres; `bounding`, f32 [g, 4], has the
sphere around it. `spheres`, f32 [n, 4], are centre and radius in the body's own axes.
(No postponed annotations in this module.)
"""

import taichi as ti

from dynamics.columns import (
    ACTIVE,
    BOUNCES,
    BOUND,
    CENTRE,
    COLLIDES,
    FIRST_GROUP,
    GROUPS,
    KIND,
    LIMITED,
    MOVE,
    POSITION,
    PULL,
    PULLED,
    RADIUS,
    ROTATION,
    SIGHT,
    STEP,
    TRAVEL,
    TRIES,
    TURN,
)
from dynamics.contact import (
    FAR,
    MOVER,
    NOTHING,
    OBSTACLE,
    SKIN,
    SLIDE,
    TOLERANCE,
    TOUCHES,
    WAIT,
    WALL,
    Column,
    Floats,
    Ints,
    look_around,
    record,
    vec3,
    vector_at,
)

Bodies = ti.types.ndarray(ti.f64, 2)

WALLS = 6
CONTACT_GAP = 3.0 * SKIN  # m: movers nearer than this touch each other
REACHED = 1e-4  # m: rounding that pairs of groups are given

# Columns of a group's result.
TIME, RESULT_NORMAL, RESULT_COLUMNS = 0, 1, 4
RESULT_KIND, RESULT_ROW, RESULT_TOUCHES, RESULT_INTEGERS = 0, 1, 2, 3


@ti.func
def single(table: ti.template(), row: ti.i32, column: ti.i32):
    """Three float64 as float32."""
    return vec3(
        ti.cast(table[row, column], ti.f32),
        ti.cast(table[row, column + 1], ti.f32),
        ti.cast(table[row, column + 2], ti.f32),
    )


@ti.func
def turned(bodies: ti.template(), body: ti.i32, v):
    """A vector of a body's own axes in the world's."""
    w = ti.cast(bodies[body, ROTATION], ti.f32)
    axis = single(bodies, body, ROTATION + 1)
    twice = 2.0 * axis.cross(v)
    return v + w * twice + axis.cross(twice)


@ti.func
def chord_of(turn, move, arm):
    """How a point at `arm` from the body's origin moves while the body moves by `move` and turns by `turn`."""
    angle = turn.norm()
    result = move
    if angle > 1e-12:
        axis = turn / angle
        across = axis.cross(arm)
        half = ti.sin(0.5 * angle)
        result += ti.sin(angle) * across + (2.0 * half * half) * axis.cross(across)
    return result


@ti.kernel
def measure(
    bodies: Bodies,
    integers: Ints,
    groups: Ints,
    spheres: Floats,
    bounding: Floats,
    clearance: Floats,
    touches: Floats,
    nodes: Floats,
    triangles: Floats,
    instances: Floats,
    roots: Column,
    root: ti.i32,
):
    """Set clearance[sphere, 0]: how far each sphere is from all obstacles, as far as its body can see, m.

    First the sphere around the group: where that is out of sight of everything, so is all that it holds.
    """
    ti.loop_config(block_dim=8)
    for group in range(groups.shape[0]):
        body = groups[group, 0]
        if integers[body, COLLIDES] > 0:
            origin = single(bodies, body, POSITION)
            sight = ti.cast(bodies[body, SIGHT], ti.f32)
            first = groups[group, 1]
            arm = turned(bodies, body, vector_at(bounding, group, 0))
            radius = bounding[group, 3]
            together = -FAR
            for step in range(1 + groups[group, 2]):
                sphere = first + step - 1
                if step > 0:
                    arm = turned(bodies, body, vector_at(spheres, sphere, 0))
                    radius = spheres[sphere, 3]
                if together < sight:
                    distance, _normal, _row, _touched = look_around(
                        nodes,
                        triangles,
                        instances,
                        roots,
                        root,
                        origin + arm,
                        vec3(0.0),
                        radius,
                        radius + sight,
                        0.0,
                        0.0,
                        arm,
                        -arm,
                        touches,
                        0,
                        0,
                        False,
                    )
                    if step == 0:
                        together = distance - radius
                        if together >= sight * (1.0 - 1e-5):
                            together = sight
                    else:
                        clearance[sphere, 0] = distance - radius
                else:
                    clearance[sphere, 0] = sight * (1.0 - 1e-5)


@ti.func
def sweep_group(
    group: ti.i32,
    bodies: ti.template(),
    integers: ti.template(),
    groups: ti.template(),
    spheres: ti.template(),
    bounding: ti.template(),
    clearance: ti.template(),
    frozen: ti.template(),
    frozen_groups: ti.template(),
    near: ti.template(),
    planes: ti.template(),
    touches: ti.template(),
    result: ti.template(),
    result_rows: ti.template(),
    nodes: ti.template(),
    triangles: ti.template(),
    instances: ti.template(),
    roots: ti.template(),
    root: ti.i32,
):
    """Find when, in 0 .. 1, the motion that its body tries first makes a sphere of the group touch something."""
    body = groups[group, 0]
    origin = single(bodies, body, POSITION)
    move = single(bodies, body, MOVE)
    turn = single(bodies, body, TURN)
    reach = ti.cast(bodies[body, RADIUS], ti.f32)
    travel = ti.cast(bodies[body, TRAVEL], ti.f32)
    length = move.norm() + turn.norm() * reach
    slack = 0.125 * reach * turn.dot(turn)
    band = TOLERANCE
    if integers[body, KIND] != BOUNCES:
        band += length
    base = group * TOUCHES
    count = 0
    best = 1.0
    best_normal = vec3(0.0)
    best_kind = NOTHING
    best_row = -1
    first = groups[group, 1]
    last = first + groups[group, 2]
    for sphere in range(first, last):
        radius = spheres[sphere, 3]
        # What was farther away when the frame began than the body has moved since, and will, cannot be met.
        if clearance[sphere, 0] - travel < length + band + 2.0 * SKIN:
            arm = turned(bodies, body, vector_at(spheres, sphere, 0))
            chord = chord_of(turn, move, arm)
            time, normal, row, touched = look_around(
                nodes,
                triangles,
                instances,
                roots,
                root,
                origin + arm,
                chord,
                radius,
                best,
                slack,
                band,
                arm,
                turned(bodies, body, single(bodies, body, CENTRE)) - arm,
                touches,
                base,
                count,
                True,
            )
            count = touched
            if time < best:
                best = time
                best_normal = normal
                best_kind = OBSTACLE
                best_row = row
    if integers[body, LIMITED] > 0:
        # What is outside already may not go on outwards by itself while it is pulled inwards.
        pulled = vec3(0.0)
        if integers[body, KIND] == BOUNCES and integers[body, PULLED] > 0:
            pulled = single(bodies, body, PULL) * ti.cast(bodies[body, STEP] / bodies[body, ACTIVE], ti.f32)
        must_enter = integers[body, KIND] != BOUNCES and integers[body, TRIES] == 0
        for sphere in range(first, last):
            arm = turned(bodies, body, vector_at(spheres, sphere, 0))
            chord = chord_of(turn, move, arm)
            for wall in range(WALLS):
                normal = vector_at(planes, wall, 0)
                gap = normal.dot(origin + arm) + planes[wall, 3] - spheres[sphere, 3] - SKIN
                if gap < chord.norm() + band:
                    count = record(touches, base, count, normal, arm, gap, WALL)
                    approach = -normal.dot(chord)
                    time = FAR
                    if approach > SLIDE:
                        time = ti.max(gap - 0.5 * TOLERANCE, 0.0) / approach
                        if gap < TOLERANCE:
                            time = 0.0
                    if gap < -TOLERANCE and (must_enter or normal.dot(pulled - chord) > SLIDE):
                        time = 0.0
                    if time < best:
                        best = time
                        best_normal = normal
                        best_kind = WALL
                        best_row = wall
    bound = ti.cast(bodies[body, BOUND], ti.f32)
    mine = vector_at(frozen_groups, group, 0)
    size = bounding[group, 3]
    for i in range(near[body, 0]):
        other = near[body, 1 + i]
        theirs = ti.cast(bodies[other, BOUND], ti.f32)
        share = 0.5
        if bound + theirs > 0.0:
            share = bound / (bound + theirs)
        within = bound + theirs + 4.0 * SKIN + band + REACHED
        for each in range(integers[other, FIRST_GROUP], integers[other, FIRST_GROUP] + integers[other, GROUPS]):
            between = (vector_at(frozen_groups, each, 0) - mine).norm()
            if between < size + bounding[each, 3] + within:
                for sphere in range(first, last):
                    here = vector_at(frozen, sphere, 0)
                    radius = spheres[sphere, 3]
                    for b in range(groups[each, 1], groups[each, 1] + groups[each, 2]):
                        away = here - vector_at(frozen, b, 0)
                        distance = away.norm()
                        gap = distance - radius - spheres[b, 3]
                        if gap < within:
                            normal = away / ti.max(distance, 1e-9)
                            arm = turned(bodies, body, vector_at(spheres, sphere, 0))
                            chord = chord_of(turn, move, arm)
                            # Each of the two may close its share of the gap of the beginning of the substep.
                            closed = -normal.dot(origin + arm - here)
                            left = share * (gap - SKIN)
                            if gap > SKIN:
                                left -= closed
                            kind = WAIT
                            if gap < CONTACT_GAP:
                                kind = MOVER
                            if left < chord.norm() + band:
                                count = record(touches, base, count, normal, arm, left, kind)
                                approach = -normal.dot(chord)
                                time = FAR
                                if left < TOLERANCE:
                                    if approach > SLIDE:
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
    result[group, TIME] = best
    for i in ti.static(range(3)):
        result[group, RESULT_NORMAL + i] = best_normal[i]
    result_rows[group, RESULT_KIND] = best_kind
    result_rows[group, RESULT_ROW] = best_row
    result_rows[group, RESULT_TOUCHES] = count


@ti.kernel
def distances(
    points: Floats,
    limit: ti.f32,
    touches: Floats,
    nodes: Floats,
    triangles: Floats,
    instances: Floats,
    roots: Column,
    root: ti.i32,
):
    """Set column 3 of `points`, f32 [n, 4], to the distance of the nearest obstacle, m; `limit` if none is nearer."""
    for i in range(points.shape[0]):
        distance, _normal, _row, _touched = look_around(
            nodes,
            triangles,
            instances,
            roots,
            root,
            vector_at(points, i, 0),
            vec3(0.0),
            0.0,
            limit,
            0.0,
            0.0,
            vec3(0.0),
            vec3(0.0),
            touches,
            0,
            0,
            False,
        )
        points[i, 3] = distance
