# SPDX-License-Identifier: Apache-2.0
"""Traversal of the obstacles' two-level hierarchy around a sphere: distance, and time of first contact.

The primitives for one triangle are those of `dynamics.contact`; the hierarchy is described in `dynamics.obstacles`.
Traversal is depth first with a stack, nearest child first. Taichi functions.
"""

import taichi as ti

from dynamics.contact import (
    FAR,
    OBSTACLE,
    SKIN,
    first_contact,
    first_within,
    nearest_on_triangle,
    record_touch,
)
from dynamics.kernel_types import Template
from dynamics.obstacles import GAP_FACTOR, INVERSE, MATRIX, METERS_PER_UNIT
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

NEAREST, WITHIN, CONTACT = 0, 1, 2  # queries, see `query_sphere`


@ti.func
def reciprocals(v):
    """Return 1 / v of each component, finite even for 0, so that 0 * infinity does not occur."""
    result = vec3(0.0)
    for axis in ti.static(range(3)):
        result[axis] = 1.0 / ti.select(ti.abs(v[axis]) < 1e-18, ti.select(v[axis] < 0.0, -1e-18, 1e-18), v[axis])
    return result


@ti.func
def box_distances(nodes: Template, node: ti.i32, point, meters_per_unit, factor: ti.f32, is_bvh8: Template):
    """Return the distance, m, of a point from the box of each child of a node.

    factor: makes the square of a distance a lower bound where axes are sheared, see `dynamics.obstacles`.
    """
    square = ti.Vector([0.0] * (8 if is_bvh8 else 2))
    for axis in ti.static(range(3)):
        below = child_bounds(nodes, node, axis, is_bvh8) - point[axis]
        above = point[axis] - child_bounds(nodes, node, 3 + axis, is_bvh8)
        gap = ti.max(ti.max(below, above), 0.0) * meters_per_unit[axis]
        square += gap * gap
    return ti.sqrt(factor * square)


@ti.func
def box_intervals(nodes: Template, node: ti.i32, start, inverse, expansion, until: ti.f32, is_bvh8: Template):
    """Return when, between 0 and `until`, a moving point is in the expanded box of each child: entry and exit times.

    Args:
        nodes, node, is_bvh8: Of the hierarchy.
        start: Of the point.
        inverse: `reciprocals` of its motion from time 0 to 1.
        expansion: Of the boxes along each axis.
        until: Latest time of interest.
    """
    entry = ti.Vector([0.0] * (8 if is_bvh8 else 2))
    leave = entry + until
    for axis in ti.static(range(3)):
        flip = ti.select(inverse[axis] < 0.0, 1, 0)
        side = expansion[axis] * (1.0 - 2.0 * flip)
        near = child_bounds(nodes, node, axis + 3 * flip, is_bvh8) - (start[axis] + side)
        far = child_bounds(nodes, node, axis + 3 - 3 * flip, is_bvh8) - (start[axis] - side)
        entry = ti.max(entry, near * inverse[axis])
        leave = ti.min(leave, far * inverse[axis])
    return entry, leave


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
    """Traverse the hierarchy around a sphere.

    Args:
        is_bvh8: Layout of the trees; this and the next five are `Obstacles.arguments()`.
        center: Center of the sphere, m, world.
        chord: Motion of the center from time 0 to 1, m.
        radius: Of the sphere, m.
        limit: Largest time (CONTACT, WITHIN; 1 for the whole chord) or distance, m (NEAREST), of interest.
        slack: See `first_contact`; this and all that follow up to `count` serve CONTACT.
        band: Triangles nearer than this at time 0 are recorded as touches, m.
        arm: From the body's origin to the center, m.
        inward: From the center into the body.
        touches: Receives the touches.
        base: First row of the sphere's group in `touches`.
        count: Number of touches that the group has already.
        query: Compile-time constant. CONTACT: find when the sphere first touches a triangle, and record touches.
            WITHIN: find a lower bound of when the center is within `radius` of a triangle. NEAREST: find the distance
            of the center to the nearest triangle.

    Returns:
        Time or distance, `limit` if there is none below; normal and instance row (-1 for none) of a contact; number of
        touches of the group.
    """
    best = limit
    best_normal = vec3(0.0)
    best_instance = -1
    touched = count
    # Boxes are expanded by the sphere's radius and tested against a line, in the units of the instance's space.
    reach = radius + band
    if ti.static(query == CONTACT):
        reach += SKIN
    expansion = vec3(reach)
    start = center
    inverse = reciprocals(chord)
    meters_per_unit = vec3(1.0)
    factor = 1.0
    stack = ti.Vector([0] * STACK)
    stack_entries = ti.Vector([0.0] * STACK)
    stack_size = 0
    mesh_stack_base = -1  # stack entries below it belong to the upper tree; -1 while in the upper tree
    instance = -1
    current = root
    searching = True
    while searching:
        pop = False
        if current >= 0:
            node = current
            entry, leave = ti.Vector([0.0] * (8 if is_bvh8 else 2)), ti.Vector([0.0] * (8 if is_bvh8 else 2))
            if ti.static(query == NEAREST):
                entry = box_distances(nodes, node, start, meters_per_unit, factor, is_bvh8)
                leave += best
            else:
                entry, leave = box_intervals(nodes, node, start, inverse, expansion, best, is_bvh8)
            nearest = FAR
            any_child = False
            for k in ti.static(range(8 if is_bvh8 else 2)):
                if entry[k] <= leave[k]:
                    reference = child_reference(nodes, node, k, is_bvh8)
                    child_entry = entry[k]
                    if any_child:
                        # Visit the nearest child next; push the others.
                        if child_entry < nearest:
                            reference, current = current, reference
                            child_entry, nearest = nearest, child_entry
                        stack[stack_size] = reference
                        stack_entries[stack_size] = child_entry
                        stack_size += 1
                    else:
                        current = reference
                        nearest = child_entry
                        any_child = True
            pop = not any_child
        elif mesh_stack_base < 0:
            instance = leaf_instance(current, is_bvh8)
            meters_per_unit = vector_at(instances, instance, METERS_PER_UNIT)
            factor = instances[instance, GAP_FACTOR]
            start = transformed(instances, instance, INVERSE, center, 1.0)
            inverse = reciprocals(transformed(instances, instance, INVERSE, chord, 0.0))
            expansion = reach / meters_per_unit
            mesh_stack_base = stack_size
            current = roots[instance]
        else:
            first, triangle_count = leaf_triangles(triangles, current, is_bvh8)
            for index in range(triangle_count):
                corner, edge_1, edge_2 = load_triangle(triangles, first, index, is_bvh8)
                corner = transformed(instances, instance, MATRIX, corner, 1.0) - center
                edge_1 = transformed(instances, instance, MATRIX, edge_1, 0.0)
                edge_2 = transformed(instances, instance, MATRIX, edge_2, 0.0)
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
                inverse = reciprocals(chord)
                expansion = vec3(reach)
                meters_per_unit = vec3(1.0)
                factor = 1.0
            if stack_size == 0:
                searching = False
                pop = False
            else:
                stack_size -= 1
                current = stack[stack_size]
                pop = stack_entries[stack_size] > best
    return best, best_normal, best_instance, touched
