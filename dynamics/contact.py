# SPDX-License-Identifier: Apache-2.0
"""Spheres against triangles: how far away they are, and when a moving sphere first touches one.

Device functions, over the two-level tree of `dynamics.obstacles`. Everything is float32 and relative to the sphere's
center, so that only the last subtraction rounds. (No postponed annotations in this module.)
"""

import taichi as ti

from dynamics.kernel_types import Template
from dynamics.obstacles import GAP_FACTOR, METERS_PER_UNIT
from dynamics.tree_access import (
    STACK,
    child_bounds,
    child_reference,
    leaf_instance,
    leaf_triangles,
    load_triangle,
    transformed,
    vec3,
    vector_at,
)

FAR = 1e30
SKIN = 5e-4  # m: the gap that motion stops at
TOLERANCE = 2e-5  # m: nearer than this to that gap counts as touching
SLIDE_TOLERANCE = 2e-6  # m: approach that counts as sliding along
ITERATIONS = 16
COARSE_ITERATIONS = 4  # iterations where less than the exact time will do
NEAREST, WITHIN, CONTACT = 0, 1, 2  # query is looked for

# What a sphere meets. WAIT: the share of a gap to a mover that is still too far away to be touched.
NOTHING, OBSTACLE, MOVER, WALL, WAIT = 0, 1, 2, 3, 4

# A touch: normal (towards the sphere), arm (from the body's origin to the sphere), gap, kind.
MAX_TOUCHES = 16  # most that a group of spheres keeps
NORMAL, ARM, GAP, TOUCH_KIND, TOUCH_COLUMNS = 0, 3, 6, 7, 8


@ti.func
def nearest_on_edge(start, edge):
    """The point of the segment from `start` along `edge` that is nearest to the origin."""
    along = ti.min(ti.max(-start.dot(edge) / ti.max(edge.dot(edge), 1e-30), 0.0), 1.0)
    return start + along * edge


@ti.func
def nearest_on_triangle(corner, edge_1, edge_2):
    """The point of a triangle that is nearest to the origin.

    Edges count even where the interior claims to be nearer, so that slivers cannot make the distance too large.
    """
    best = nearest_on_edge(corner, edge_1)
    for point in ti.static(
        (nearest_on_edge(corner, edge_2), nearest_on_edge(corner + edge_1, edge_2 - edge_1)),
    ):
        if point.dot(point) < best.dot(best):
            best = point
    normal = edge_1.cross(edge_2)
    square = ti.max(normal.dot(normal), 1e-30)
    u = edge_2.cross(corner).dot(normal) / square
    v = corner.cross(edge_1).dot(normal) / square
    if u >= 0.0 and v >= 0.0 and u + v <= 1.0:
        foot = normal * (corner.dot(normal) / square)
        if foot.dot(foot) < best.dot(best):
            best = foot
    return best


@ti.func
def record_touch(touches: Template, base: ti.i32, count: ti.i32, normal, arm, gap: ti.f32, kind: ti.i32) -> ti.i32:
    """Keep a touch among those of a group; of similar ones of one sphere the nearer. Returns how many there are."""
    slot = -1
    worst = 0
    for i in range(count):
        row = base + i
        if slot < 0:
            if (vector_at(touches, row, ARM) - arm).norm() < 1e-6 and vector_at(touches, row, NORMAL).dot(normal) > 0.9:
                slot = i
        if touches[row, GAP] > touches[base + worst, GAP]:
            worst = i
    result = count
    if slot < 0:
        slot = worst
        if count < MAX_TOUCHES:
            slot = count
            result = count + 1
            touches[base + slot, GAP] = FAR
    if gap < touches[base + slot, GAP]:
        for i in ti.static(range(3)):
            touches[base + slot, NORMAL + i] = normal[i]
            touches[base + slot, ARM + i] = arm[i]
        touches[base + slot, GAP] = gap
        touches[base + slot, TOUCH_KIND] = ti.cast(kind, ti.f32)
    return result


