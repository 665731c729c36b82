# SPDX-License-Identifier: Apache-2.0
"""The shading kernel of the wavefront path tracer: one vertex of every live path, or several where few are left.

For each path, `shade` adds the light sample of the previous vertex if its shadow ray was unoccluded and the emission
that the segment found. At a surface it evaluates the material, samples a light (next-event estimation, whose shadow ray
is traced afterwards) and samples the BSDF for the next segment, with Russian roulette. Light and BSDF samples are
combined by multiple importance sampling. See Physically Based Rendering, 4th edition, section 15.3.
"""

import taichi as ti

from dynamics.balanced_loops import first_items, iterations, next_item
from tiscene.device.argument_bundles import bundled
from tiscene.device.kernel_types import Float4s1, Float8s1, Floats1, Floats2, Ints1, Ints2, Template, vec2, vec3
from tiscene.render.bsdfs import extended_surface_bsdf as extended_bsdf
from tiscene.render.bsdfs import preview_surface_bsdf as bsdf
from tiscene.render.bsdfs.lobe_inputs import transmittance
from tiscene.render.bsdfs.material_inputs import Materials, is_mirror_like, shaded_material_at, shading_normal
from tiscene.render.columns import write3
from tiscene.render.integrators.path.direct_light import direct_light, shadow_ray
from tiscene.render.integrators.path.frame_stack import instance_in_frame, key_of
from tiscene.render.integrators.path.path_state import (
    ALBEDO,
    DEPTH_MASK,
    DIFFUSE_FRACTION,
    DIRECT,
    FEATURES_WRITTEN,
    LIGHT_PENDING,
    LINK_CLASS_SHIFT,
    LIVE,
    NORMAL,
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
from tiscene.render.integrators.path.radiance_cache import RadianceCache, cached_radiance
from tiscene.render.integrators.path.wavefront_kernels import FIRST_STEP_SET, path_index
from tiscene.render.intersect.bvh8 import STACK, trace_ray
from tiscene.render.intersect.ray_queue import (
    LINKS,
    T_MAX,
    HitIds,
    Hits,
    Pixels,
    Rays,
    ray_direction,
    ray_origin,
    write_hit,
    write_ray,
)
from tiscene.render.intersect.surface_interaction import Geometry, offset_origin, surface_at
from tiscene.render.lights import dispatch
from tiscene.render.lights.intersect import (
    LIGHT_FRONT,
    is_blocked_by_light,
    nearest_light,
    weighted_emission,
)
from tiscene.render.lights.light_sample import is_linked, lights_of
from tiscene.render.sampling.sobol import combine, draw, set_key, set_keys
from tiscene.render.texture_lookup import Textures
from tiscene.scene.instance_upload import INFO_LINK_CLASS
from tiscene.scene.lights.light_table import SHADOWING, SHADOWLESS
from tiscene.scene.material_table import COVERAGE, EMITS, FLAGS, GLASS, MATTE, TRANSLUCENT, UNSEEN
from tiscene.scene.placement import CURRENT

# Sets of random numbers of each segment, offsets from FIRST_STEP_SET + SETS * step.
OPACITY_SET, LIGHT_SET, LOBE_SET, DIRECTION_SET, TEXTURE_SET, SETS = range(6)

TAKEN_PATHS = 8  # by a thread at a time
RUSSIAN_ROULETTE_DEPTH = 2
# Ray-cone spread after scattering with a density of 1/sr: neighboring paths diverge, so textures are filtered more.
SCATTERED_SPREAD = 0.25
MAX_SURVIVAL = 0.95


@ti.func
def trace_path(
    i: ti.i32, nodes: Template, leaf_blocks: Template, geometry: Template, instances: Template, root: ti.i32,
    rays: Template, hits: Template, hit_ids: Template, shadow_rays: Template, occluded: Template, status: Template,
):  # fmt: skip
    """Trace the shadow ray of path i, if it has one, and its next segment."""
    references, distances = ti.Vector([0] * STACK), ti.Vector([0.0] * STACK)
    for which in range(ti.select(status[i] & LIGHT_PENDING, 0, 1), 2):  # a loop: the traversal is compiled once
        origin, direction, reach = ray_origin(rays, i), ray_direction(rays, i), rays[i][T_MAX]
        if which == 0:
            origin, direction = ray_origin(shadow_rays, i), ray_direction(shadow_rays, i)
            reach = shadow_rays[i][T_MAX]
        t, b1, b2, instance, triangle = trace_ray(
            nodes, leaf_blocks, geometry.instance_from_world, instances, CURRENT, root, origin.x, origin.y, origin.z,
            direction.x, direction.y, direction.z, reach, references, distances,
        )  # fmt: skip
        if which == 0:
            occluded[i] = ti.select(instance >= 0, 1, 0)
        else:
            write_hit(hits, hit_ids, i, t, b1, b2, instance, triangle)


@ti.func
def continue_path(
    i: ti.i32, rays: Template, state: Template, surface: Template, scattering: Template, throughput: vec3,
    depth: ti.i32, u: ti.f32,
):  # fmt: skip
    """Begin the next segment of path i, along the sampled BSDF direction; return whether Russian roulette keeps it."""
    continues = False
    if scattering.onward.w > 0.0:
        throughput_onward = throughput * scattering.onward.xyz * (1.0 / scattering.onward.w)
        ior2 = state[i][RELATIVE_IOR2]
        if scattering.transmits != 0:
            ior2 *= scattering.eta * scattering.eta
            state[i][RELATIVE_IOR2] = ior2
        survival = 1.0
        if depth >= RUSSIAN_ROULETTE_DEPTH:
            # The square root minimizes cost times error: the remaining radiance of a path varies more than its
            # throughput.
            survival = ti.min(ti.sqrt(throughput_onward.max() * ior2), MAX_SURVIVAL)
        if u < survival and throughput_onward.max() > 0.0:
            continues = True
            set3(state, i, THROUGHPUT, throughput_onward * (1.0 / survival))
            state[i][PDF] = scattering.onward.w
            state[i][DIFFUSE_FRACTION] = scattering.diffuse_parts.y
            state[i][SPREAD] = ti.max(state[i][SPREAD], SCATTERED_SPREAD / ti.sqrt(scattering.onward.w))
            set3(state, i, ORIGIN, surface.position)
            write_ray(rays, i, offset_origin(surface, scattering.direction), scattering.direction, ti.math.inf)
    return continues


@ti.kernel
@bundled
def shade(
    geometry: Geometry,
    materials: Materials,
    textures: Textures,
    light_values: Floats2,
    light_nodes: Float8s1,
    light_distribution: Floats1,
    energy: Floats1,
    cache: RadianceCache,
    cache_depth: ti.i32,
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
    segments: ti.i32,
    nodes: Float8s1,
    leaf_blocks: Float4s1,
    instances: Ints2,
    root: ti.i32,
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
    any_extended: Template,
    any_links: Template,
    traces: Template,
    keys: Ints1,
    stacked: Template,
):
    """Shade the hits of the paths in queue[0..count) and generate their next segments and shadow rays.

    The first 18 arguments are the scene, see `PathScene.arrays`.

    Args:
        cache: Light in which paths may end.
        cache_depth: After how many surfaces they still may; 0: the cache is not read.
        pixels: See `upload_pixels`; path first + i belongs to pixels[(first + i) // spp].
        first: Number of the path in row 0.
        spp: Samples per pixel.
        bits: Bits that number all samples of a pixel.
        frame_key: Key of the random numbers.
        step: Number of times the paths were advanced before; it selects their random numbers.
        max_depth: Largest number of segments of a path.
        mis: Which emission counts that paths find, see `lights.intersect`.
        background_red, background_green, background_blue: Radiance of camera rays that hit nothing; negative red shows
            the lights at infinity.
        first_sample: Number of the first of the `spp` samples in each pixel.
        segments: How many segments of each path to shade, if it does not end. From the second on they are traced here,
            and so are the shadow rays before.
        nodes, leaf_blocks, instances, root: The tree to trace them through, see `bvh8.closest`.
        any_emission: Compile-time: whether a material is emissive.
        any_extended: Compile-time: whether a material has extended lobes.
        any_links: Compile-time: whether light or shadow linking restricts a light.
        traces: Compile-time: whether `segments` may be more than one.
        keys, stacked: `FrameStack.arguments`.
    """
    lights = ti.static(
        lights_of(light_values, light_nodes, light_distribution, geometry, materials, any_emission, any_links)
    )
    # Vectors must be created inside the loop: in vector mode, memory of vectors created before it is not aligned.
    taken = 0
    for iteration in range(iterations(count)):
        k, end = first_items(taken, iteration, count, TAKEN_PATHS)
        while k < end:
            i = queue[k]
            k, end = next_item(taken, k, end, count, TAKEN_PATHS)
            for segment in range(segments):
                if ti.static(traces):
                    if segment > 0:
                        trace_path(
                            i, nodes, leaf_blocks, geometry, instances, root, rays, hits, hit_ids, shadow_rays,
                            occluded, status,
                        )  # fmt: skip
                this_step = step + segment
                first_set = FIRST_STEP_SET + SETS * this_step
                single_texture_key = set_key(frame_key, first_set + TEXTURE_SET)
                origin, direction = ray_origin(rays, i), ray_direction(rays, i)
                throughput, radiance = get3(state, i, THROUGHPUT), get3(state, i, RADIANCE)
                pdf, diffuse_fraction, last_vertex = state[i][PDF], state[i][DIFFUSE_FRACTION], get3(state, i, ORIGIN)
                status_bits = status[i]
                # Next-event estimation of the previous vertex: its shadow ray has been traced.
                if (status_bits & LIGHT_PENDING) != 0 and occluded[i] == 0:
                    radiance += get3(state, i, DIRECT)
                depth, instance = status_bits & DEPTH_MASK, hit_ids[i][0]
                if depth >= 1 and depth <= cache_depth and instance >= 0:
                    known, cached = cached_radiance(
                        cache, geometry, materials.info, lights, i, rays, hits, hit_ids, state, status_bits
                    )
                    if known != 0:
                        set3(state, i, RADIANCE, radiance + throughput * cached)
                        status[i] = 0
                        break
                continues, sampled = False, 0
                link_class = status_bits >> LINK_CLASS_SHIFT
                last_link_class = link_class

                light, distance = nearest_light(lights, depth, origin, direction, hits[i][0])
                # At the last vertex of a path only emission counts: a surface that cannot emit need not be evaluated.
                # It has no features, as with `finish_at_lights`: else a frame would tell whether a later object emits.
                is_last, skip_surface = depth > 0 and depth + 1 >= max_depth, False
                if instance >= 0 and is_last:
                    material_row = geometry.triangle_material[hit_ids[i][1]]
                    skip_surface = (materials.info[material_row, FLAGS] & (COVERAGE | EMITS)) == 0
                emitted = vec3(0.0)  # radiance that arrives along the segment
                emits, triangle, emission, previous_depth = False, -1, vec3(0.0), depth
                if light < 0 and instance < 0 and pdf == 0.0 and background_red >= 0.0:
                    emitted = vec3(background_red, background_green, background_blue)
                elif light >= 0 or instance < 0:
                    emits = True
                elif not skip_surface:
                    surface = surface_at(geometry, instance, hit_ids[i][1], hits[i][1], hits[i][2], CURRENT, direction)
                    index = path_index(pixels, first + i, spp, bits, first_sample)
                    key, texture_key = key_of(frame_key, keys, first + i, stacked), single_texture_key
                    if ti.static(stacked):
                        texture_key = set_key(key, first_set + TEXTURE_SET)
                    footprint_width = hits[i][0] * state[i][SPREAD]
                    material = shaded_material_at(
                        materials, textures, surface, direction, footprint_width, combine(texture_key, index)
                    )
                    # A hit of a partially opaque surface is accepted with probability `opacity`.
                    alpha_rejected = False
                    if material.flags & COVERAGE:
                        alpha_rejected = draw(set_keys(key, first_set + OPACITY_SET), index).x >= material.opacity
                    if material.flags & UNSEEN and depth == 0:
                        alpha_rejected = True
                    if alpha_rejected:
                        continues = True
                        write_ray(rays, i, offset_origin(surface, direction), direction, ti.math.inf)
                    else:
                        if ti.static(any_emission):
                            if material.flags & EMITS:
                                emits, triangle, distance = True, hit_ids[i][1], hits[i][0]
                                emission = material.emissive_color
                        depth += 1
                        if ti.static(any_links):
                            link_class = geometry.instance_info[instance, INFO_LINK_CLASS]
                        if ti.static(any_extended):
                            throughput *= transmittance(materials, surface, hits[i][0])
                        wo = -1.0 * direction
                        normal = shading_normal(surface, material, wo)
                        if (status_bits & FEATURES_WRITTEN) == 0 and not is_last and is_mirror_like(material) == 0:
                            status_bits |= FEATURES_WRITTEN
                            # Bright as it shines: else black lamps would count as surfaces in very much light.
                            write3(features, i, ALBEDO, ti.min(material.diffuse_color + emission, 1.0))
                            write3(features, i, NORMAL, normal)
                        if depth < max_depth:
                            light_u = draw(set_keys(key, first_set + LIGHT_SET), index)
                            # Glass receives light from both sides: a zero normal excludes no light.
                            lit_normal = normal * ti.cast((material.flags & (GLASS | TRANSLUCENT)) == 0, ti.f32)
                            light_sample = dispatch.sample(lights, textures, surface.position, lit_normal, light_u)
                            if ti.static(any_links):
                                light_sample.pdf *= is_linked(lights, light_sample.row, link_class)
                            bsdf_u = draw(set_keys(key, first_set + DIRECTION_SET), index)
                            lobe_and_survival = vec2(0.0)
                            if (material.flags & MATTE) == 0 or depth >= RUSSIAN_ROULETTE_DEPTH:
                                lobe_and_survival = draw(set_keys(key, first_set + LOBE_SET), index)
                            scattering_u = vec3(bsdf_u, lobe_and_survival.x)
                            scattering = (
                                extended_bsdf.scatter(
                                    materials, textures, surface, material, energy, normal, direction, footprint_width,
                                    combine(texture_key, index), light_sample.direction, scattering_u,
                                )
                                if ti.static(any_extended)
                                else bsdf.scatter(
                                    surface, material, energy, normal, wo, light_sample.direction, scattering_u
                                )
                            )  # fmt: skip

                            # Direct lighting: the shadow ray decides at the next step whether DIRECT counts.
                            if light_sample.pdf > 0.0:
                                light_row = light_sample.row
                                direct = direct_light(lights, light_sample, scattering, throughput, depth, mis)
                                if light_values[light_row, SHADOWLESS] > 0.0:
                                    radiance += direct
                                elif direct.max() > 0.0:
                                    start, towards, reach = shadow_ray(lights, surface, light_sample)
                                    nearer = reach * (1.0 - LIGHT_FRONT)
                                    if is_blocked_by_light(lights, light_row, start, towards, nearer) == 0:
                                        sampled = LIGHT_PENDING
                                        write_ray(shadow_rays, i, start, towards, reach)
                                        if ti.static(any_links):
                                            shadow_rays[i][LINKS] = light_values[light_row, SHADOWING] + 1.0
                                        set3(state, i, DIRECT, direct)
                            continues = continue_path(
                                i, rays, state, surface, scattering, throughput, depth, lobe_and_survival.y
                            )
                if emits:
                    emitted = weighted_emission(
                        lights, textures, light, instance_in_frame(instance, keys, stacked), triangle, emission,
                        origin, direction, distance, last_vertex, pdf, diffuse_fraction, previous_depth, mis,
                        last_link_class,
                    )  # fmt: skip
                if emitted.max() > 0.0:
                    radiance += throughput * emitted
                # Paths that end before any feature was written have the feature of a visible light, or none.
                if (status_bits & FEATURES_WRITTEN) == 0 and not is_last and (this_step == 0 or not continues):
                    write3(features, i, ALBEDO, vec3(0.0) if continues else ti.min(throughput * emitted, 1.0))
                    write3(features, i, NORMAL, vec3(0.0))
                set3(state, i, RADIANCE, radiance)
                status_bits = depth | (status_bits & FEATURES_WRITTEN) | sampled
                if continues:
                    status_bits |= LIVE
                if ti.static(any_links):
                    status_bits |= link_class << LINK_CLASS_SHIFT
                status[i] = status_bits
                if not continues:
                    break
