# SPDX-License-Identifier: Apache-2.0
"""Kernels that compute the light of cells: points of their surfaces, paths from there, and the mean of these paths.

Rays along the main axis of a cell's normals, through the cube, find points of its surface. Paths leave these points as
if the surface were white and diffuse. Points and random numbers are functions of the cell's key.
"""

import taichi as ti

from tiscene.device.argument_bundles import bundled
from tiscene.device.kernel_types import Float8s1, Floats1, Floats2, Ints1, Ints2, Template, u32, vec3
from tiscene.render.bsdfs.material_inputs import Materials
from tiscene.render.integrators.light_cache.cells import (
    GRID_SHIFT,
    INSTANCE,
    KEY1,
    KEY2,
    LEVEL,
    SIDE,
    VALID,
    CellList,
    Cells,
    X,
    cell_at,
    cell_size,
)
from tiscene.render.integrators.path.path_state import (
    DIFFUSE_FRACTION,
    DIRECT,
    FEATURES_WRITTEN,
    LIGHT_PENDING,
    LIVE,
    ORIGIN,
    PDF,
    RADIANCE,
    RELATIVE_IOR2,
    SPREAD,
    THROUGHPUT,
    States,
    get3,
    set3,
)
from tiscene.render.integrators.path.shading import DIRECTION_SET, LIGHT_SET, SCATTERED_SPREAD
from tiscene.render.integrators.path.wavefront_kernels import FIRST_STEP_SET, path_index
from tiscene.render.intersect.ray_queue import PLACE, ROW, HitIds, Hits, Pixels, Rays, ray_direction, write_ray
from tiscene.render.intersect.surface_interaction import Geometry, offset_origin, surface_at
from tiscene.render.lights import dispatch
from tiscene.render.lights.intersect import LIGHT_FRONT, is_blocked_by_light, power_heuristic, response
from tiscene.render.lights.light_sample import lights_of
from tiscene.render.sampling import warp
from tiscene.render.sampling.sobol import combine, draw, mix, set_keys, uniform
from tiscene.render.texture_lookup import Textures
from tiscene.scene.lights.light_kinds import MESH
from tiscene.scene.lights.light_table import KIND, SHADOWLESS
from tiscene.scene.placement import CURRENT

PROBE_SIDE = 4
PROBES = PROBE_SIDE * PROBE_SIDE  # rays that look for points of a cell's surface
MARGIN = 0.01  # of the cube's side, by which these rays start outside


@ti.func
def axis_of(side: ti.i32) -> ti.i32:
    """Return the main axis of the normals in a bin of `side_of`."""
    return side // 18


