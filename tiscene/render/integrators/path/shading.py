# SPDX-License-Identifier: Apache-2.0
"""One step of every live path: what it met, the light there, where it goes on."""

from typing import Any, NamedTuple

import taichi as ti

from tiscene.device.kernel_types import Float8s1, Floats1, Floats2, Floats3, Ints1, Ints2, Template, vec2, vec3
from tiscene.render.bsdfs import preview_surface_bsdf as bsdf
from tiscene.render.bsdfs.material_inputs import Materials, is_mirror_like, shaded_material_at, shading_normal
from tiscene.render.integrators.path.path_state import (
    ALBEDO,
    DEPTH_MASK,
    DIFFUSE_PART,
    DIRECT,
    LIVE,
    NORMAL,
    ORIGIN,
    PDF,
    RADIANCE,
    RELATIVE_IOR2,
    SAMPLED,
    SEEN,
    SPREAD,
    THROUGHPUT,
    States,
    get3,
    set3,
)
from tiscene.render.integrators.path.wavefront_kernels import FIRST_STEP_SET, path_index
from tiscene.render.intersect.ray_queue import HitIds, Hits, Pixels, Rays, ray_direction, ray_origin, write_ray
from tiscene.render.intersect.surface_interaction import Geometry, offset_origin, surface_at
from tiscene.render.lights import dispatch
from tiscene.render.lights.intersect import (
    LIGHT_FRONT,
    another_blocks,
    nearest_light,
    power_heuristic,
    response,
    seen_lights,
)
from tiscene.render.lights.light_sample import lights_of
from tiscene.render.sampling.sobol import combine, draw, set_key, set_keys
from tiscene.render.texture_lookup import Textures
from tiscene.scene.lights.light_table import KIND, MESH, SHADOWLESS
from tiscene.scene.material_table import COVERAGE, EMITS, FLAGS, GLASS, MATTE
from tiscene.scene.placement import CURRENT

# Sets of numbers, at every step.
OPACITY_SET, LIGHT_SET, LOBE_SET, DIRECTION_SET, TEXTURE_SET, SETS = range(6)

RUSSIAN_ROULETTE_DEPTH = 2
# How much a path widens by a scattering of density 1/sr: its neighbors go apart, and make out no detail together.
SCATTERED_SPREAD = 0.25
LARGEST_SURVIVAL = 0.95


class SceneArrays(NamedTuple):
    """What `shade` and `pass_shadows` read of the scene, in the order of their arguments."""

    vertex_position: Any
    vertex_normal: Any
    vertex_uv: Any
    triangle_vertices: Any
    triangle_material: Any
    instance_info: Any
    world_from_instance: Any
    instance_from_world: Any
    material_values: Any
    material_info: Any
    material_lookups: Any
    texture_info: Any
    texture_words: Any
    texture_floats: Any
    light_values: Any
    light_nodes: Any
    light_distribution: Any
    energy: Any

    @property
    def surfaces(self) -> tuple[Any, ...]:
        """The geometry and the materials, without textures."""
        return self[:10]

    @property
    def lighting(self) -> tuple[Any, ...]:
        """The textures and the lights."""
        return self[11:17]


@ti.func
def write3(array: Template, row: ti.i32, column: ti.i32, v: vec3):
    for c in ti.static(range(3)):
        array[row, column + c] = v[c]


@ti.func
def read3(array: Template, row: ti.i32, column: ti.i32) -> vec3:
    return vec3(array[row, column], array[row, column + 1], array[row, column + 2])


