# SPDX-License-Identifier: Apache-2.0
"""Spheres against triangles: distance, time of first contact of a moving sphere, and the record of touches.

Taichi functions for one sphere and one triangle; `dynamics.sphere_query` calls them for whole scenes. All arithmetic is
float32 and relative to the sphere's center, so that only the final subtraction rounds.

A touch is a row of `touches`, f32 [groups * MAX_TOUCHES, TOUCH_COLUMNS]: unit normal towards the sphere, arm from the
body's origin to the sphere's center, gap in meters, and kind of what is touched.
"""

import taichi as ti

from dynamics.kernel_types import Template
from dynamics.tree_access import vec3, vector_at

FAR = 1e30  # time of a contact that never happens
SKIN = 5e-4  # m: gap at which motion stops
TOLERANCE = 2e-5  # m: a gap below SKIN + TOLERANCE counts as touching
SLIDE_TOLERANCE = 2e-6  # m: approach up to this counts as sliding
ITERATIONS = 16  # of Newton's method
COARSE_ITERATIONS = 4  # where a lower bound of the time is enough

# What a sphere hits. WAIT: nothing yet, but its share of the gap to another mover is used up for this substep.
NOTHING, OBSTACLE, MOVER, WALL, WAIT = 0, 1, 2, 3, 4

MAX_TOUCHES = 16  # of a group of spheres
NORMAL, ARM, GAP, TOUCH_KIND, TOUCH_COLUMNS = 0, 3, 6, 7, 8


@ti.func
def nearest_on_edge(start, edge):
    """Return the point nearest to the origin on the line segment from `start` to `start + edge`."""
    along = ti.min(ti.max(-start.dot(edge) / ti.max(edge.dot(edge), 1e-30), 0.0), 1.0)
    return start + along * edge


@ti.func
def nearest_on_triangle(corner, edge_1, edge_2):
    """Return the point of a triangle nearest to the origin.

    Edges are tested even where the interior seems nearer, so that slivers cannot make the distance too large.
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
    """Add a touch to those of a group; of similar touches of one sphere keep the nearer.

    If the group is full, the touch replaces the farthest one, if it is nearer.

    Args:
        touches: All touches.
        base: First row of the group.
        count: Number of touches of the group.
        normal: Unit normal towards the sphere.
        arm: From the body's origin to the sphere's center, m.
        gap: Distance to what is touched, m; negative for a penetration.
        kind: OBSTACLE, MOVER, WALL or WAIT.

    Returns:
        The new number of touches of the group.
    """
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
    """Compute when a sphere that moves from the origin along `chord` first touches a triangle.

    The distance is a convex function of time. Newton's method steps to where the sphere would touch the plane through
    the nearest point, and therefore never passes the time of contact.

    Args:
        corner: Corner of the triangle, relative to the sphere's center.
        edge_1: Edge from the corner.
        edge_2: Other edge from the corner.
        chord: Motion of the center from time 0 to 1, m.
        radius: Of the sphere, m; it touches at a distance of `radius` + SKIN.
        slack: Largest distance between the true path of the center and the chord, m.
        inward: From the sphere's center into the body that it belongs to.
        until: Latest time of interest.

    Returns:
        Time (0..until; FAR for none); normal at that time; normal and gap, m, at time 0.
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
                # The center lies on the triangle: choose the normal on the body's side.
                normal = edge_1.cross(edge_2).normalized()
                if normal.dot(inward) < 0.0:
                    normal = -normal
            if step == 0:
                start_gap = distance - stop
                if start_gap < -0.5 * SKIN and normal.dot(inward) < 0.0:
                    # The center was placed beyond the surface: the sphere has to move back.
                    normal = -normal
                    start_gap = -distance - stop
                start_normal = normal
            approach = -normal.dot(chord)
            if step == 0:
                if start_gap < TOLERANCE and approach > SLIDE_TOLERANCE:
                    time = 0.0
                elif start_gap < -0.5 * SKIN:
                    # Penetrating: the sphere must move away, even where its path curves back.
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
        time = time_reached  # not converged: the sphere is still free at this time
    return time, normal, start_normal, start_gap


@ti.func
def first_within(corner, edge_1, edge_2, chord, radius: ti.f32, until: ti.f32) -> ti.f32:
    """Compute a lower bound of when a point that moves from the origin along `chord` is within `radius` of a triangle.

    Newton's method as in `first_contact`, stopped early: its iterates never exceed the exact time.

    Returns:
        Time (0..until; FAR for never).
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
