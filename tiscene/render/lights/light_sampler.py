# SPDX-License-Identifier: Apache-2.0
"""Choosing a light from the light tree, in proportion to the estimated contributions of `importance`."""

import taichi as ti

from tiscene.device.kernel_types import Template, float8, vec2, vec3
from tiscene.render.intersect.surface_interaction import transform_point
from tiscene.render.lights.importance import cosine_estimates, entry_value, irradiance_estimates
from tiscene.render.lights.lane_ops import lane_value, load_lanes, select_lane, sum_lanes
from tiscene.render.lights.light_sample import header, integer, light_row, node_lanes, node_value, slot_value
from tiscene.scene.lights.light_kinds import MESH
from tiscene.scene.lights.light_table import INSTANCE, KIND, SLOT, TREE
from tiscene.scene.lights.light_tree import CHILD, COUNT, H_ENTRY_NODES, H_FINITE_END, LANE_BITS, LANES, PARENT, UNIFORM
from tiscene.scene.placement import CURRENT

_ONE_MINUS_EPSILON = 0.99999994


@ti.func
def to_mesh_space(lights: Template, row: ti.i32, p: vec3) -> vec3:
    """Transform a point to the object space of an emissive mesh."""
    return transform_point(lights.geometry.instance_from_world, CURRENT, integer(lights.values, row, INSTANCE), p)


@ti.func
def child_weights(lights: Template, node: ti.i32, origin: vec3) -> float8:
    """Return the irradiance estimates of a node's children; 1 for each if all are 0."""
    result = irradiance_estimates(lights, node, origin)
    if sum_lanes(result) <= 0.0:
        for k in ti.static(range(LANES)):
            result[k] = ti.select(k < node_value(lights.nodes, node, COUNT), 1.0, 0.0)
    return result


@ti.func
def descend(lights: Template, entry: ti.i32, entry_probabilities: vec2, u: ti.f32, origin: vec3, normal: vec3):
    """Choose a light below an entry, and of an emissive mesh a triangle.

    Args:
        lights: LightTables.
        entry: Slot of the entry.
        entry_probabilities: Its two probabilities, as `choose_light` returns them for the light.
        u: Uniform in [0, 1).
        origin: Shading point.
        normal: Surface normal there, or zero.

    Returns:
        (row, slot, probabilities, what is left of u), as `choose_light`.
    """
    nodes = ti.static(lights.nodes)
    row, slot, probabilities, rest, p = -1, entry, entry_probabilities, u, origin
    node = 0
    faces = entry - LANES < header(nodes, H_FINITE_END)
    arrived = False
    while not arrived:
        node = ti.cast(slot_value(nodes, slot, CHILD), ti.i32)
        if node == 0 and row < 0:
            row = light_row(nodes, slot)
            if ti.static(lights.with_meshes):
                if integer(lights.values, row, KIND) == MESH:
                    node = integer(lights.values, row, TREE)
                    p = to_mesh_space(lights, row, origin)
                    faces = False
        arrived = node == 0
        if not arrived:
            weights = child_weights(lights, node, p)
            faced = weights
            if faces:
                faced *= cosine_estimates(nodes, node, p, normal)
            total = sum_lanes(faced)
            target = rest * total
            lane, here, low = select_lane(faced, target)
            rest = ti.min((target - low) / here, _ONE_MINUS_EPSILON)
            probabilities *= vec2(here / total, lane_value(weights, lane) / sum_lanes(weights))
            slot = LANES * node + lane
    return row, slot, probabilities, rest


@ti.func
def choose_light(lights: Template, entries: Template, origin: vec3, normal: vec3, u: ti.f32):
    """Choose the light or portal to sample.

    Args:
        lights: LightTables.
        entries: EntryWeights.
        origin: Shading point.
        normal: Surface normal there, or zero.
        u: Uniform in [0, 1).

    Returns:
        (row, slot, probabilities, u'). slot: of the light, or of an emissive mesh's triangle. probabilities: that this
        light or triangle is chosen, for the normal, and for a surface that faces every light; 0 for none.
        u': what is left of u, uniform in [0, 1) again; neighboring u choose one light and are neighbors again.
    """
    nodes = ti.static(lights.nodes)
    entry, probabilities, rest = 0, vec2(1.0), u
    if entries.count > 0:
        before, probability = 0.0, 0.0
        for k in range(entries.count):
            here = load_lanes(entries.faced, k)
            here = ti.select(here > 0.0, here * entries.faced_scale + node_lanes(nodes, 1 + k, UNIFORM), 0.0)
            lane, lane_probability, low = select_lane(here, u - before)
            if lane_probability > 0.0 and u >= before:
                entry, probability, rest = LANES * k + lane, lane_probability, u - before - low
            before += sum_lanes(here)
        rest = ti.min(rest / ti.max(probability, 1e-20), _ONE_MINUS_EPSILON)
        uniform = entry_value(nodes, entry, UNIFORM)
        probabilities = vec2(probability, entries.weights[entry] * entries.scale + uniform)
    return descend(lights, LANES + entry, probabilities, rest, origin, normal)


@ti.func
def conditional_probability(lights: Template, slot: ti.i32, origin: vec3):
    """Return (slot of the entry above a slot, probability of the slot given its entry); entry 0 for a triangle."""
    nodes = ti.static(lights.nodes)
    entries = header(nodes, H_ENTRY_NODES)
    here, part = slot, 1.0
    while here >> LANE_BITS > entries:
        node = here >> LANE_BITS
        weights = child_weights(lights, node, origin)
        part *= lane_value(weights, here & (LANES - 1)) / sum_lanes(weights)
        here = ti.cast(node_value(nodes, node, PARENT), ti.i32)
    return here, part


@ti.func
def light_probabilities(lights: Template, entries: Template, row: ti.i32, origin: vec3) -> vec2:
    """Return the probabilities with which `choose_light` chooses a light.

    The first, for the normal, is valid for domes and portals alone. Arguments as for `choose_light`.
    """
    result = vec2(1.0)
    if entries.count > 0:
        slot, part = conditional_probability(lights, integer(lights.values, row, SLOT), origin)
        entry = slot - LANES
        result = vec2(0.0)
        if entries.weights[entry] > 0.0:
            scaled = vec2(entries.faced[entry] * entries.faced_scale, entries.weights[entry] * entries.scale)
            result = part * (scaled + entry_value(lights.nodes, entry, UNIFORM))
    return result
