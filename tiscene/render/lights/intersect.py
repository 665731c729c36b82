# SPDX-License-Identifier: Apache-2.0
"""Lights that a ray meets. They are not in the tree of surfaces: rays are tested against them apart, shadow rays too,
so that a light hides what is behind it however a path gets there."""

import taichi as ti

from tiscene.device.kernel_types import Template, float8, vec3
from tiscene.render.intersect.bvh8 import bits_of, larger, slabs, smaller
from tiscene.render.lights import dispatch, emissive_mesh
from tiscene.render.lights.importance import weigh
from tiscene.render.lights.lane_ops import lowest
from tiscene.render.lights.light_sample import header
from tiscene.scene.lights.light_bvh import EIGHT_ROWS, EIGHTS, MEMBER
from tiscene.scene.lights.light_table import ON_DIFFUSE, ON_INDIRECT, ON_SPECULAR, SHADOWLESS
from tiscene.scene.lights.light_tree import (
    H_BOXES,
    H_DISTANT_ROW,
    H_PORTAL_ROW,
    H_SOLID_COUNT,
    LANE_BITS,
    LANES,
    MOST_ENTRIES,
)

# A light that lies on a surface wins over it, by this part of the distance.
LIGHT_FRONT = 1e-4
# So many nodes may wait: one at each level, of which 6 hold all lights that floats can count.
_LEVELS = 6


@ti.func
def power_heuristic(a, b):
    """Veach's weight, with exponent 2, of a sample of density a that could have been one of density b; or of lanes."""
    ratio = b / a
    return 1.0 / (1.0 + ratio * ratio)


@ti.func
def response(values: Template, row: ti.i32, diffuse_part: ti.f32, depth: ti.i32) -> ti.f32:
    """How much of a light a scattering at the depth-th surface of a path reflects, by the light's multipliers."""
    result = values[row, ON_DIFFUSE] * diffuse_part + values[row, ON_SPECULAR] * (1.0 - diffuse_part)
    if depth > 1:
        result *= values[row, ON_INDIRECT]
    return result


@ti.func
def nearest_light(lights: Template, origin: vec3, direction: vec3, surface_distance: ti.f32):
    """(row, distance) of the light that a ray meets before the surface; row -1 for none."""
    return first_met(lights, -1, origin, direction, surface_distance * (1.0 + LIGHT_FRONT))


@ti.func
def another_blocks(lights: Template, row: ti.i32, origin: vec3, direction: vec3, reach: ti.f32):
    """Whether a ray towards the light of a row meets another one on its way: 1 or 0."""
    blocking, _ = first_met(lights, row, origin, direction, reach)
    return ti.cast(blocking >= 0, ti.i32)


@ti.func
def first_met(lights: Template, but: ti.i32, origin: vec3, direction: vec3, reach: ti.f32):
    """(row, distance) of the light that a ray meets before `reach`, any but that of the row `but`; row -1 for none."""
    nodes = ti.static(lights.nodes)
    row, nearest = -1, reach
    nodes_waiting, members_waiting, waiting = ti.Vector.zero(ti.i32, _LEVELS), ti.Vector.zero(ti.i32, _LEVELS), 0
    solid, node = header(nodes, H_SOLID_COUNT), header(nodes, H_BOXES)
    # A bit for each member of the node that the ray may meet. A lone light's box says no more than the light.
    members = ti.cast(solid == 1 and but != 0, ti.i32)
    entered = solid > 1
    searching = entered or members != 0
    ix, iy, iz, fx, fy, fz, near_x, near_y, near_z = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0, 0, 0
    if entered:
        ix, iy, iz, fx, fy, fz, near_x, near_y, near_z = slabs(direction.x, direction.y, direction.z)
    while searching:
        if entered:
            entered = False
            for eight in range(ti.cast(nodes[node + EIGHTS][0], ti.i32)):
                at = node + EIGHT_ROWS * eight
                near = larger(
                    larger((nodes[at + near_x] - origin.x) * ix, (nodes[at + near_y] - origin.y) * iy),
                    larger((nodes[at + near_z] - origin.z) * iz, float8(0.0)),
                )
                far = smaller(
                    smaller((nodes[at + 3 - near_x] - origin.x) * fx, (nodes[at + 5 - near_y] - origin.y) * fy),
                    smaller((nodes[at + 7 - near_z] - origin.z) * fz, float8(nearest)),
                )
                members |= bits_of(far >= near) << (LANES * eight)
        if members == 0:
            searching = waiting > 0
            if searching:
                waiting -= 1
                node, members = nodes_waiting[waiting], members_waiting[waiting]
        else:
            member = lowest(members)
            members &= members - 1
            child = ti.cast(nodes[node + EIGHT_ROWS * (member >> LANE_BITS) + MEMBER][member & (LANES - 1)], ti.i32)
            if child >= 0:
                if members != 0:
                    nodes_waiting[waiting], members_waiting[waiting] = node, members
                    waiting += 1
                node, members, entered = child, 0, True
            elif -1 - child != but:
                distance = dispatch.intersect(lights, -1 - child, origin, direction)
                if distance < nearest:
                    row, nearest = -1 - child, distance
    return row, nearest


@ti.func
def seen_lights(
    lights: Template,
    textures: Template,
    light: ti.i32,
    instance: ti.i32,
    triangle: ti.i32,
    glow: vec3,
    origin: vec3,
    direction: vec3,
    distance: ti.f32,
    last_vertex: vec3,
    pdf: ti.f32,
    diffuse_part: ti.f32,
    depth: ti.i32,
    mis: ti.i32,
) -> vec3:
    """Radiance from what a path ran into at that distance, weighted against having sampled it from the last vertex: the
    light of a row; else a triangle of an instance, which emits `glow`; else, where both are -1, all lights at infinity.

    diffuse_part: of the scattering there; depth: the number of that surface.
    """
    result = vec3(0.0)
    first, end, from_vertex = light, light + 1, distance
    if light >= 0 or triangle >= 0:
        from_vertex = (origin + direction * distance - last_vertex).norm()
    else:
        first, end = header(lights.nodes, H_DISTANT_ROW), header(lights.nodes, H_PORTAL_ROW)
    if ti.static(lights.with_meshes):
        if triangle >= 0:
            first = emissive_mesh.row_of(lights, instance)
            end = first + 1
            if first < 0:  # it is met alone, not sampled
                first, result = end, glow
    weighed, count, scale = False, 0, 0.0
    weights = ti.Vector.zero(ti.f32, MOST_ENTRIES)
    for row in range(first, end):
        radiance = glow
        if triangle < 0:
            radiance = dispatch.emitted(lights, textures, row, origin, direction, distance, pdf)
        if pdf > 0.0 and radiance.max() > 0.0:
            weight = 0.0  # without MIS, light sampling alone counts
            # A light without shadows is sampled through what is in its way, where no path could run into it.
            if mis != 0 and lights.values[row, SHADOWLESS] == 0.0:
                if not weighed:
                    count, scale, _ = weigh(lights, last_vertex, vec3(0.0), weights, weights, False)
                    weighed = True
                there = dispatch.pdf(lights, weights, count, scale, row, triangle, last_vertex, direction, from_vertex)
                weight = power_heuristic(pdf, there)
            radiance *= weight * response(lights.values, row, diffuse_part, depth)
        result += radiance
    return result
