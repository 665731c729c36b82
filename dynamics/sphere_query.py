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
def reciprocal(d: ti.f32) -> ti.f32:
    """Return 1 / d, finite even for d = 0, so that 0 * infinity does not occur."""
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
    inverse_x, inverse_y, inverse_z = reciprocal(chord[0]), reciprocal(chord[1]), reciprocal(chord[2])
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
            entry = child_bounds(nodes, node, 0, is_bvh8)
            leave = entry
            if ti.static(query == NEAREST):
                gap = (
                    ti.max(ti.max(entry - start[0], start[0] - child_bounds(nodes, node, 3, is_bvh8)), 0.0)
                    * meters_per_unit[0],
                    ti.max(
                        ti.max(
                            child_bounds(nodes, node, 1, is_bvh8) - start[1],
                            start[1] - child_bounds(nodes, node, 4, is_bvh8),
                        ),
                        0.0,
                    )
                    * meters_per_unit[1],
                    ti.max(
                        ti.max(
                            child_bounds(nodes, node, 2, is_bvh8) - start[2],
                            start[2] - child_bounds(nodes, node, 5, is_bvh8),
                        ),
                        0.0,
                    )
                    * meters_per_unit[2],
                )
                entry = ti.sqrt(factor * (gap[0] * gap[0] + gap[1] * gap[1] + gap[2] * gap[2]))
                leave = entry * 0.0 + best
            else:
                flip_x = ti.select(inverse_x < 0.0, 1, 0)
                flip_y = ti.select(inverse_y < 0.0, 1, 0)
                flip_z = ti.select(inverse_z < 0.0, 1, 0)
                side_x = expansion[0] * (1.0 - 2.0 * flip_x)
                side_y = expansion[1] * (1.0 - 2.0 * flip_y)
                side_z = expansion[2] * (1.0 - 2.0 * flip_z)
                entry = ti.max(
                    ti.max(
                        (child_bounds(nodes, node, 3 * flip_x, is_bvh8) - (start[0] + side_x)) * inverse_x,
                        (child_bounds(nodes, node, 1 + 3 * flip_y, is_bvh8) - (start[1] + side_y)) * inverse_y,
                    ),
                    ti.max((child_bounds(nodes, node, 2 + 3 * flip_z, is_bvh8) - (start[2] + side_z)) * inverse_z, 0.0),
                )
                leave = ti.min(
                    ti.min(
                        (child_bounds(nodes, node, 3 - 3 * flip_x, is_bvh8) - (start[0] - side_x)) * inverse_x,
                        (child_bounds(nodes, node, 4 - 3 * flip_y, is_bvh8) - (start[1] - side_y)) * inverse_y,
                    ),
                    ti.min(
                        (child_bounds(nodes, node, 5 - 3 * flip_z, is_bvh8) - (start[2] - side_z)) * inverse_z, best
                    ),
                )
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
            along = transformed(instances, instance, INVERSE, chord, 0.0)
            inverse_x, inverse_y, inverse_z = reciprocal(along[0]), reciprocal(along[1]), reciprocal(along[2])
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
                inverse_x, inverse_y, inverse_z = reciprocal(chord[0]), reciprocal(chord[1]), reciprocal(chord[2])
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
