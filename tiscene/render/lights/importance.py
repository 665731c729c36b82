# SPDX-License-Identifier: Apache-2.0
"""About how much each light gives at a point, if nothing stands in between: see `tiscene.scene.lights.light_tree`.

Portals give light like lamps; other light from infinity counts only where it can come in: in a room with portals, a
sun that shines through none of them is hardly ever chosen.
"""

import math

import taichi as ti

from tiscene.device.kernel_types import Template, float8, vec3
from tiscene.render.intersect.bvh8 import bits_of
from tiscene.render.lights import emission_profile
from tiscene.render.lights.lane_ops import eight, lowest, total_of
from tiscene.render.lights.light_sample import attribute, axis, header, integer, of_member, of_node, row_at
from tiscene.scene.lights.light_table import SHADE_COLUMNS, SHADES
from tiscene.scene.lights.light_tree import (
    BACK,
    CENTRE,
    CHILD,
    CONES,
    COUNT,
    EVEN,
    EXTENT,
    GROUPS,
    H_CHOICE,
    H_DISTANTS,
    H_DOMES,
    H_LAMPS,
    H_NODES,
    H_PLACED_NODES,
    H_PORTAL_ROW,
    H_PORTALS,
    H_ROWS,
    LANES,
    NORMAL,
    ROUND,
    ROW,
    SIZE2,
    SPREAD2,
    STRENGTH,
)

# What a distant light that comes in by no portal counts for: it may come in elsewhere.
_HIDDEN = 1e-6
# The least cosine with which a surface is thought to see a light: it may be glossy, or larger than its middle.
_LEAST_COSINE = 0.05
# A group is near if its squared distance is below so many times its squared spread: then what its members give is
# summed up, by which the worst of the noise is halved.
_NEAR = 4.0


@ti.func
def of_entry(nodes: Template, entry: ti.i32, which: Template) -> ti.f32:
    """One attribute of an entry; entries are counted from 0."""
    return of_member(nodes, LANES + entry, which)


@ti.func
def towards(nodes: Template, node: ti.i32, origin: vec3):
    """(x, y, z) from a point to the center of each member of a node."""
    x = attribute(nodes, node, CENTRE) - origin.x
    y = attribute(nodes, node, CENTRE + 1) - origin.y
    z = attribute(nodes, node, CENTRE + 2) - origin.z
    return x, y, z


@ti.func
def given(lights: Template, node: ti.i32, origin: vec3) -> float8:
    """About the irradiance of each member of a node on a surface at `origin` that faces it."""
    nodes = ti.static(lights.nodes)
    x, y, z = towards(nodes, node, origin)
    distance2 = x * x + y * y + z * z + 1e-12
    distance = ti.sqrt(distance2)
    height = x * attribute(nodes, node, NORMAL)
    height += y * attribute(nodes, node, NORMAL + 1)
    height += z * attribute(nodes, node, NORMAL + 2)
    facing = attribute(nodes, node, ROUND) * distance + ti.max(height, -1.0 * attribute(nodes, node, BACK) * height)
    apart2 = ti.max(distance2 + attribute(nodes, node, SIZE2), attribute(nodes, node, SPREAD2))
    result = ti.max(attribute(nodes, node, STRENGTH) * facing / (distance * apart2), 0.0)
    if of_node(nodes, node, CONES) > 0.0:
        within = ti.Vector.one(ti.f32, LANES)
        count = ti.cast(of_node(nodes, node, COUNT), ti.i32)
        for k in range(count):  # no number that LLVM knows: it would unroll the loop
            if of_member(nodes, LANES * node + k, BACK) < 0.0:
                row = row_at(nodes, LANES * node + k)
                offset = axis(lights.values, row, 3) - origin
                cosine = offset.dot(axis(lights.values, row, 2)) / ti.max(offset.norm(), 1e-9)
                within[k] = emission_profile.in_cone(lights.values, row, cosine)
        result *= within
    return result


@ti.func
def seen_by(nodes: Template, node: ti.i32, origin: vec3, normal: vec3) -> float8:
    """About the cosine at which a surface of a normal sees each member, a large one its nearer part; without a normal
    (0, 0, 0) 1."""
    x, y, z = towards(nodes, node, origin)
    distance = ti.sqrt(x * x + y * y + z * z + 1e-12)
    extent = attribute(nodes, node, EXTENT)
    cosine = (x * normal.x + y * normal.y + z * normal.z + extent) / (distance + extent)
    least = _LEAST_COSINE if normal.dot(normal) > 0.0 else 1.0
    return ti.min(ti.max(cosine, least), 1.0)


@ti.func
def affine(array: Template, at: ti.i32, p: vec3) -> ti.f32:
    """Of a point, by four numbers."""
    return array[at] * p.x + array[at + 1] * p.y + array[at + 2] * p.z + array[at + 3]


