# SPDX-License-Identifier: Apache-2.0
"""Intersection of rays with lights, and their emission weighted by multiple importance sampling.

Lights are intersected separately from the scene BVH, for shadow rays as well: a light occludes what is behind it in
every kind of path.
"""

import taichi as ti

from tiscene.device.kernel_types import Template, float8, vec3
from tiscene.render.intersect.bvh8 import fast_max, fast_min, mask_bits, slabs
from tiscene.render.lights import dispatch, emissive_mesh
from tiscene.render.lights.importance import EntryWeights, weigh_entries
from tiscene.render.lights.lane_ops import lowest_set_bit
from tiscene.render.lights.light_sample import header, is_linked
from tiscene.scene.lights.light_bvh import BLOCK_ROWS, BLOCKS, REFERENCE
from tiscene.scene.lights.light_table import (
    ON_DIFFUSE,
    ON_INDIRECT,
    ON_SPECULAR,
    SHADOWING,
    SHADOWLESS,
    UNSEEN,
)
from tiscene.scene.lights.light_tree import (
    H_AREA_COUNT,
    H_BVH_ROW,
    H_DISTANT_ROW,
    H_PORTAL_ROW,
    LANE_BITS,
    LANES,
    MAX_ENTRIES,
)

# Lights win over surfaces up to this fraction of the distance in front of them: a light may lie on a surface.
LIGHT_FRONT = 1e-4
# Which emission counts that paths find, as `mis`: none of lights that can be sampled, for tests; all, by multiple
# importance sampling; all, but of surfaces that are not in the table only what the camera or a mirror sees; what this
# leaves out, given a table of those surfaces.
SAMPLED, WEIGHTED, MIRRORED, SCATTERED = range(4)
# Stack size: one node at each level. Six levels hold more lights than float32 can number.
_LEVELS = 6


@ti.func
def power_heuristic(a, b):
    """Return the MIS weight of a sample of density a against density b (Veach, exponent 2); scalars or lanes."""
    ratio = b / a
    return 1.0 / (1.0 + ratio * ratio)


@ti.func
def response(values: Template, row: ti.i32, diffuse_part: ti.f32, depth: ti.i32) -> ti.f32:
    """Return the factor of a light's contribution by its diffuse, specular and indirect multipliers.

    diffuse_part: fraction of the scattered light from the diffuse lobe; depth: number of the surface on the path.
    """
    result = values[row, ON_DIFFUSE] * diffuse_part + values[row, ON_SPECULAR] * (1.0 - diffuse_part)
    if depth > 1:
        result *= values[row, ON_INDIRECT]
    return result


@ti.func
def nearest_light(lights: Template, depth: ti.i32, origin: vec3, direction: vec3, surface_distance: ti.f32):
    """Return (row, distance) of the light that a ray hits before the surface; row -1 for none.

    depth: number of surfaces on the path so far. At 0, the ray passes through lights that the camera does not see.
    """
    reach = surface_distance * (1.0 + LIGHT_FRONT)
    return nearest_intersected(lights, -1, ti.cast(depth == 0, ti.i32), origin, direction, reach)


@ti.func
def is_blocked_by_light(lights: Template, row: ti.i32, origin: vec3, direction: vec3, reach: ti.f32):
    """Return 1 if a ray towards the light in a row hits another light on its way, else 0."""
    blocking, _ = nearest_intersected(lights, row, 0, origin, direction, reach)
    return ti.cast(blocking >= 0, ti.i32)


