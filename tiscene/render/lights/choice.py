"""Which light to sample: in proportion to what each would give at a point if nothing stood in between.

Portals are chosen like lamps; other light from infinity counts only where it can come in: in a room with portals, a
sun that shines through none of them is hardly ever chosen. See `tiscene.scene.light_nodes`.
"""

import math

import taichi as ti

from tiscene.render.lights import shaping
from tiscene.render.lights.light_sample import axis, integer
from tiscene.scene.light_nodes import (
    BACK,
    CENTRE,
    CHILD,
    EVEN,
    FEW,
    H_DISTANTS,
    H_DOMES,
    H_LAMPS,
    H_PORTAL_ROW,
    H_PORTALS,
    H_ROWS,
    NORMAL,
    PARENT,
    RADIUS2,
    ROUND,
    ROW,
    SIZE2,
    STRENGTH,
)
from tiscene.scene.light_table import NODE, SHADE_COLUMNS, SHADES

vec3 = ti.math.vec3

# A group is near if its squared distance is below so many times the squared radius of the sphere that holds it.
_NEAR = 1.5
# What a distant light that comes in by no portal counts for: it may come in elsewhere.
_HIDDEN = 1e-6


@ti.func
def node3(nodes: ti.template(), node: ti.i32, column: ti.template()) -> vec3:
    """Three columns of a node."""
    return vec3(nodes[node, column], nodes[node, column + 1], nodes[node, column + 2])


@ti.func
def given(lights: ti.template(), node: ti.i32, origin: vec3) -> ti.f32:
    """About the irradiance of a light or group that has a place on a surface at `origin` that faces it."""
    nodes = ti.static(lights.nodes)
    offset = node3(nodes, node, CENTRE) - origin
    distance2 = offset.dot(offset) + 1e-12
    distance = ti.sqrt(distance2)
    height = offset.dot(node3(nodes, node, NORMAL))
    back = nodes[node, BACK]
    other = -back * height
    facing = nodes[node, ROUND] * distance + ti.select(height > other, height, other)
    result = nodes[node, STRENGTH] * facing / (distance * (distance2 + nodes[node, SIZE2]))
    if back < 0.0:
        row = integer(nodes, node, ROW)
        cosine = offset.dot(axis(lights.values, row, 2)) / distance
        result = ti.max(result, 0.0) * shaping.in_cone(lights.values, row, cosine)
    return result


@ti.func
def is_near(nodes: ti.template(), node: ti.i32, origin: vec3):
    """Whether a group is so near for its size that from its middle one cannot tell what it gives: 1 or 0."""
    offset = node3(nodes, node, CENTRE) - origin
    return ti.cast(offset.dot(offset) < _NEAR * nodes[node, RADIUS2], ti.i32)


@ti.func
def affine(array: ti.template(), at: ti.i32, p: vec3) -> ti.f32:
    """Of a point, by four numbers."""
    return array[at] * p.x + array[at + 1] * p.y + array[at + 2] * p.z + array[at + 3]


@ti.func
def comes_in(lights: ti.template(), node: ti.i32, origin: vec3):
    """Whether a distant light shines on the point through a portal: 1 or 0; of a group of them 1."""
    result = 1
    row = integer(lights.nodes, node, ROW)
    if row >= 0:
        at = integer(lights.values, row, SHADES)
        if at >= 0:
            shades = ti.static(lights.distribution)
            result = 0
            for _ in range(integer(lights.nodes, 0, H_ROWS) - integer(lights.nodes, 0, H_PORTAL_ROW)):
                across = affine(shades, at, origin)
                along = affine(shades, at + 4, origin)
                result |= ti.cast(ti.max(ti.abs(across), ti.abs(along)) <= 1.0, ti.i32)
                at += SHADE_COLUMNS
    return result


