# SPDX-License-Identifier: Apache-2.0
"""Estimated contribution of each light to a shading point, without visibility; its formula is in `light_tree`.

Portals are weighed like rect lights, those beside a point by their solid angle. In a scene with portals, a distant
light counts only where it shines through one: the sun is hardly ever sampled where it cannot be seen.
"""

import math
from typing import Any, NamedTuple

import taichi as ti

from tiscene.device.kernel_types import Template, float8, vec3
from tiscene.render.intersect.bvh8 import mask_bits
from tiscene.render.lights import emission_profile, rect
from tiscene.render.lights.lane_ops import load_lanes, lowest_set_bit, sum_lanes
from tiscene.render.lights.light_sample import axis, header, integer, light_row, node_lanes, node_value, slot_value
from tiscene.render.sampling import warp
from tiscene.scene.lights.light_table import CONE_REACH, PORTAL_MAP_COLUMNS, PORTAL_MAPS
from tiscene.scene.lights.light_tree import (
    BACK,
    CENTER,
    CHILD,
    CONES,
    COUNT,
    EXTENT,
    GROUPS,
    H_DISTANT_END,
    H_DOME_END,
    H_ENTRY_NODES,
    H_FINITE_END,
    H_HAS_CHOICE,
    H_NON_DOME_NODES,
    H_PORTAL_END,
    H_PORTAL_ROW,
    H_ROWS,
    LANES,
    NORMAL,
    ROUND,
    ROW,
    SIZE2,
    SPREAD2,
    STRENGTH,
    UNIFORM,
)

# Factor of a distant light that shines through no portal; not 0, since it may enter by an opening without portal.
_NO_PORTAL_FACTOR = 1e-6
# Lower bound of the estimated cosine at the surface: its BSDF may be glossy, and lights extend beyond their centers.
_MIN_COSINE = 0.05
# A group is near if its squared distance is below this factor times SPREAD2. Near groups are weighed by the sum of
# their children's estimates, which halves the largest errors.
_NEAR = 4.0
# Ratio, see `rect.is_far`, below which a portal is weighed like other lights.
_FAR_PORTAL = 0.5


class EntryWeights(NamedTuple):
    """Estimated contributions of the entries to a shading point, as `weigh_entries` returns them; a static tuple.

    Attributes:
        weights: Vector of MAX_ENTRIES, for a surface that faces each light.
        faced: The same for a surface of a normal; `weights`, if there is none.
        count: Number of nodes of entries; 0 if there is nothing to choose.
        scale: An entry's probability is scale * weight + UNIFORM.
        faced_scale: As scale, for `faced`.
    """

    weights: Any
    faced: Any
    count: Any
    scale: Any
    faced_scale: Any


@ti.func
def entry_value(nodes: Template, entry: ti.i32, attribute: Template) -> ti.f32:
    """Return one attribute of an entry, counted from 0."""
    return slot_value(nodes, LANES + entry, attribute)


@ti.func
def offsets_to_children(nodes: Template, node: ti.i32, origin: vec3):
    """Return (x, y, z), the offsets from a point to the center of each child of a node."""
    x = node_lanes(nodes, node, CENTER) - origin.x
    y = node_lanes(nodes, node, CENTER + 1) - origin.y
    z = node_lanes(nodes, node, CENTER + 2) - origin.z
    return x, y, z


@ti.func
def widened(cosine: ti.f32, sine: ti.f32) -> ti.f32:
    """Return the cosine of a - b, or 1 where that is negative, given the cosine of a and the sine of b."""
    result = 1.0
    other = ti.sqrt(ti.max(1.0 - sine * sine, 0.0))
    if sine < 1.0 and cosine < other:
        result = cosine * other + ti.sqrt(ti.max(1.0 - cosine * cosine, 0.0)) * sine
    return result


