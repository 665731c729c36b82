# SPDX-License-Identifier: Apache-2.0
"""The kinds of light as one: sampling a light, meeting it. A new kind is a file and a name in LIGHTS."""

import taichi as ti

from tiscene.device.kernel_types import Template, vec2, vec3
from tiscene.render.lights import (
    cylinder,
    disk,
    distant,
    dome,
    emission_profile,
    emissive_mesh,
    point,
    portal,
    rect,
    sphere,
)
from tiscene.render.lights.importance import weigh
from tiscene.render.lights.light_sample import header, integer, no_sample
from tiscene.render.lights.light_sampler import chances_of, choose
from tiscene.scene.lights.light_table import DOME, DOME_ROW, KIND, MESH, PORTAL, SHAPED
from tiscene.scene.lights.light_tree import H_NODES, H_PORTAL_ROW, H_ROWS, MOST_ENTRIES

# In the order of the kinds in tiscene.scene.lights.light_table. Each has sample, pdf, intersect, emitted. After them: `mesh`.
LIGHTS = (rect, disk, sphere, cylinder, point, distant, dome, portal)


@ti.func
def sample(lights: Template, textures: Template, origin: vec3, normal: vec3, number: vec2):
    """A direction to some light: a LightSample. number: in [0, 1)^2. The densities are those of all ways to it.

    normal: of the surface, or 0 where light from all around counts.
    """
    result = no_sample()
    if header(lights.nodes, H_NODES) > 0:
        weights, faced = ti.Vector.zero(ti.f32, MOST_ENTRIES), ti.Vector.zero(ti.f32, MOST_ENTRIES)
        count, scale, faced_scale = weigh(lights, origin, normal, weights, faced, True)
        row, place, chances, rest = choose(lights, weights, faced, count, scale, faced_scale, origin, normal, number.x)
        u = vec2(rest, number.y)
        if chances.x > 0.0:
            kind = integer(lights.values, row, KIND)
            result.row = row
            for k in ti.static(range(len(LIGHTS))):
                if kind == k:
                    result = LIGHTS[k].sample(lights, textures, row, origin, u)
                    if ti.static(LIGHTS[k] != portal):
                        result.row = row
            if ti.static(lights.with_meshes):
                if kind == MESH:
                    result = emissive_mesh.sample(lights, textures, row, place, origin, u)
                    result.row = row
            densities = result.pdf * chances
            if (kind == DOME or kind == PORTAL) and result.pdf > 0.0:
                densities += other_ways(
                    lights, weights, faced, count, scale, faced_scale, result.row, row, origin, result.direction
                )
            result.pdf, result.mis_pdf = densities.x, densities.y
            if lights.values[row, SHAPED] > 0.0 and result.pdf > 0.0:
                met = origin + result.direction * result.distance
                result.radiance *= emission_profile.scale(lights.values, textures, row, met, -1.0 * result.direction)
    return result


@ti.func
def other_ways(
    lights: Template,
    weights: Template,
    faced: Template,
    count: ti.i32,
    scale: ti.f32,
    faced_scale: ti.f32,
    row: ti.i32,
    but: ti.i32,
    origin: vec3,
    direction: vec3,
) -> vec2:
    """The density of a dome's direction by its image and all its portals, leaving out the row `but`; the same for a
    surface that faces every light. weights ... faced_scale: `weigh`."""
    result = vec2(0.0)
    first = header(lights.nodes, H_PORTAL_ROW)
    for turn in range(first - 1, header(lights.nodes, H_ROWS)):
        way, reach = row, ti.math.inf
        if turn >= first:
            way = turn
            reach = rect.intersect(lights, way, origin, direction)
        if way != but and (turn < first or (reach < ti.math.inf and integer(lights.values, way, DOME_ROW) == row)):
            chances = chances_of(lights, weights, faced, count, scale, faced_scale, way, origin)
            if chances.x > 0.0:
                if turn < first:
                    result += chances * dome.pdf(lights, way, origin, direction, reach)
                else:
                    result += chances * rect.pdf(lights, way, origin, direction, reach)
    return result


@ti.func
def pdf(
    lights: Template,
    weights: Template,
    count: ti.i32,
    scale: ti.f32,
    row: ti.i32,
    triangle: ti.i32,
    origin: vec3,
    direction: vec3,
    distance: ti.f32,
) -> ti.f32:
    """The mis_pdf of `sample` for a direction that meets the light, of a mesh the triangle, at that distance.

    weights ... scale: `weigh` at the origin.
    """
    result = 0.0
    kind = integer(lights.values, row, KIND)
    if kind == DOME:
        result = other_ways(lights, weights, weights, count, scale, scale, row, -1, origin, direction).y
    else:
        for k in ti.static(range(DOME)):
            if kind == k:
                result = LIGHTS[k].pdf(lights, row, origin, direction, distance)
        if ti.static(lights.with_meshes):
            if kind == MESH:
                result = emissive_mesh.pdf(lights, row, triangle, origin, direction, distance)
        if result > 0.0:
            result *= chances_of(lights, weights, weights, count, scale, scale, row, origin).y
    return result


@ti.func
def intersect(lights: Template, row: ti.i32, origin: vec3, direction: vec3) -> ti.f32:
    """Distance to the light of that row, +inf for a miss."""
    result = ti.math.inf
    kind = integer(lights.values, row, KIND)
    for k in ti.static(range(len(LIGHTS))):
        if kind == k:
            result = LIGHTS[k].intersect(lights, row, origin, direction)
    return result


@ti.func
def emitted(
    lights: Template,
    textures: Template,
    row: ti.i32,
    origin: vec3,
    direction: vec3,
    distance: ti.f32,
    density: ti.f32,
) -> vec3:
    """Radiance from the light of that row along a ray that meets it. density: of its direction, 0 for a camera's."""
    result = vec3(0.0)
    kind = integer(lights.values, row, KIND)
    for k in ti.static(range(len(LIGHTS))):
        if kind == k:
            if ti.static(LIGHTS[k] == dome):
                result = dome.arriving(lights, textures, row, direction, density)
            else:
                result = LIGHTS[k].emitted(lights, textures, row, origin, direction, distance)
    if lights.values[row, SHAPED] > 0.0:
        result *= emission_profile.scale(lights.values, textures, row, origin + direction * distance, -1.0 * direction)
    return result