@ti.func
def comes_in(lights: Template, entry: ti.i32, origin: vec3):
    """Whether a distant light shines on the point through a portal: 1 or 0; of a group of them 1."""
    result = 1
    row = ti.cast(of_entry(lights.nodes, entry, ROW), ti.i32)
    if row >= 0:
        at = integer(lights.values, row, SHADES)
        if at >= 0:
            shades = ti.static(lights.distribution)
            result = 0
            for _ in range(header(lights.nodes, H_ROWS) - header(lights.nodes, H_PORTAL_ROW)):
                across = affine(shades, at, origin)
                along = affine(shades, at + 4, origin)
                result |= ti.cast(ti.max(ti.abs(across), ti.abs(along)) <= 1.0, ti.i32)
                at += SHADE_COLUMNS
    return result


@ti.func
def from_afar(lights: Template, origin: vec3, weights: Template, faced: Template, faces: Template):
    """What distant lights and domes give, by what comes in through portals, as `weigh`.

    A sun that is behind a portal counts there as well: few points are, and it does no harm.
    """
    nodes = ti.static(lights.nodes)
    portals, distants = header(nodes, H_LAMPS), header(nodes, H_PORTALS)
    domes, end = header(nodes, H_DISTANTS), header(nodes, H_DOMES)
    through_portals = 0.0
    for entry in range(portals, distants):
        through_portals += weights[entry]
    if through_portals > 0.0:
        for entry in range(distants, domes):
            if comes_in(lights, entry, origin) == 0:
                weights[entry] *= _HIDDEN
                if ti.static(faces):
                    faced[entry] *= _HIDDEN
    for entry in range(domes, end):
        if of_entry(nodes, entry, ROUND) > 0.0 or through_portals == 0.0:
            weights[entry] = math.pi * of_entry(nodes, entry, STRENGTH)
        else:
            weights[entry] = of_entry(nodes, entry, SIZE2) * through_portals
        if ti.static(faces):
            faced[entry] = weights[entry]


@ti.func
def near_groups(nodes: Template, node: ti.i32, origin: vec3) -> ti.i32:
    """A bit for each member of a node that is a group and near."""
    x, y, z = towards(nodes, node, origin)
    return bits_of(_NEAR * attribute(nodes, node, SPREAD2) >= x * x + y * y + z * z + 1e-12)


@ti.func
def weigh(
    lights: Template,
    origin: vec3,
    normal: vec3,
    weights: Template,
    faced: Template,
    faces: Template,
):
    """What every entry gives at a point to a surface that faces it, to `weights`, and if `faces` to one of a normal, to
    `faced`; both have room for MOST_ENTRIES.

    Returns (how many nodes of entries there are to choose from, 0 where there is nothing to choose; by what to multiply
    weights, and faced ones, for entries' chances, but for the even part).
    """
    nodes = ti.static(lights.nodes)
    count, scale, faced_scale = 0, 0.0, 0.0
    if of_node(nodes, 0, H_CHOICE) > 0.0:
        count = header(nodes, H_NODES)
        done, near, end = 0, 0, header(nodes, H_PLACED_NODES)
        while near > 0 or done < end:
            node, opened = 1 + done, -1
            if near > 0:
                opened = lowest(near)
                near &= near - 1
                node = ti.cast(of_member(nodes, LANES * done + opened, CHILD), ti.i32)
            here = given(lights, node, origin)
            if opened >= 0:
                at = LANES * (done - 1) + opened
                shines = weights[at] > 0.0
                weights[at] = total_of(here) if shines else 0.0
                if ti.static(faces):
                    faced[at] = total_of(here * seen_by(nodes, node, origin, normal)) if shines else 0.0
            else:
                for lane in ti.static(range(LANES)):
                    weights[LANES * done + lane] = here[lane]
                if ti.static(faces):
                    here *= seen_by(nodes, node, origin, normal)
                    for lane in ti.static(range(LANES)):
                        faced[LANES * done + lane] = here[lane]
                done += 1
                if of_node(nodes, done, GROUPS) > 0.0:
                    near = near_groups(nodes, done, origin)
        if header(nodes, H_DOMES) > header(nodes, H_LAMPS):
            from_afar(lights, origin, weights, faced, faces)
        total, faced_total, even = 0.0, 0.0, 0.0
        for k in range(count):
            here = eight(weights, k)
            total += total_of(here)
            even += total_of(ti.select(here > 0.0, attribute(nodes, 1 + k, EVEN), 0.0))
            if ti.static(faces):
                faced_total += total_of(eight(faced, k))
        scale = (1.0 - even) / total if total > 0.0 else 0.0
        if ti.static(faces):
            faced_scale = (1.0 - even) / faced_total if faced_total > 0.0 else 0.0
    return count, scale, faced_scale
