"""Which light to sample: in proportion to what each would give at a point if nothing stood in between.

Portals are chosen like lamps; other light from infinity counts only where it can come in: in a room with portals, a
sun that shines through none of them is hardly ever chosen. See `tiscene.scene.light_nodes`.
"""

import math

import taichi as ti

from tiscene.render.lights import shaping
from tiscene.render.lights.light_sample import (
    Floats2,
    LightNodes,
    Lights,
    attribute,
    axis,
    header,
    integer,
    lanes,
    of_member,
    of_node,
)
from tiscene.render.surface import transform_point
from tiscene.scene.light_nodes import (
    BACK,
    CENTRE,
    CHILD,
    CONES,
    COUNT,
    EVEN,
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
    LANE_BITS,
    LANES,
    NORMAL,
    PARENT,
    ROUND,
    ROW,
    SIZE2,
    SPREAD2,
    STRENGTH,
)
from tiscene.scene.light_table import INSTANCE, KIND, MESH, NODE, SHADE_COLUMNS, SHADES, TREE
from tiscene.scene.placement import CURRENT

vec3 = ti.math.vec3
flags = ti.types.vector(LANES, ti.i32)

# What a distant light that comes in by no portal counts for: it may come in elsewhere.
_HIDDEN = 1e-6
_BELOW_1 = 0.99999994
# A group is near if its squared distance is below so many times its squared spread: then what its members give is
# summed up, by which the worst of the noise is halved.
_NEAR = 4.0


@ti.func
def of_entry(nodes: ti.template(), entry: ti.i32, which: ti.template()) -> ti.f32:
    """One attribute of an entry; entries are counted from 0."""
    return of_member(nodes, LANES + entry, which)


@ti.func
def towards(nodes: ti.template(), node: ti.i32, origin: vec3):
    """(x, y, z) from a point to the centre of each member of a node."""
    x = attribute(nodes, node, CENTRE) - origin.x
    y = attribute(nodes, node, CENTRE + 1) - origin.y
    z = attribute(nodes, node, CENTRE + 2) - origin.z
    return x, y, z


@ti.func
def given(lights: ti.template(), node: ti.i32, origin: vec3) -> lanes:
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
                within[k] = shaping.in_cone(lights.values, row, cosine)
        result *= within
    return result


@ti.func
def running_sums(v: lanes) -> lanes:
    """Of the first member, of two ..., of all. They never decrease: rounding keeps order."""
    second, fourth = v[0] + v[1], 0.0
    fourth = second + (v[2] + v[3])
    sixth = fourth + (v[4] + v[5])
    return lanes(v[0], second, second + v[2], fourth, fourth + v[4], sixth, sixth + v[6], sixth + (v[6] + v[7]))


@ti.func
def not_negative(v: lanes) -> ti.i32:
    """A bit for each that is at least 0."""
    bits = ti.select(v >= lanes(0.0), flags(*[1 << k for k in range(LANES)]), flags(0))
    return ((bits[0] + bits[1]) + (bits[2] + bits[3])) + ((bits[4] + bits[5]) + (bits[6] + bits[7]))


@ti.func
def lowest(bits: ti.i32) -> ti.i32:
    """Which is the lowest that is set."""
    return 31 - ti.math.clz(bits & -bits)


@ti.func
def picked(v: lanes, aim: ti.f32):
    """(member, its weight, the sum of those before it) where the running sum of weights passes `aim`."""
    sums = running_sums(v)
    before, weights = ti.Vector.zero(ti.f32, LANES), ti.Vector.zero(ti.f32, LANES)
    lane = 0
    for k in ti.static(range(LANES)):
        weights[k] = v[k]
    for k in ti.static(range(LANES - 1)):
        before[k + 1] = sums[k]
        lane += ti.cast(sums[k] <= aim, ti.i32)
    return lane, weights[lane], before[lane]


@ti.func
def affine(array: ti.template(), at: ti.i32, p: vec3) -> ti.f32:
    """Of a point, by four numbers."""
    return array[at] * p.x + array[at + 1] * p.y + array[at + 2] * p.z + array[at + 3]