@ti.kernel
def probe_rays(cells: CellList, count: ti.i32, rays: Rays, queue: Ints1, pixels: Pixels, bits: ti.i32):
    """Generate PROBES rays through the cube of each cell, and the cells' random numbers as `pixels` of the paths.

    Args:
        bits: Bits that number the paths of a cell.
        rays: Output, row PROBES * cell + probe.
        queue: Output, all rows.
        pixels: Output, one for each cell.
    """
    for row in range(count * PROBES):
        each = cells[row // PROBES]
        size, axis = cell_size(each[LEVEL]), axis_of(each[SIDE])
        sign = 1.0 if (each[SIDE] // 9) % 2 == 0 else -1.0
        probe = row % PROBES
        key = combine(combine(ti.cast(each[KEY1], u32), ti.cast(each[KEY2], u32)), ti.cast(probe, u32))
        a = (probe % PROBE_SIDE + uniform(key)) / PROBE_SIDE
        b = (probe // PROBE_SIDE + uniform(mix(key))) / PROBE_SIDE
        start, direction = vec3(0.0), vec3(0.0)
        for c in ti.static(range(3)):
            low = (each[X + c] - GRID_SHIFT) * size
            along = a if c == (axis + 1) % 3 else b
            if c == axis:
                along = 0.5 + sign * (0.5 + MARGIN)
                direction[c] = -sign
            start[c] = low + along * size
        write_ray(rays, row, start, direction, size * (1.0 + 2.0 * MARGIN))
        queue[row] = row
        if probe == 0:
            pixels[row // PROBES][ROW] = 0
            pixels[row // PROBES][PLACE] = each[KEY2] & ((1 << (32 - bits)) - 1)


@ti.kernel
@bundled
def start_cell_paths(
    geometry: Geometry,
    materials: Materials,
    textures: Textures,
    light_values: Floats2,
    light_nodes: Float8s1,
    light_distribution: Floats1,
    energy: Floats1,
    cells: CellList,
    first_cell: ti.i32,
    count: ti.i32,
    spp: ti.i32,
    bits: ti.i32,
    key: ti.i32,
    sharp_light: ti.i32,
    pixels: Pixels,
    probes: Rays,
    probe_hits: Hits,
    probe_ids: HitIds,
    rays: Rays,
    shadow_rays: Rays,
    state: States,
    status: Ints1,
    queue: Ints1,
    any_emission: Template,
):
    """Start `spp` paths at each cell, after their first vertex: a shadow ray to a light, and the next segment.

    The light in row `sharp_light` is left out at the first vertex. Path c * spp + s starts at cell first_cell + c.
    Paths of cells without surface end at once.
    """
    lights = ti.static(lights_of(light_values, light_nodes, light_distribution, geometry, materials, any_emission))
    for i in range(count):
        row = first_cell + i // spp
        each = cells[row]
        # The probes are used in turn; those that missed the cell's surface are passed over.
        found = -1
        for offset in range(PROBES):
            probe = PROBES * row + (i % spp + offset) % PROBES
            if found < 0 and probe_ids[probe][0] == each[INSTANCE]:
                ids, hit, direction = probe_ids[probe], probe_hits[probe], ray_direction(probes, probe)
                point = surface_at(geometry, ids[0], ids[1], hit[1], hit[2], CURRENT, direction)
                there = cell_at(ids[0], each[LEVEL], point.position, point.normal)
                if there[KEY1] == each[KEY1] and there[KEY2] == each[KEY2]:
                    found = probe
        status[i] = 0
        state[i][RELATIVE_IOR2] = 0.0  # no path
        queue[i] = i
        if found >= 0:
            ids, hit, direction = probe_ids[found], probe_hits[found], ray_direction(probes, found)
            surface = surface_at(geometry, ids[0], ids[1], hit[1], hit[2], CURRENT, direction)
            normal, status_bits = surface.normal, 1 | FEATURES_WRITTEN
            index = path_index(pixels, first_cell * spp + i, spp, bits, 0)
            for c in ti.static(range(3)):
                state[i][THROUGHPUT + c] = 1.0
                state[i][RADIANCE + c] = 0.0
            state[i][RELATIVE_IOR2] = 1.0
            light_u = draw(set_keys(key, FIRST_STEP_SET + LIGHT_SET), index)
            sample = dispatch.sample(lights, textures, surface.position, normal, light_u)
            cosine = normal.dot(sample.direction)
            is_kept = sample.pdf > 0.0 and sample.row != sharp_light
            if is_kept and cosine > 0.0 and surface.geometric_normal.dot(sample.direction) > 0.0:
                density = cosine * warp.INV_PI
                direct = sample.radiance * (density * response(light_values, sample.row, 1.0, 1) / sample.pdf)
                shadowless = light_values[sample.row, SHADOWLESS] > 0.0
                if sample.delta == 0 and not shadowless:
                    direct *= power_heuristic(sample.mis_pdf, density)
                if shadowless:
                    set3(state, i, RADIANCE, direct)
                elif direct.max() > 0.0:
                    towards, reach = sample.direction, sample.distance
                    start = offset_origin(surface, towards)
                    if ti.static(any_emission):
                        if light_values[sample.row, KIND] == MESH:
                            aim = surface.position + towards * reach - start
                            reach = aim.norm()
                            towards = aim / ti.max(reach, 1e-20)
                    reach *= 1.0 - LIGHT_FRONT
                    if is_blocked_by_light(lights, sample.row, start, towards, reach * (1.0 - LIGHT_FRONT)) == 0:
                        status_bits |= LIGHT_PENDING
                        write_ray(shadow_rays, i, start, towards, reach)
                        set3(state, i, DIRECT, direct)
            wi = warp.cosine_hemisphere(draw(set_keys(key, FIRST_STEP_SET + DIRECTION_SET), index))
            pdf = warp.cosine_hemisphere_pdf(wi)
            s, t = warp.tangents(normal)
            onward = s * wi.x + t * wi.y + normal * wi.z
            if pdf > 0.0 and surface.geometric_normal.dot(onward) > 0.0:
                status_bits |= LIVE
                state[i][PDF] = pdf
                state[i][DIFFUSE_FRACTION] = 1.0
                state[i][SPREAD] = SCATTERED_SPREAD / ti.sqrt(pdf)
                set3(state, i, ORIGIN, surface.position)
                write_ray(rays, i, offset_origin(surface, onward), onward, ti.math.inf)
            status[i] = status_bits


@ti.kernel
def mean_of_paths(
    first_cell: ti.i32,
    count: ti.i32,
    spp: ti.i32,
    status: Ints1,
    occluded: Ints1,
    state: States,
    values: Floats2,
):
    """Write the mean radiance of each cell's finished paths, in the order of the paths. Non-finite paths count as 0."""
    for c in range(count):
        total, traced = vec3(0.0), 0
        for i in range(c * spp, (c + 1) * spp):
            if state[i][RELATIVE_IOR2] > 0.0:
                traced += 1
                radiance = get3(state, i, RADIANCE)
                if (status[i] & LIGHT_PENDING) != 0 and occluded[i] == 0:
                    radiance += get3(state, i, DIRECT)
                if ti.abs(radiance.sum()) < ti.math.inf:
                    total += radiance
        for column in ti.static(range(3)):
            values[first_cell + c, column] = total[column] / spp
        values[first_cell + c, VALID] = ti.cast(traced > 0, ti.f32)


@ti.kernel
@bundled
def insert(
    new_cells: CellList,
    new_values: Floats2,
    count: ti.i32,
    cells: Cells,
):
    """Insert distinct cells that are not in the table."""
    ti.loop_config(serialize=True)
    for row in range(count):
        mask = cells.keys.shape[0] - 1
        slot = new_cells[row][KEY1] & mask
        while cells.keys[slot, 1] != 0:
            slot = (slot + 1) & mask
        cells.keys[slot, 0] = new_cells[row][KEY1]
        cells.keys[slot, 1] = new_cells[row][KEY2]
        for column in ti.static(range(4)):
            cells.values[slot, column] = new_values[row, column]


@ti.kernel
@bundled
def reinsert(
    old_keys: Ints2,
    old_values: Floats2,
    cells: Cells,
):
    """Insert all entries of a smaller table."""
    ti.loop_config(serialize=True)
    for row in range(old_keys.shape[0]):
        if old_keys[row, 1] != 0:
            mask = cells.keys.shape[0] - 1
            slot = old_keys[row, 0] & mask
            while cells.keys[slot, 1] != 0:
                slot = (slot + 1) & mask
            cells.keys[slot, 0] = old_keys[row, 0]
            cells.keys[slot, 1] = old_keys[row, 1]
            for column in ti.static(range(4)):
                cells.values[slot, column] = old_values[row, column]