@ti.func
def nearest_intersected(
    lights: Template, excluded: ti.i32, from_camera: ti.i32, origin: vec3, direction: vec3, reach: ti.f32
):
    """Return (row, distance) of the nearest light before `reach`, except the one in row `excluded`; row -1 for none.

    from_camera: 1 passes through lights that the camera does not see.
    """
    nodes = ti.static(lights.nodes)
    row, nearest = -1, reach
    node_stack, child_stack, stack_size = ti.Vector.zero(ti.i32, _LEVELS), ti.Vector.zero(ti.i32, _LEVELS), 0
    area_lights, node = header(nodes, H_AREA_COUNT), header(nodes, H_BVH_ROW)
    # A bit for each child of the node whose box the ray hits. The box of a single light is not tested.
    children = ti.cast(area_lights == 1 and excluded != 0, ti.i32)
    entered = area_lights > 1
    searching = entered or children != 0
    ix, iy, iz, fx, fy, fz, near_x, near_y, near_z = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0, 0, 0
    if entered:
        ix, iy, iz, fx, fy, fz, near_x, near_y, near_z = slabs(direction.x, direction.y, direction.z)
    while searching:
        if entered:
            entered = False
            for block in range(ti.cast(nodes[node + BLOCKS][0], ti.i32)):
                at = node + BLOCK_ROWS * block
                near = fast_max(
                    fast_max((nodes[at + near_x] - origin.x) * ix, (nodes[at + near_y] - origin.y) * iy),
                    fast_max((nodes[at + near_z] - origin.z) * iz, float8(0.0)),
                )
                far = fast_min(
                    fast_min((nodes[at + 3 - near_x] - origin.x) * fx, (nodes[at + 5 - near_y] - origin.y) * fy),
                    fast_min((nodes[at + 7 - near_z] - origin.z) * fz, float8(nearest)),
                )
                children |= mask_bits(far >= near) << (LANES * block)
        if children == 0:
            searching = stack_size > 0
            if searching:
                stack_size -= 1
                node, children = node_stack[stack_size], child_stack[stack_size]
        else:
            lane = lowest_set_bit(children)
            children &= children - 1
            child = ti.cast(nodes[node + BLOCK_ROWS * (lane >> LANE_BITS) + REFERENCE][lane & (LANES - 1)], ti.i32)
            if child >= 0:
                if children != 0:
                    node_stack[stack_size], child_stack[stack_size] = node, children
                    stack_size += 1
                node, children, entered = child, 0, True
            elif -1 - child != excluded and (from_camera == 0 or lights.values[-1 - child, UNSEEN] == 0.0):
                distance = dispatch.intersect(lights, -1 - child, origin, direction)
                if distance < nearest:
                    row, nearest = -1 - child, distance
    return row, nearest


@ti.func
def weighted_emission(
    lights: Template,
    textures: Template,
    light: ti.i32,
    instance: ti.i32,
    triangle: ti.i32,
    emission: vec3,
    origin: vec3,
    direction: vec3,
    distance: ti.f32,
    last_vertex: vec3,
    pdf: ti.f32,
    diffuse_part: ti.f32,
    depth: ti.i32,
    mis: ti.i32,
    link_class: ti.i32,
) -> vec3:
    """Return the emission at a path's vertex, weighted against having sampled it from the last vertex.

    Args:
        lights: LightTables.
        textures: Textures.
        light: Row of the light that was hit; -1 for none.
        instance: Else, the instance that was hit.
        triangle: Else, the triangle of that instance; -1 for none: then all lights at infinity count.
        emission: Radiance that the triangle emits.
        origin: Of the ray, m.
        direction: Of the ray, unit.
        distance: Along the ray, m.
        last_vertex: Vertex from which a light was sampled; differs from `origin` behind alpha-rejected surfaces.
        pdf: Density of the direction by the BSDF there, 1/sr; 0 for camera rays and delta lobes: the weight is 1.
        diffuse_part: Fraction of the scattering there that is diffuse.
        depth: Number of that surface on the path.
        mis: Which emission counts: SAMPLED, WEIGHTED, MIRRORED or SCATTERED.
        link_class: Of the mesh at the last vertex, if lights have links: lights that are not linked to it add nothing.
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
            if first < 0:  # not in the light table, so never sampled
                first = end
                if mis < MIRRORED or (mis == MIRRORED and pdf == 0.0):
                    result = emission
    is_weighed, count, scale = False, 0, 0.0
    weights = ti.Vector.zero(ti.f32, MAX_ENTRIES)
    for row in range(first, end):
        radiance = emission
        if triangle < 0:
            radiance = dispatch.emitted(lights, textures, row, origin, direction, distance, pdf)
            if depth == 0 and lights.values[row, UNSEEN] > 0.0:  # a light at infinity; others are not hit
                radiance = vec3(0.0)
        is_sampled_alone = mis == SAMPLED
        if ti.static(lights.with_links):
            if depth > 0 and is_linked(lights, row, link_class) == 0:
                radiance = vec3(0.0)
            is_sampled_alone = is_sampled_alone or lights.values[row, SHADOWING] >= 0.0
        if pdf > 0.0 and radiance.max() > 0.0:
            weight = 0.0  # without MIS, light sampling alone counts
            # A light without shadows is sampled through occluders, where no BSDF sample reaches it.
            if not is_sampled_alone and lights.values[row, SHADOWLESS] == 0.0:
                if not is_weighed:
                    count, scale, _ = weigh_entries(lights, last_vertex, vec3(0.0), weights, weights, False)
                    is_weighed = True
                entries = ti.static(EntryWeights(weights, weights, count, scale, scale))
                light_pdf = dispatch.pdf(lights, entries, row, triangle, last_vertex, direction, from_vertex)
                weight = power_heuristic(pdf, light_pdf)
            radiance *= weight * response(lights.values, row, diffuse_part, depth)
        result += radiance
    if mis == SCATTERED and pdf == 0.0:
        result = vec3(0.0)
    return result