@ti.func
def irradiance_estimates(lights: Template, node: ti.i32, origin: vec3) -> float8:
    """Return the estimated irradiance, by luminance, from each child of a node on a surface that faces it."""
    nodes = ti.static(lights.nodes)
    x, y, z = offsets_to_children(nodes, node, origin)
    distance2 = x * x + y * y + z * z + 1e-12
    distance = ti.sqrt(distance2)
    height = x * node_lanes(nodes, node, NORMAL)
    height += y * node_lanes(nodes, node, NORMAL + 1)
    height += z * node_lanes(nodes, node, NORMAL + 2)
    facing = node_lanes(nodes, node, ROUND) * distance + ti.max(height, -1.0 * node_lanes(nodes, node, BACK) * height)
    distance_or_spread2 = ti.max(distance2 + node_lanes(nodes, node, SIZE2), node_lanes(nodes, node, SPREAD2))
    result = ti.max(node_lanes(nodes, node, STRENGTH) * facing / (distance * distance_or_spread2), 0.0)
    if node_value(nodes, node, CONES) > 0.0:
        within = ti.Vector.one(ti.f32, LANES)
        count = ti.cast(node_value(nodes, node, COUNT), ti.i32)
        for k in range(count):  # a count unknown at compile time: LLVM would unroll the loop
            if slot_value(nodes, LANES * node + k, BACK) < 0.0:
                row = light_row(nodes, LANES * node + k)
                offset = axis(lights.values, row, 3) - origin
                cosine = offset.dot(axis(lights.values, row, 2)) / ti.max(offset.norm(), 1e-9)
                if lights.values[row, CONE_REACH] > 0.0:
                    cosine = widened(cosine, lights.values[row, CONE_REACH] / ti.max(offset.norm(), 1e-9))
                within[k] = emission_profile.in_cone(lights.values, row, cosine)
        result *= within
    return result


@ti.func
def cosine_estimates(nodes: Template, node: ti.i32, origin: vec3, normal: vec3) -> float8:
    """Return the estimated cosine at which a surface sees each child of a node, at a large one its nearer part.

    normal: zero for no cosine; the result is then 1.
    """
    x, y, z = offsets_to_children(nodes, node, origin)
    distance = ti.sqrt(x * x + y * y + z * z + 1e-12)
    extent = node_lanes(nodes, node, EXTENT)
    cosine = (x * normal.x + y * normal.y + z * normal.z + extent) / (distance + extent)
    minimum = _MIN_COSINE if normal.dot(normal) > 0.0 else 1.0
    return ti.min(ti.max(cosine, minimum), 1.0)


@ti.func
def affine_map(array: Template, at: ti.i32, p: vec3) -> ti.f32:
    """Apply an affine map from points to numbers, stored as four coefficients."""
    return array[at] * p.x + array[at + 1] * p.y + array[at + 2] * p.z + array[at + 3]


@ti.func
def enters_through_portal(lights: Template, entry: ti.i32, origin: vec3):
    """Return 1 if a distant light shines on a point through a portal, or the entry is a group; else 0."""
    result = 1
    row = ti.cast(entry_value(lights.nodes, entry, ROW), ti.i32)
    if row >= 0:
        at = integer(lights.values, row, PORTAL_MAPS)
        if at >= 0:
            maps = ti.static(lights.distribution)
            result = 0
            for _ in range(header(lights.nodes, H_ROWS) - header(lights.nodes, H_PORTAL_ROW)):
                across = affine_map(maps, at, origin)
                along = affine_map(maps, at + 4, origin)
                result |= ti.cast(ti.max(ti.abs(across), ti.abs(along)) <= 1.0, ti.i32)
                at += PORTAL_MAP_COLUMNS
    return result


@ti.func
def near_portal_factor(lights: Template, row: ti.i32, estimate: ti.f32, origin: vec3) -> ti.f32:
    """Return by what the estimate of a portal has to be multiplied.

    The estimate takes a portal for a small one at its center. Beside a window it is up to seven times too small, and a
    sun behind the window would take most samples.

    Args:
        lights: LightTables.
        row: The portal.
        estimate: Estimated solid angle over area, 1/m²; NaN for a black portal.
        origin: Shading point.
    """
    result = 1.0
    x0, x1, y0, y1, z0 = rect.extent_from(lights.values, row, origin)
    if z0 > 0.0 and estimate > 0.0 and rect.is_far(x0, x1, y0, y1, z0, _FAR_PORTAL) == 0:
        result = warp.rectangle_view(x0, x1, y0, y1, z0).solid_angle / ((x1 - x0) * (y1 - y0) * estimate)
    return result