@ti.kernel
def shade(
    vertex_position: Floats2,
    vertex_normal: Floats2,
    vertex_uv: Floats2,
    triangle_vertices: Ints2,
    triangle_material: Ints1,
    instance_info: Ints2,
    world_from_instance: Floats3,
    instance_from_world: Floats3,
    material_values: Floats2,
    material_info: Ints2,
    material_lookups: Floats2,
    texture_info: Ints2,
    texture_words: Ints1,
    texture_floats: Floats1,
    light_values: Floats2,
    light_nodes: Float8s1,
    light_distribution: Floats1,
    energy: Floats1,
    pixels: Pixels,
    first: ti.i32,
    spp: ti.i32,
    bits: ti.i32,
    frame_key: ti.i32,
    step: ti.i32,
    max_depth: ti.i32,
    mis: ti.i32,
    background_red: ti.f32,
    background_green: ti.f32,
    background_blue: ti.f32,
    queue: Ints1,
    count: ti.i32,
    rays: Rays,
    hits: Hits,
    hit_ids: HitIds,
    shadow_rays: Rays,
    occluded: Ints1,
    state: States,
    features: Floats2,
    status: Ints1,
    first_sample: ti.i32,
    any_emission: Template,
):
    """Advance the paths in the queue by one vertex.

    step: how often they were advanced before; it names their random numbers. mis: 0 samples lights alone (for tests).
    first_sample: number of the first of the `spp` in each pixel. any_emission: whether some surface gives light.
    """
    geometry = ti.static(
        Geometry(
            vertex_position,
            vertex_normal,
            vertex_uv,
            triangle_vertices,
            triangle_material,
            instance_info,
            world_from_instance,
            instance_from_world,
        )
    )
    materials = ti.static(Materials(material_values, material_info, material_lookups))
    textures = ti.static(Textures(texture_info, texture_words, texture_floats))
    lights = ti.static(lights_of(light_values, light_nodes, light_distribution, geometry, materials, any_emission))
    sets = FIRST_STEP_SET + SETS * step
    texture_key = set_key(frame_key, sets + TEXTURE_SET)
    ti.loop_config(block_dim=128)
    # No vectors are made before the loop: in vector mode they would be kept where they are not aligned.
    for k in range(count):
        i = queue[k]
        origin, direction = ray_origin(rays, i), ray_direction(rays, i)
        throughput, radiance = get3(state, i, THROUGHPUT), get3(state, i, RADIANCE)
        pdf, part, last_vertex = state[i][PDF], state[i][DIFFUSE_PART], get3(state, i, ORIGIN)
        bits_of_status = status[i]
        if (bits_of_status & SAMPLED) != 0 and occluded[i] == 0:
            radiance += get3(state, i, DIRECT)
        depth = bits_of_status & DEPTH_MASK
        goes_on, sampled = False, 0

        instance = hit_ids[i][0]
        light, distance = nearest_light(lights, origin, direction, hits[i][0])
        last = False  # the path's last surface, of which only what it emits would count, emits nothing
        if instance >= 0 and depth + 1 >= max_depth and (bits_of_status & SEEN) != 0:
            last = (material_info[triangle_material[hit_ids[i][1]], FLAGS] & (COVERAGE | EMITS)) == 0
        seen = vec3(0.0)  # emitted towards the path by what it met
        shines, triangle, glow, before = False, -1, vec3(0.0), depth
        if light < 0 and instance < 0 and pdf == 0.0 and background_red >= 0.0:
            seen = vec3(background_red, background_green, background_blue)
        elif light >= 0 or instance < 0:
            shines = True
        elif not last:
            surface = surface_at(geometry, instance, hit_ids[i][1], hits[i][1], hits[i][2], CURRENT, direction)
            index = path_index(pixels, first + i, spp, bits, first_sample)
            width = hits[i][0] * state[i][SPREAD]
            point = shaded_material_at(materials, textures, surface, direction, width, combine(texture_key, index))
            absent = False
            if point.flags & COVERAGE:
                absent = draw(set_keys(frame_key, sets + OPACITY_SET), index).x >= point.opacity
            if absent:
                goes_on = True
                write_ray(rays, i, offset_origin(surface, direction), direction, ti.math.inf)
            else:
                if ti.static(any_emission):
                    if point.flags & EMITS:
                        shines, triangle, glow, distance = True, hit_ids[i][1], point.emissive_color, hits[i][0]
                depth += 1
                wo = -1.0 * direction
                normal = shading_normal(surface, point, wo)
                if (bits_of_status & SEEN) == 0 and is_mirror_like(point) == 0:
                    bits_of_status |= SEEN
                    write3(features, i, ALBEDO, point.diffuse_color)
                    write3(features, i, NORMAL, normal)
                if depth < max_depth:
                    light_u = draw(set_keys(frame_key, sets + LIGHT_SET), index)
                    lit_side = normal * ti.cast((point.flags & GLASS) == 0, ti.f32)  # glass is lit from all around
                    light_sample = dispatch.sample(lights, textures, surface.position, lit_side, light_u)
                    bsdf_u = draw(set_keys(frame_key, sets + DIRECTION_SET), index)
                    lobe_and_survival = vec2(0.0)
                    if (point.flags & MATTE) == 0 or depth >= RUSSIAN_ROULETTE_DEPTH:
                        lobe_and_survival = draw(set_keys(frame_key, sets + LOBE_SET), index)
                    scattering = bsdf.scatter(
                        surface, point, energy, normal, wo, light_sample.direction, vec3(bsdf_u, lobe_and_survival.x)
                    )

                    if light_sample.pdf > 0.0:
                        light_row = light_sample.row
                        direct = throughput * scattering.towards_light.xyz * light_sample.radiance
                        reflected = response(light_values, light_row, scattering.diffuse_parts.x, depth)
                        direct *= reflected / light_sample.pdf
                        shadowless = light_values[light_row, SHADOWLESS] > 0.0
                        if mis != 0 and light_sample.delta == 0 and not shadowless:
                            direct *= power_heuristic(light_sample.mis_pdf, scattering.towards_light.w)
                        if shadowless:
                            radiance += direct
                        elif direct.max() > 0.0:
                            towards, reach = light_sample.direction, light_sample.distance
                            start = offset_origin(surface, towards)
                            if ti.static(any_emission):
                                if light_values[light_row, KIND] == MESH:
                                    # Rays meet it: from where they start they must not meet it too early.
                                    aim = surface.position + towards * reach - start
                                    reach = aim.norm()
                                    towards = aim / ti.max(reach, 1e-20)
                            reach *= 1.0 - LIGHT_FRONT
                            if another_blocks(lights, light_row, start, towards, reach * (1.0 - LIGHT_FRONT)) == 0:
                                sampled = SAMPLED
                                write_ray(shadow_rays, i, start, towards, reach)
                                set3(state, i, DIRECT, direct)

                    if scattering.onward.w > 0.0:
                        throughput_onward = throughput * scattering.onward.xyz * (1.0 / scattering.onward.w)
                        ior2 = state[i][RELATIVE_IOR2]
                        if scattering.transmits != 0:
                            ior2 *= scattering.eta * scattering.eta
                            state[i][RELATIVE_IOR2] = ior2
                        survival = 1.0
                        if depth >= RUSSIAN_ROULETTE_DEPTH:
                            # The root: least cost times error, as what a path yet brings varies more than its weight.
                            survival = ti.min(ti.sqrt(throughput_onward.max() * ior2), LARGEST_SURVIVAL)
                        if lobe_and_survival.y < survival and throughput_onward.max() > 0.0:
                            goes_on = True
                            set3(state, i, THROUGHPUT, throughput_onward * (1.0 / survival))
                            state[i][PDF] = scattering.onward.w
                            state[i][DIFFUSE_PART] = scattering.diffuse_parts.y
                            spread = SCATTERED_SPREAD / ti.sqrt(scattering.onward.w)
                            state[i][SPREAD] = ti.max(state[i][SPREAD], spread)
                            set3(state, i, ORIGIN, surface.position)
                            start = offset_origin(surface, scattering.direction)
                            write_ray(rays, i, start, scattering.direction, ti.math.inf)
        if shines:
            seen = seen_lights(
                lights, textures, light, instance, triangle, glow,
                origin, direction, distance, last_vertex, pdf, part, before, mis,
            )  # fmt: skip
        if seen.max() > 0.0:
            radiance += throughput * seen
        if (bits_of_status & SEEN) == 0 and (step == 0 or not goes_on):
            write3(features, i, ALBEDO, vec3(0.0) if goes_on else ti.min(throughput * seen, 1.0))
            write3(features, i, NORMAL, vec3(0.0))
        set3(state, i, RADIANCE, radiance)
        bits_of_status = depth | (bits_of_status & SEEN) | sampled
        if goes_on:
            bits_of_status |= LIVE
        status[i] = bits_of_status
