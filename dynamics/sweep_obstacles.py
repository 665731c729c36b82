# SPDX-License-Identifier: Apache-2.0
"""Continuous collision detection of a moving body against obstacles: Taichi functions, one call for each body.

A body is covered by spheres in groups. `groups`, i32 [g, 3], has the body, the first sphere and the number of spheres
of each group; `bounding`, f32 [g, 4], the sphere around it. `spheres`, f32 [n, 4], has centers and radii in the body's
own axes, m. The columns of `bodies` and `integers` are those of `dynamics.body_layout`.
"""

import taichi as ti

from dynamics.body_layout import BOUNCES, CENTER, FIRST_GROUP, GROUP_COUNT, KIND, MOVE, POSITION, RADIUS, ROTATION, TURN
from dynamics.contact import MAX_TOUCHES, SKIN, TOLERANCE
from dynamics.kernel_types import Floats2, Ints1, Template
from dynamics.sphere_query import CONTACT, NEAREST, WITHIN, query_sphere
from dynamics.tree_access import Tree, vec3, vector_at

ROUNDING_MARGIN = 1e-4  # m: added to bounding spheres and pairs of groups


@ti.func
def read3_f32(table: Template, row: ti.i32, column: ti.i32):
    """Return three consecutive float64 columns as float32."""
    return vec3(
        ti.cast(table[row, column], ti.f32),
        ti.cast(table[row, column + 1], ti.f32),
        ti.cast(table[row, column + 2], ti.f32),
    )


@ti.func
def rotate_to_world(bodies: Template, body: ti.i32, v):
    """Rotate a vector from the body's own axes to world axes."""
    w = ti.cast(bodies[body, ROTATION], ti.f32)
    axis = read3_f32(bodies, body, ROTATION + 1)
    twice = 2.0 * axis.cross(v)
    return v + w * twice + axis.cross(twice)


@ti.func
def point_displacement(turn, move, arm):
    """Return how a point at `arm` from the body's origin moves while the body moves by `move` and turns by `turn`."""
    angle = turn.norm()
    result = move
    if angle > 1e-12:
        axis = turn / angle
        across = axis.cross(arm)
        half = ti.sin(0.5 * angle)
        result += ti.sin(angle) * across + (2.0 * half * half) * axis.cross(across)
    return result


@ti.func
def touch_band(bodies: Template, integers: Template, body: ti.i32) -> ti.f32:
    """Return the gap, m, below which touches are recorded; for a follower all that its motion could reach."""
    band = TOLERANCE
    if integers[body, KIND] != BOUNCES:
        length = read3_f32(bodies, body, MOVE).norm()
        length += read3_f32(bodies, body, TURN).norm() * ti.cast(bodies[body, RADIUS], ti.f32)
        band += length
    return band


@ti.func
def sweep_obstacles(
    bodies: Template,
    integers: Template,
    groups: Template,
    spheres: Template,
    bounding: Template,
    touches: Template,
    times: Template,
    counts: Template,
    is_bvh8: Template,
    nodes: Template,
    triangles: Template,
    instances: Template,
    roots: Template,
    root: ti.i32,
    body: ti.i32,
):
    """Compute when (0..1) the attempted motion makes one of the body's spheres touch an obstacle.

    Tests the sphere around the body first, then those around its groups: where these are free, so are the spheres
    inside. The group with the earliest possible contact goes first, because its result bounds the search of the others.

    Args:
        touches: Receives the touches of every group.
        times: Scratch, one per group: lower bounds of the time of contact.
        counts: Number of touches of every group, updated.
        is_bvh8: Layout of the trees; this and the next five are `Obstacles.arguments()`.
        body: Row of the body.

    Returns:
        Time, 1 without a contact; normal; instance row, -1 without a contact.
    """
    origin = read3_f32(bodies, body, POSITION)
    move = read3_f32(bodies, body, MOVE)
    turn = read3_f32(bodies, body, TURN)
    angle = turn.norm()
    slack = 0.125 * ti.cast(bodies[body, RADIUS], ti.f32) * angle * angle
    band = touch_band(bodies, integers, body)
    first = integers[body, FIRST_GROUP]
    count = integers[body, GROUP_COUNT]
    earliest_group = -1
    for step in range(count + 1):
        group = first + step - 1
        arm = vec3(0.0)
        radius = ti.cast(bodies[body, RADIUS], ti.f32)
        if step > 0:
            arm = rotate_to_world(bodies, body, vector_at(bounding, group, 0))
            # Spheres off the group's center move differently when the body turns.
            radius = bounding[group, 3] * (1.0 + angle)
        if step == 0 or earliest_group > -1:
            time, _normal, _row, _touched = query_sphere(
                is_bvh8, nodes, triangles, instances, roots, root,
                origin + arm, point_displacement(turn, move, arm), radius + band + SKIN + ROUNDING_MARGIN,
                1.0, 0.0, 0.0, arm, arm, touches, 0, 0, WITHIN,
            )  # fmt: skip
            if step > 0:
                times[group] = time
                if time < times[earliest_group]:
                    earliest_group = group
            elif time < 1.0:
                earliest_group = first
                times[first] = 1.0
    best = 1.0
    best_normal = vec3(0.0)
    best_row = -1
    if earliest_group > -1:
        for step in range(count + 1):
            group = first + step - 1
            if step == 0:
                group = earliest_group
            time = times[group]
            if (step == 0 or group != earliest_group) and (time < best or time <= 0.0):
                for sphere in range(groups[group, 1], groups[group, 1] + groups[group, 2]):
                    arm = rotate_to_world(bodies, body, vector_at(spheres, sphere, 0))
                    time_of_sphere, normal, row, touched = query_sphere(
                        is_bvh8, nodes, triangles, instances, roots, root,
                        origin + arm, point_displacement(turn, move, arm), spheres[sphere, 3], best, slack, band,
                        arm, rotate_to_world(bodies, body, read3_f32(bodies, body, CENTER)) - arm,
                        touches, group * MAX_TOUCHES, counts[group], CONTACT,
                    )  # fmt: skip
                    counts[group] = touched
                    if time_of_sphere < best:
                        best = time_of_sphere
                        best_normal = normal
                        best_row = row
    return best, best_normal, best_row


@ti.kernel
def obstacle_distances(
    points: Floats2,
    limit: ti.f32,
    touches: Floats2,
    is_bvh8: Template,
    nodes: Tree,
    triangles: Tree,
    instances: Floats2,
    roots: Ints1,
    root: ti.i32,
):
    """Set column 3 of `points`, f32 [n, 4], to the distance of the nearest obstacle, m; `limit` if none is nearer."""
    for i in range(points.shape[0]):
        distance, _normal, _row, _touched = query_sphere(
            is_bvh8, nodes, triangles, instances, roots, root,
            vector_at(points, i, 0), vec3(0.0), 0.0, limit,
            0.0, 0.0, vec3(0.0), vec3(0.0), touches, 0, 0, NEAREST,
        )  # fmt: skip
        points[i, 3] = distance