@ti.func
def comes_in(lights: ti.template(), entry: ti.i32, origin: vec3):
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
def from_afar(lights: ti.template(), origin: vec3, weights: ti.template()):
    """What distant lights and domes give, by what comes in through portals.

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
    for entry in range(domes, end):
        if of_entry(nodes, entry, ROUND) > 0.0 or through_portals == 0.0:
            weights[entry] = math.pi * of_entry(nodes, entry, STRENGTH)
        else:
            weights[entry] = of_entry(nodes, entry, SIZE2) * through_portals


@ti.func
def near_groups(nodes: ti.template(), node: ti.i32, origin: vec3) -> ti.i32:
    """A bit for each member of a node that is a group and near."""
    x, y, z = towards(nodes, node, origin)
    return not_negative(_NEAR * attribute(nodes, node, SPREAD2) - (x * x + y * y + z * z + 1e-12))


@ti.func
def eight(weights: ti.template(), k: ti.i32) -> lanes:
    """The weights of the entries of the k-th node."""
    result = lanes(0.0)
    for lane in ti.static(range(LANES)):
        result[lane] = weights[LANES * k + lane]
    return result


@ti.func
def weigh(lights: ti.template(), origin: vec3, weights: ti.template()):
    """What every entry gives at a point, to `weights`, which has room for MOST_ENTRIES.

    Returns (how many nodes of entries there are to choose from, 0 where there is nothing to choose; by what to multiply
    a weight for the entry's chance, but for the even part).
    """
    nodes = ti.static(lights.nodes)
    count, scale = 0, 0.0
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
                weights[at] = running_sums(here)[LANES - 1] if weights[at] > 0.0 else 0.0
            else:
                for lane in ti.static(range(LANES)):
                    weights[LANES * done + lane] = here[lane]
                done += 1
                if of_node(nodes, done, GROUPS) > 0.0:
                    near = near_groups(nodes, done, origin)
        if header(nodes, H_DOMES) > header(nodes, H_LAMPS):
            from_afar(lights, origin, weights)
        total, even = 0.0, 0.0
        for k in range(count):
            here = eight(weights, k)
            total += running_sums(here)[LANES - 1]
            even += running_sums(ti.select(here > 0.0, attribute(nodes, 1 + k, EVEN), 0.0))[LANES - 1]
        scale = (1.0 - even) / total if total > 0.0 else 0.0
    return count, scale


@ti.func
def row_at(nodes: ti.template(), place: ti.i32) -> ti.i32:
    """The light of a member."""
    return ti.cast(of_member(nodes, place, ROW), ti.i32)


@ti.func
def in_mesh(lights: ti.template(), row: ti.i32, p: vec3) -> vec3:
    """A point in the space of the mesh that is a light."""
    return transform_point(lights.geometry.instance_from_world, CURRENT, integer(lights.values, row, INSTANCE), p)


@ti.func
def shares(lights: ti.template(), node: ti.i32, origin: vec3) -> lanes:
    """What each member of a node gives at a point, or 1 if none gives anything."""
    result = given(lights, node, origin)
    if running_sums(result)[LANES - 1] <= 0.0:
        for k in ti.static(range(LANES)):
            result[k] = ti.select(k < of_node(lights.nodes, node, COUNT), 1.0, 0.0)
    return result


@ti.func
def member(lights: ti.template(), entry: ti.i32, entry_chance: ti.f32, u: ti.f32, origin: vec3):
    """(row, its place, its chance, what is left of u) of one light of an entry by what each gives, and of one of its
    triangles."""
    nodes = ti.static(lights.nodes)
    row, place, chance, rest, p = -1, entry, entry_chance, u, origin
    node = 0
    arrived = False
    while not arrived:
        node = ti.cast(of_member(nodes, place, CHILD), ti.i32)
        if node == 0 and row < 0:
            row = row_at(nodes, place)
            if ti.static(lights.with_meshes):
                if integer(lights.values, row, KIND) == MESH:
                    node = integer(lights.values, row, TREE)
                    p = in_mesh(lights, row, origin)
        arrived = node == 0
        if not arrived:
            weights = shares(lights, node, p)
            total = running_sums(weights)[LANES - 1]
            aim = rest * total
            lane, here, low = picked(weights, aim)
            rest = ti.min((aim - low) / here, _BELOW_1)
            chance *= here / total
            place = LANES * node + lane
    return row, place, chance, rest


@ti.func
def choose(lights: ti.template(), weights: ti.template(), count: ti.i32, scale: ti.f32, origin: vec3, u: ti.f32):
    """(row, its place, its chance, a number) of the light or portal to sample from a point; chance 0 for none.

    The number is what is left of u, uniform in [0, 1) again: neighbours in u choose one light and are neighbours there.
    Of a mesh the place is that of a triangle, and so is the chance. weights ... scale: `weigh`.
    """
    nodes = ti.static(lights.nodes)
    entry, chance, rest = 0, 1.0, u
    if count > 0:
        before = 0.0
        chance = 0.0
        for k in range(count):
            here = eight(weights, k)
            here = ti.select(here > 0.0, here * scale + attribute(nodes, 1 + k, EVEN), 0.0)
            lane, lane_chance, low = picked(here, u - before)
            if lane_chance > 0.0 and u >= before:
                entry, chance, rest = LANES * k + lane, lane_chance, u - before - low
            before += running_sums(here)[LANES - 1]
        rest = ti.min(rest / ti.max(chance, 1e-20), _BELOW_1)
    return member(lights, LANES + entry, chance, rest, origin)


@ti.func
def part_of(lights: ti.template(), place: ti.i32, origin: vec3):
    """(the place of the entry that a member is below, its part of the entry's chance); place 0 for a mesh's member."""
    here, part = place, 1.0
    if here >> LANE_BITS > header(lights.nodes, H_NODES):
        here, part = part_below(lights.values, lights.nodes, place, origin)
    return here, part


@ti.real_func  # not inlined where it is called: seldom, and in four places of the largest kernel
def part_below(values: Floats2, nodes: LightNodes, place: ti.i32, origin: vec3) -> tuple[ti.i32, ti.f32]:
    """What `part_of` says of a member that is no entry itself."""
    lights = ti.static(Lights(values, nodes, None))
    entries = header(nodes, H_NODES)
    here, part = place, 1.0
    while here >> LANE_BITS > entries:
        node = here >> LANE_BITS
        weights = shares(lights, node, origin)
        mine = 0.0
        for k in ti.static(range(LANES)):
            mine = ti.select(here & (LANES - 1) == k, weights[k], mine)
        part *= mine / running_sums(weights)[LANES - 1]
        here = ti.cast(of_node(nodes, node, PARENT), ti.i32)
    return here, part


@ti.func
def chance_of(
    lights: ti.template(), weights: ti.template(), count: ti.i32, scale: ti.f32, row: ti.i32, origin: vec3
) -> ti.f32:
    """The chance with which `choose` picks the row."""
    result = 1.0
    if count > 0:
        place, part = part_of(lights, integer(lights.values, row, NODE), origin)
        entry = place - LANES
        here = weights[entry]
        result = part * (here * scale + of_entry(lights.nodes, entry, EVEN)) if here > 0.0 else 0.0
    return result