@ti.func
def first_contact(corner, edge_1, edge_2, chord, radius: ti.f32, slack: ti.f32, inward, until: ti.f32):
    """When (0 .. until) a sphere of `radius` + SKIN that moves from the origin along `chord` touches a triangle.

    Returns the time, FAR for never; the normal there; the normal and the gap at the start. inward: points from the
    sphere into the body that it belongs to. slack: how far the true path may bend away from the chord, m.

    Newton's method on the distance, which is a convex function of time: every step goes to where the sphere would
    touch the plane through the nearest point, so it never goes too far and never enters the triangle.
    """
    stop = radius + SKIN
    time = FAR
    time_reached = 0.0
    normal = vec3(0.0)
    start_normal = normal
    start_gap = 0.0
    searching = True
    for step in range(ITERATIONS):
        if searching:
            point = nearest_on_triangle(corner - time_reached * chord, edge_1, edge_2)
            distance = point.norm()
            normal = -point / ti.max(distance, 1e-9)
            if distance < 1e-6:
                # The center lies on the triangle: the side on which the body is decides.
                normal = edge_1.cross(edge_2).normalized()
                if normal.dot(inward) < 0.0:
                    normal = -normal
            if step == 0:
                start_gap = distance - stop
                if start_gap < -0.5 * SKIN and normal.dot(inward) < 0.0:
                    # It was put there with its center beyond the surface already: it has to come back.
                    normal = -normal
                    start_gap = -distance - stop
                start_normal = normal
            approach = -normal.dot(chord)
            if step == 0:
                if start_gap < TOLERANCE and approach > SLIDE_TOLERANCE:
                    time = 0.0
                elif start_gap < -0.5 * SKIN:
                    # Too near already: it must get away, even where its path bends back.
                    if approach > -4.0 * slack - 1e-9:
                        time = 0.0
                    searching = False
                if start_gap < TOLERANCE:
                    stop = radius + 0.5 * SKIN
                if time == 0.0:
                    searching = False
            elif approach > 0.0 and distance - stop < 0.5 * TOLERANCE:
                time = time_reached
                searching = False
            if approach <= 0.0:
                searching = False
            if searching:
                time_reached += ti.max(distance - stop, 0.0) / approach
                if time_reached >= until:
                    searching = False
    if searching:
        time = time_reached  # not settled in time: stop where it is still free
    return time, normal, start_normal, start_gap


@ti.func
def first_within(corner, edge_1, edge_2, chord, radius: ti.f32, until: ti.f32) -> ti.f32:
    """No later than when (0 .. until) a point that moves from the origin along `chord` is `radius` from a triangle.

    FAR for never. Newton's method as in `first_contact`, ended early: it comes from before.
    """
    time = FAR
    time_reached = 0.0
    searching = True
    for _ in range(COARSE_ITERATIONS):
        if searching:
            point = nearest_on_triangle(corner - time_reached * chord, edge_1, edge_2)
            distance = point.norm()
            approach = point.dot(chord)
            if distance <= radius:
                time = time_reached
                searching = False
            elif approach <= 0.0:
                searching = False
            else:
                time_reached += (distance - radius) * distance / approach
                if time_reached >= until:
                    searching = False
    if searching:
        time = time_reached
    return time


@ti.func
def reciprocal(d: ti.f32) -> ti.f32:
    """1 / d, finite also for d = 0, so that 0 * infinity does not arise."""
    return 1.0 / ti.select(ti.abs(d) < 1e-18, ti.select(d < 0.0, -1e-18, 1e-18), d)


