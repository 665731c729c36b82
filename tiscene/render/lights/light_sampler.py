# SPDX-License-Identifier: Apache-2.0
"""Which light to sample: in proportion to what each gives at a point, see `weights`, to a surface as it faces them."""

import taichi as ti

from tiscene.device.kernel_types import Template, float8, vec2, vec3
from tiscene.render.intersect.surface_interaction import transform_point
from tiscene.render.lights.importance import given, of_entry, seen_by
from tiscene.render.lights.lane_ops import eight, lane_of, picked, total_of
from tiscene.render.lights.light_sample import attribute, header, integer, of_member, of_node, row_at
from tiscene.scene.lights.light_table import INSTANCE, KIND, MESH, NODE, TREE
from tiscene.scene.lights.light_tree import CHILD, COUNT, EVEN, H_LAMPS, H_NODES, LANE_BITS, LANES, PARENT
from tiscene.scene.placement import CURRENT

_BELOW_1 = 0.99999994


@ti.func
def in_mesh(lights: Template, row: ti.i32, p: vec3) -> vec3:
    """A point in the space of the mesh that is a light."""
    return transform_point(lights.geometry.instance_from_world, CURRENT, integer(lights.values, row, INSTANCE), p)


@ti.func
def shares(lights: Template, node: ti.i32, origin: vec3) -> float8:
    """What each member of a node gives at a point, or 1 if none gives anything."""
    result = given(lights, node, origin)
    if total_of(result) <= 0.0:
        for k in ti.static(range(LANES)):
            result[k] = ti.select(k < of_node(lights.nodes, node, COUNT), 1.0, 0.0)
    return result


@ti.func
def member(lights: Template, entry: ti.i32, entry_chances: vec2, u: ti.f32, origin: vec3, normal: vec3):
    """(row, its place, its chances, what is left of u) of one light of an entry by what each gives, and of one of its
    triangles. Chances: of being chosen, and were the surface to face every light."""
    nodes = ti.static(lights.nodes)
    row, place, chances, rest, p = -1, entry, entry_chances, u, origin
    node = 0
    faces = entry - LANES < header(nodes, H_LAMPS)
    arrived = False
    while not arrived:
        node = ti.cast(of_member(nodes, place, CHILD), ti.i32)
        if node == 0 and row < 0:
            row = row_at(nodes, place)
            if ti.static(lights.with_meshes):
                if integer(lights.values, row, KIND) == MESH:
                    node = integer(lights.values, row, TREE)
                    p = in_mesh(lights, row, origin)
                    faces = False
        arrived = node == 0
        if not arrived:
            weights = shares(lights, node, p)
            faced = weights
            if faces:
                faced *= seen_by(nodes, node, p, normal)
            total = total_of(faced)
            aim = rest * total
            lane, here, low = picked(faced, aim)
            rest = ti.min((aim - low) / here, _BELOW_1)
            chances *= vec2(here / total, lane_of(weights, lane) / total_of(weights))
            place = LANES * node + lane
    return row, place, chances, rest


@ti.func
def choose(
    lights: Template,
    weights: Template,
    faced: Template,
    count: ti.i32,
    scale: ti.f32,
    faced_scale: ti.f32,
    origin: vec3,
    normal: vec3,
    u: ti.f32,
):
    """(row, its place, its chances, a number) of the light or portal to sample from a point; chances 0 for none.

    Chances: of being chosen, and were the surface to face every light. The number is what is left of u, uniform in
    [0, 1) again: neighbors in u choose one light and are neighbors there. Of a mesh the place is that of a triangle,
    and so are the chances. weights ... faced_scale: `weigh`.
    """
    nodes = ti.static(lights.nodes)
    entry, chances, rest = 0, vec2(1.0), u
    if count > 0:
        before, chance = 0.0, 0.0
        for k in range(count):
            here = eight(faced, k)
            here = ti.select(here > 0.0, here * faced_scale + attribute(nodes, 1 + k, EVEN), 0.0)
            lane, lane_chance, low = picked(here, u - before)
            if lane_chance > 0.0 and u >= before:
                entry, chance, rest = LANES * k + lane, lane_chance, u - before - low
            before += total_of(here)
        rest = ti.min(rest / ti.max(chance, 1e-20), _BELOW_1)
        chances = vec2(chance, weights[entry] * scale + of_entry(nodes, entry, EVEN))
    return member(lights, LANES + entry, chances, rest, origin, normal)


@ti.func
def part_of(lights: Template, place: ti.i32, origin: vec3):
    """(the place of the entry that a member is below, its part of the entry's chance); place 0 for a mesh's member."""
    nodes = ti.static(lights.nodes)
    entries = header(nodes, H_NODES)
    here, part = place, 1.0
    while here >> LANE_BITS > entries:
        node = here >> LANE_BITS
        weights = shares(lights, node, origin)
        part *= lane_of(weights, here & (LANES - 1)) / total_of(weights)
        here = ti.cast(of_node(nodes, node, PARENT), ti.i32)
    return here, part


@ti.func
def chances_of(
    lights: Template,
    weights: Template,
    faced: Template,
    count: ti.i32,
    scale: ti.f32,
    faced_scale: ti.f32,
    row: ti.i32,
    origin: vec3,
) -> vec2:
    """The chances with which `choose` picks the row: for a surface of the normal (of domes and portals only) and
    for one that faces every light. weights ... faced_scale: `weigh`."""
    result = vec2(1.0)
    if count > 0:
        place, part = part_of(lights, integer(lights.values, row, NODE), origin)
        entry = place - LANES
        result = vec2(0.0)
        if weights[entry] > 0.0:
            result = part * (
                vec2(faced[entry] * faced_scale, weights[entry] * scale) + of_entry(lights.nodes, entry, EVEN)
            )
    return result