@ti.func
def weigh(lights: ti.template(), origin: vec3, cut: ti.template(), weights: ti.template()):
    """The nodes that a choice from a point looks at to `cut`, and to `weights` what each gives there.

    Returns (how many, by what to multiply a weight for the node's chance, but for the even part). `cut` and `weights`
    have room for MOST_ENTRIES. Of lights with a place it is the entries, or as long as there is room, the members of
    groups that are near for their size.
    A sun that is behind a portal counts there as well: few points are, and it does no harm.
    """
    nodes = ti.static(lights.nodes)
    total, even, through_portals = 0.0, 0.0, 0.0
    portals, distants = integer(nodes, 0, H_LAMPS), integer(nodes, 0, H_PORTALS)
    domes, end = integer(nodes, 0, H_DISTANTS), integer(nodes, 0, H_DOMES)
    count = 0
    if end > 2 or nodes[1, CHILD] > 0.0:
        for node in range(1, portals):
            cut[node - 1] = node
        count = portals - 1
        k = 0
        while k < count:
            node = cut[k]
            child = integer(nodes, node, CHILD)
            if child > 0 and count < FEW and is_near(nodes, node, origin) != 0:
                # The nearer one is gone into first: there the room is needed.
                a, b = node3(nodes, child, CENTRE) - origin, node3(nodes, child + 1, CENTRE) - origin
                second = ti.cast(b.dot(b) < a.dot(a), ti.i32)
                cut[k] = child + second
                cut[count] = child + 1 - second
                count += 1
            else:
                here = given(lights, node, origin)
                weights[k] = here
                total += here
                even += ti.select(here > 0.0, nodes[node, EVEN], 0.0)
                k += 1
        for node in range(portals, end):
            here = 0.0
            if node < distants:
                here = given(lights, node, origin)
                through_portals += here
            elif node < domes:
                here = given(lights, node, origin)
                if through_portals > 0.0 and comes_in(lights, node, origin) == 0:
                    here *= _HIDDEN
            elif nodes[node, ROUND] > 0.0 or through_portals == 0.0:
                here = math.pi * nodes[node, STRENGTH]
            else:
                here = nodes[node, SIZE2] * through_portals
            cut[count], weights[count] = node, here
            count += 1
            total += here
            even += ti.select(here > 0.0, nodes[node, EVEN], 0.0)
    return count, (1.0 - even) / total if total > 0.0 else 0.0


@ti.func
def choose(
    lights: ti.template(),
    cut: ti.template(),
    weights: ti.template(),
    count: ti.i32,
    scale: ti.f32,
    origin: vec3,
    u: ti.f32,
):
    """(row, its chance, what is left of u) of the light or portal to sample from a point; chance 0 for none.

    cut ... scale: `weigh`.
    """
    nodes = ti.static(lights.nodes)
    node, chance, low = 1, 1.0, 0.0
    if count > 0:
        reached = 0.0
        chance = 0.0
        for k in range(count):
            here = ti.select(weights[k] > 0.0, weights[k] * scale + nodes[cut[k], EVEN], 0.0)
            taken = (u >= reached) & (here > 0.0)
            node, chance = ti.select(taken, cut[k], node), ti.select(taken, here, chance)
            low = ti.select(taken, reached, low)
            reached += here
        if u >= reached:  # nothing gives light there, as far as one can tell
            chance = 0.0
    rest = ti.min((u - low) / ti.max(chance, 1e-20), 0.99999994)
    node, chance, rest = member(lights, node, chance, rest, origin)
    return integer(nodes, node, ROW), chance, rest


@ti.func
def member(lights: ti.template(), group: ti.i32, group_chance: ti.f32, u: ti.f32, origin: vec3):
    """(node, its chance, what is left of u) of one light of a group by what each gives; a light is its own group."""
    nodes = ti.static(lights.nodes)
    node, chance, rest = group, group_chance, u
    child = integer(nodes, node, CHILD)
    while child > 0:
        share = share_of_first(lights, child, origin)
        node = child
        if rest < share:
            rest /= share
        else:
            node = child + 1
            rest = ti.min((rest - share) / (1.0 - share), 0.99999994)
            share = 1.0 - share
        chance *= share
        child = integer(nodes, node, CHILD)
    return node, chance, rest


@ti.func
def share_of_first(lights: ti.template(), child: ti.i32, origin: vec3) -> ti.f32:
    """Of what the two members of a group give, the part of the first."""
    a, b = given(lights, child, origin), given(lights, child + 1, origin)
    return a / (a + b) if a + b > 0.0 else 0.5


@ti.func
def share_of(lights: ti.template(), node: ti.i32, parent: ti.i32, origin: vec3) -> ti.f32:
    """Of what a group gives, the part of one of its two members."""
    child = integer(lights.nodes, parent, CHILD)
    share = share_of_first(lights, child, origin)
    return share if node == child else 1.0 - share


@ti.func
def chance_of(
    lights: ti.template(),
    cut: ti.template(),
    weights: ti.template(),
    count: ti.i32,
    scale: ti.f32,
    row: ti.i32,
    origin: vec3,
) -> ti.f32:
    """The chance with which `choose` picks the row."""
    nodes = ti.static(lights.nodes)
    node, part, found = integer(lights.values, row, NODE), 1.0, 0.0
    if count == 0:
        found = 1.0
        node = 0
    while node > 0:
        for k in range(count):
            if cut[k] == node:
                found = ti.select(weights[k] > 0.0, weights[k] * scale + nodes[node, EVEN], 0.0)
                node = 0
        if node > 0:
            parent = integer(nodes, node, PARENT)
            part *= share_of(lights, node, parent, origin)
            node = parent
    return part * found