@ti.func
def weigh_infinite_lights(lights: Template, origin: vec3, weights: Template, faced: Template, faces: Template):
    """Set the weights of domes and of portals beside the point; reduce those of distant lights that shine through none.

    Arguments as for `weigh_entries`. A light behind a portal also passes the test of `enters_through_portal` at points
    outside; they are few, and their result stays unbiased.
    """
    nodes = ti.static(lights.nodes)
    portals, distants = header(nodes, H_FINITE_END), header(nodes, H_PORTAL_END)
    domes, end = header(nodes, H_DISTANT_END), header(nodes, H_DOME_END)
    through_portals = 0.0
    for entry in range(portals, distants):
        row = ti.cast(entry_value(nodes, entry, ROW), ti.i32)
        if row >= 0:
            factor = near_portal_factor(lights, row, weights[entry] / entry_value(nodes, entry, STRENGTH), origin)
            weights[entry] *= factor
            if ti.static(faces):
                faced[entry] *= factor
        through_portals += weights[entry]
    if through_portals > 0.0:
        for entry in range(distants, domes):
            if enters_through_portal(lights, entry, origin) == 0:
                weights[entry] *= _NO_PORTAL_FACTOR
                if ti.static(faces):
                    faced[entry] *= _NO_PORTAL_FACTOR
    for entry in range(domes, end):
        if entry_value(nodes, entry, ROUND) > 0.0 or through_portals == 0.0:
            weights[entry] = math.pi * entry_value(nodes, entry, STRENGTH)
        else:
            weights[entry] = entry_value(nodes, entry, SIZE2) * through_portals
        if ti.static(faces):
            faced[entry] = weights[entry]


@ti.func
def near_group_bits(nodes: Template, node: ti.i32, origin: vec3) -> ti.i32:
    """Return a bit for each child of a node that is a group and near."""
    x, y, z = offsets_to_children(nodes, node, origin)
    return mask_bits(_NEAR * node_lanes(nodes, node, SPREAD2) >= x * x + y * y + z * z + 1e-12)


@ti.func
def weigh_entries(
    lights: Template,
    origin: vec3,
    normal: vec3,
    weights: Template,
    faced: Template,
    faces: Template,
):
    """Estimate the contribution of every entry.

    Args:
        lights: LightTables.
        origin: Shading point, m.
        normal: Surface normal there; zero for no cosine.
        weights: Vector of MAX_ENTRIES; receives the estimates for a surface that faces each light.
        faced: Vector of MAX_ENTRIES; receives the estimates for a surface of the normal, if `faces`.
        faces: Static.

    Returns:
        (count, scale, faced_scale), see `EntryWeights`.
    """
    nodes = ti.static(lights.nodes)
    count, scale, faced_scale = 0, 0.0, 0.0
    if node_value(nodes, 0, H_HAS_CHOICE) > 0.0:
        count = header(nodes, H_ENTRY_NODES)
        done, near, end = 0, 0, header(nodes, H_NON_DOME_NODES)
        while near > 0 or done < end:
            node, opened = 1 + done, -1
            if near > 0:
                opened = lowest_set_bit(near)
                near &= near - 1
                node = ti.cast(slot_value(nodes, LANES * done + opened, CHILD), ti.i32)
            here = irradiance_estimates(lights, node, origin)
            if opened >= 0:
                at = LANES * (done - 1) + opened
                has_emission = weights[at] > 0.0
                weights[at] = sum_lanes(here) if has_emission else 0.0
                if ti.static(faces):
                    faced[at] = sum_lanes(here * cosine_estimates(nodes, node, origin, normal)) if has_emission else 0.0
            else:
                for lane in ti.static(range(LANES)):
                    weights[LANES * done + lane] = here[lane]
                if ti.static(faces):
                    here *= cosine_estimates(nodes, node, origin, normal)
                    for lane in ti.static(range(LANES)):
                        faced[LANES * done + lane] = here[lane]
                done += 1
                if node_value(nodes, done, GROUPS) > 0.0:
                    near = near_group_bits(nodes, done, origin)
        if header(nodes, H_DOME_END) > header(nodes, H_FINITE_END):
            weigh_infinite_lights(lights, origin, weights, faced, faces)
        total, faced_total, uniform = 0.0, 0.0, 0.0
        for k in range(count):
            here = load_lanes(weights, k)
            total += sum_lanes(here)
            uniform += sum_lanes(ti.select(here > 0.0, node_lanes(nodes, 1 + k, UNIFORM), 0.0))
            if ti.static(faces):
                faced_total += sum_lanes(load_lanes(faced, k))
        scale = (1.0 - uniform) / total if total > 0.0 else 0.0
        if ti.static(faces):
            faced_scale = (1.0 - uniform) / faced_total if faced_total > 0.0 else 0.0
    return count, scale, faced_scale
