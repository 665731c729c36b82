"""Lights that a ray meets. They are not in the tree of surfaces: rays are tested against them apart, shadow rays too,
so that a light hides what is behind it however a path gets there."""

import taichi as ti

from tiscene.render.lights import all_lights, mesh
from tiscene.render.lights.choice import lowest, not_negative, row_at, towards, weigh
from tiscene.render.lights.light_sample import attribute, header, of_member
from tiscene.scene.light_nodes import (
    CHILD,
    FEW,
    H_CHOICE,
    H_DISTANT_ROW,
    H_PORTAL_ROW,
    H_SOLID_NODES,
    LANES,
    MOST_ENTRIES,
    RADIUS2,
)
from tiscene.scene.light_table import ON_DIFFUSE, ON_INDIRECT, ON_SPECULAR, SHADOWLESS

vec3 = ti.math.vec3

# A light that lies on a surface wins over it, by this part of the distance.
LIGHT_FRONT = 1e-4
# Of the squared distance to a light, what a float's rounding can do to how far a ray passes it.
_ROUNDING = 1e-6
# Seven wait at each level of a tree of up to 8^8 lights.
_MOST_WAITING = 7 * 8 + FEW // LANES


@ti.func
def power_heuristic(a, b):
    """Veach's weight, with exponent 2, of a sample of density a that could have been one of density b; or of lanes."""
    ratio = b / a
    return 1.0 / (1.0 + ratio * ratio)


@ti.func
def response(values: ti.template(), row: ti.i32, diffuse_part: ti.f32, depth: ti.i32) -> ti.f32:
    """How much of a light a scattering at the depth-th surface of a path reflects, by the light's multipliers."""
    result = values[row, ON_DIFFUSE] * diffuse_part + values[row, ON_SPECULAR] * (1.0 - diffuse_part)
    if depth > 1:
        result *= values[row, ON_INDIRECT]
    return result


@ti.func
def nearest_light(lights: ti.template(), origin: vec3, direction: vec3, surface_distance: ti.f32):
    """(row, distance) of the light that a ray meets before the surface; row -1 for none."""
    nodes = ti.static(lights.nodes)
    row, nearest = -1, surface_distance * (1.0 + LIGHT_FRONT)
    waiting, count = ti.Vector.zero(ti.i32, _MOST_WAITING), header(nodes, H_SOLID_NODES)
    for k in range(count):
        waiting[k] = count - k
    while count > 0:
        count -= 1
        node = waiting[count]
        inside = 1
        if header(nodes, H_CHOICE) != 0:  # else there is one light in all
            x, y, z = towards(nodes, node, origin)
            along = x * direction.x + y * direction.y + z * direction.z
            distance2 = x * x + y * y + z * z
            # How far within the sphere about each member the ray's nearest point is.
            closest = ti.min(ti.max(along, 0.0), nearest)
            depth = attribute(nodes, node, RADIUS2) + (_ROUNDING - 1.0) * distance2 + closest * (2.0 * along - closest)
            inside = not_negative(depth)
        while inside > 0:
            lane = lowest(inside)
            inside &= inside - 1
            child = ti.cast(of_member(nodes, LANES * node + lane, CHILD), ti.i32)
            if child > 0:
                if count < _MOST_WAITING:
                    waiting[count] = child
                    count += 1
            else:
                candidate = row_at(nodes, LANES * node + lane)
                distance = all_lights.intersect(lights, candidate, origin, direction)
                if distance < nearest:
                    row, nearest = candidate, distance
    return row, nearest


@ti.func
def seen_lights(
    lights: ti.template(),
    textures: ti.template(),
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
            first = mesh.row_of(lights, instance)
            end = first + 1
            if first < 0:  # it is met alone, not sampled
                first, result = end, glow
    weighed, count, scale = False, 0, 0.0
    weights = ti.Vector.zero(ti.f32, MOST_ENTRIES)
    for row in range(first, end):
        radiance = glow
        if triangle < 0:
            radiance = all_lights.emitted(lights, textures, row, origin, direction, distance, pdf)
        if pdf > 0.0 and radiance.max() > 0.0:
            weight = 0.0  # without MIS, light sampling alone counts
            # A light without shadows is sampled through what is in its way, where no path could run into it.
            if mis != 0 and lights.values[row, SHADOWLESS] == 0.0:
                if not weighed:
                    count, scale = weigh(lights, last_vertex, weights)
                    weighed = True
                there = all_lights.pdf(
                    lights, weights, count, scale, row, triangle, last_vertex, direction, from_vertex
                )
                weight = power_heuristic(pdf, there)
            radiance *= weight * response(lights.values, row, diffuse_part, depth)
        result += radiance
    return result
