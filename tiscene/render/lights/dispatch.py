# SPDX-License-Identifier: Apache-2.0
"""Sampling, density, intersection and emission of any light, by its kind (see `light_kernels`)."""

import taichi as ti

from tiscene.device.kernel_types import Template, vec2, vec3
from tiscene.render.lights import dome, emission_profile, emissive_mesh, rect
from tiscene.render.lights.importance import EntryWeights, weigh_entries
from tiscene.render.lights.light_kernels import LIGHT_KERNELS
from tiscene.render.lights.light_sample import header, integer, no_sample
from tiscene.render.lights.light_sampler import choose_light, light_probabilities
from tiscene.scene.lights.light_kinds import DOME, MESH, PORTAL
from tiscene.scene.lights.light_table import DOME_ROW, KIND, SHAPED
from tiscene.scene.lights.light_tree import H_ENTRY_NODES, H_PORTAL_ROW, H_ROWS, MAX_ENTRIES


@ti.func
def sample(lights: Template, textures: Template, origin: vec3, normal: vec3, u: vec2):
    """Choose a light and sample a direction to it.

    Args:
        lights: LightTables.
        textures: Textures.
        origin: Shading point, m.
        normal: Surface normal there; zero to weigh lights without the cosine.
        u: Uniform in [0, 1)².

    Returns:
        LightSample. Its densities are the sum over all strategies that could have led to the direction.
    """
    result = no_sample()
    if header(lights.nodes, H_ENTRY_NODES) > 0:
        weights, faced = ti.Vector.zero(ti.f32, MAX_ENTRIES), ti.Vector.zero(ti.f32, MAX_ENTRIES)
        count, scale, faced_scale = weigh_entries(lights, origin, normal, weights, faced, True)
        entries = ti.static(EntryWeights(weights, faced, count, scale, faced_scale))
        row, slot, probabilities, rest = choose_light(lights, entries, origin, normal, u.x)
        point = vec2(rest, u.y)
        if probabilities.x > 0.0:
            kind = integer(lights.values, row, KIND)
            result.row = row
            for k in ti.static(range(len(LIGHT_KERNELS))):
                if kind == LIGHT_KERNELS[k].kind:
                    result = LIGHT_KERNELS[k].sample(lights, textures, row, origin, point)
                    if ti.static(LIGHT_KERNELS[k].kind != PORTAL):
                        result.row = row
            if ti.static(lights.with_meshes):
                if kind == MESH:
                    result = emissive_mesh.sample(lights, textures, row, slot, origin, point)
                    result.row = row
            densities = result.pdf * probabilities
            if (kind == DOME or kind == PORTAL) and result.pdf > 0.0:
                densities += dome_densities(lights, entries, result.row, row, origin, result.direction)
            result.pdf, result.mis_pdf = densities.x, densities.y
            if lights.values[row, SHAPED] > 0.0 and result.pdf > 0.0:
                hit = origin + result.direction * result.distance
                result.radiance *= emission_profile.scale(lights.values, textures, row, hit, -1.0 * result.direction)
    return result


@ti.func
def dome_densities(
    lights: Template, entries: Template, row: ti.i32, excluded: ti.i32, origin: vec3, direction: vec3
) -> vec2:
    """Return the density of a dome's direction, summed over its image and its portals.

    Args:
        lights: LightTables.
        entries: EntryWeights.
        row: The dome.
        excluded: Row of a strategy to leave out; -1 for none.
        origin: Shading point.
        direction: Unit.

    Returns:
        (density with the lights weighed for the normal, density for a surface that faces every light), 1/sr.
    """
    result = vec2(0.0)
    first = header(lights.nodes, H_PORTAL_ROW)
    for candidate in range(first - 1, header(lights.nodes, H_ROWS)):
        strategy, distance = row, ti.math.inf
        if candidate >= first:
            strategy = candidate
            distance = rect.intersect(lights, strategy, origin, direction)
        if strategy != excluded and (
            candidate < first or (distance < ti.math.inf and integer(lights.values, strategy, DOME_ROW) == row)
        ):
            probabilities = light_probabilities(lights, entries, strategy, origin)
            if probabilities.x > 0.0:
                if candidate < first:
                    result += probabilities * dome.pdf(lights, strategy, origin, direction, distance)
                else:
                    result += probabilities * rect.pdf(lights, strategy, origin, direction, distance)
    return result


@ti.func
def pdf(
    lights: Template,
    entries: Template,
    row: ti.i32,
    triangle: ti.i32,
    origin: vec3,
    direction: vec3,
    distance: ti.f32,
) -> ti.f32:
    """Return the mis_pdf of `sample` for a direction that hits a light.

    Args:
        lights: LightTables.
        entries: EntryWeights at `origin`, without a normal.
        row: The light.
        triangle: Of an emissive mesh, the triangle that is hit.
        origin: Shading point.
        direction: Unit.
        distance: To the light, m.
    """
    result = 0.0
    kind = integer(lights.values, row, KIND)
    if kind == DOME:
        result = dome_densities(lights, entries, row, -1, origin, direction).y
    else:
        for k in ti.static(range(len(LIGHT_KERNELS))):
            if ti.static(LIGHT_KERNELS[k].kind != DOME and LIGHT_KERNELS[k].has("pdf")):
                if kind == LIGHT_KERNELS[k].kind:
                    result = LIGHT_KERNELS[k].pdf(lights, row, origin, direction, distance)
        if ti.static(lights.with_meshes):
            if kind == MESH:
                result = emissive_mesh.pdf(lights, row, triangle, origin, direction, distance)
        if result > 0.0:
            result *= light_probabilities(lights, entries, row, origin).y
    return result


@ti.func
def intersect(lights: Template, row: ti.i32, origin: vec3, direction: vec3) -> ti.f32:
    """Return the distance to the light in a row, +inf for a miss."""
    result = ti.math.inf
    kind = integer(lights.values, row, KIND)
    for k in ti.static(range(len(LIGHT_KERNELS))):
        if ti.static(LIGHT_KERNELS[k].has("intersect")):
            if kind == LIGHT_KERNELS[k].kind:
                result = LIGHT_KERNELS[k].intersect(lights, row, origin, direction)
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
    """Return the radiance of the light in a row along a ray that hits it.

    density: 1/sr, of the ray's direction, by which environment maps are filtered; 0 for camera rays.
    """
    result = vec3(0.0)
    kind = integer(lights.values, row, KIND)
    if kind == DOME:
        result = dome.radiance_from(lights, textures, row, direction, density)
    for k in ti.static(range(len(LIGHT_KERNELS))):
        if ti.static(LIGHT_KERNELS[k].has("emitted")):
            if kind == LIGHT_KERNELS[k].kind:
                result = LIGHT_KERNELS[k].emitted(lights, textures, row, origin, direction, distance)
    if lights.values[row, SHAPED] > 0.0:
        result *= emission_profile.scale(lights.values, textures, row, origin + direction * distance, -1.0 * direction)
    return result