@ti.func
def query_sphere(
    is_bvh8: Template,
    nodes: Template,
    triangles: Template,
    instances: Template,
    roots: Template,
    root: ti.i32,
    center,
    chord,
    radius: ti.f32,
    limit: ti.f32,
    slack: ti.f32,
    band: ti.f32,
    arm,
    inward,
    touches: Template,
    base: ti.i32,
    count: ti.i32,
    query: Template,
):
    """Walk the tree about a sphere. query (static):

    CONTACT: find when, before `limit` (1 for the whole of `chord`), the sphere first touches anything, and keep as
    touches query is nearer than `band`. WITHIN: no later than when its center comes within `radius` of anything.
    NEAREST: the distance of its center to the nearest triangle. Returns that number, or `limit` if there is nothing
    before; the normal, the instance and the touch count.
    """
    best = limit
    best_normal = vec3(0.0)
    best_instance = -1
    touched = count
    # The boxes are grown, and met by a line; in an instance's space all is measured in its own units.
    reach = radius + band
    if ti.static(query == CONTACT):
        reach += SKIN
    grown = vec3(reach)
    start = center
    ix, iy, iz = reciprocal(chord[0]), reciprocal(chord[1]), reciprocal(chord[2])
    meters = vec3(1.0)
    factor = 1.0
    stack = ti.Vector([0] * STACK)
    stack_entries = ti.Vector([0.0] * STACK)
    stack_size = 0
    mesh_stack_base = -1  # stack_entries below it belong to the upper tree; -1 while in it
    instance = -1
    current = root
    searching = True
    while searching:
        pop = False
        if current >= 0:
            node = current
            entry = child_bounds(nodes, node, 0, is_bvh8)
            leave = entry
            if ti.static(query == NEAREST):
                gap = (
                    ti.max(ti.max(entry - start[0], start[0] - child_bounds(nodes, node, 3, is_bvh8)), 0.0) * meters[0],
                    ti.max(
                        ti.max(
                            child_bounds(nodes, node, 1, is_bvh8) - start[1],
                            start[1] - child_bounds(nodes, node, 4, is_bvh8),
                        ),
                        0.0,
                    )
                    * meters[1],
                    ti.max(
                        ti.max(
                            child_bounds(nodes, node, 2, is_bvh8) - start[2],
                            start[2] - child_bounds(nodes, node, 5, is_bvh8),
                        ),
                        0.0,
                    )
                    * meters[2],
                )
                entry = ti.sqrt(factor * (gap[0] * gap[0] + gap[1] * gap[1] + gap[2] * gap[2]))
                leave = entry * 0.0 + best
            else:
                flip_x = ti.select(ix < 0.0, 1, 0)
                flip_y = ti.select(iy < 0.0, 1, 0)
                flip_z = ti.select(iz < 0.0, 1, 0)
                side_x = grown[0] * (1.0 - 2.0 * flip_x)
                side_y = grown[1] * (1.0 - 2.0 * flip_y)
                side_z = grown[2] * (1.0 - 2.0 * flip_z)
                entry = ti.max(
                    ti.max(
                        (child_bounds(nodes, node, 3 * flip_x, is_bvh8) - (start[0] + side_x)) * ix,
                        (child_bounds(nodes, node, 1 + 3 * flip_y, is_bvh8) - (start[1] + side_y)) * iy,
                    ),
                    ti.max((child_bounds(nodes, node, 2 + 3 * flip_z, is_bvh8) - (start[2] + side_z)) * iz, 0.0),
                )
                leave = ti.min(
                    ti.min(
                        (child_bounds(nodes, node, 3 - 3 * flip_x, is_bvh8) - (start[0] - side_x)) * ix,
                        (child_bounds(nodes, node, 4 - 3 * flip_y, is_bvh8) - (start[1] - side_y)) * iy,
                    ),
                    ti.min((child_bounds(nodes, node, 5 - 3 * flip_z, is_bvh8) - (start[2] - side_z)) * iz, best),
                )
            nearest = FAR
            found = False
            for k in ti.static(range(8 if is_bvh8 else 2)):
                if entry[k] <= leave[k]:
                    reference = child_reference(nodes, node, k, is_bvh8)
                    at = entry[k]
                    if found:
                        # The nearest is visited next, the others wait.
                        if at < nearest:
                            reference, current = current, reference
                            at, nearest = nearest, at
                        stack[stack_size] = reference
                        stack_entries[stack_size] = at
                        stack_size += 1
                    else:
                        current = reference
                        nearest = at
                        found = True
            pop = not found
        elif mesh_stack_base < 0:
            instance = leaf_instance(current, is_bvh8)
            meters = vector_at(instances, instance, METERS_PER_UNIT)
            factor = instances[instance, GAP_FACTOR]
            start = transformed(instances, instance, 12, center, 1.0)
            along = transformed(instances, instance, 12, chord, 0.0)
            ix, iy, iz = reciprocal(along[0]), reciprocal(along[1]), reciprocal(along[2])
            grown = reach / meters
            mesh_stack_base = stack_size
            current = roots[instance]
        else:
            first, number = leaf_triangles(triangles, current, is_bvh8)
            for which in range(number):
                corner, edge_1, edge_2 = load_triangle(triangles, first, which, is_bvh8)
                corner = transformed(instances, instance, 0, corner, 1.0) - center
                edge_1 = transformed(instances, instance, 0, edge_1, 0.0)
                edge_2 = transformed(instances, instance, 0, edge_2, 0.0)
                if ti.static(query == CONTACT):
                    time, normal, start_normal, start_gap = first_contact(
                        corner, edge_1, edge_2, chord, radius, slack, inward, best
                    )
                    if start_gap < band:
                        touched = record_touch(touches, base, touched, start_normal, arm, start_gap, OBSTACLE)
                    if time < best:
                        best = time
                        best_normal = normal
                        best_instance = instance
                elif ti.static(query == WITHIN):
                    if best > 0.0:
                        best = ti.min(best, first_within(corner, edge_1, edge_2, chord, radius, best))
                else:
                    best = ti.min(best, nearest_on_triangle(corner, edge_1, edge_2).norm())
            pop = True
            if ti.static(query == WITHIN):
                if best <= 0.0:
                    pop = False
                    searching = False
        while pop:
            if stack_size == mesh_stack_base:
                mesh_stack_base = -1
                start = center
                ix, iy, iz = reciprocal(chord[0]), reciprocal(chord[1]), reciprocal(chord[2])
                grown = vec3(reach)
                meters = vec3(1.0)
                factor = 1.0
            if stack_size == 0:
                searching = False
                pop = False
            else:
                stack_size -= 1
                current = stack[stack_size]
                pop = stack_entries[stack_size] > best
    return best, best_normal, best_instance, touched
