# SPDX-License-Identifier: Apache-2.0
"""Shadow rays through partially opaque surfaces, and through those that cast no shadow in a light (shadow linking).

A surface whose material has an alpha channel (`material_table.COVERAGE`) is hit with probability `opacity`. A shadow
ray whose hit is alpha-rejected continues behind the surface; `PathPass.cast_shadows` traces the continued rays again.
Where a light has shadow linking, rays to it also continue behind meshes that are not linked.
"""

import taichi as ti

from tiscene.device.argument_bundles import bundled
from tiscene.device.kernel_types import Float8s1, Floats1, Floats2, Ints1, Template
from tiscene.render.bsdfs.material_inputs import Footprint, Materials, material_at
from tiscene.render.integrators.path.frame_stack import key_of
from tiscene.render.intersect.ray_queue import (
    LINKS,
    PLACE,
    HitIds,
    Hits,
    Pixels,
    Rays,
    ray_direction,
    ray_origin,
    write_ray,
)
from tiscene.render.intersect.surface_interaction import Geometry, offset_origin, surface_at
from tiscene.render.sampling.sobol import combine, set_key, uniform
from tiscene.render.texture_lookup import Textures
from tiscene.scene.instance_upload import INFO_LINK_CLASS
from tiscene.scene.material_table import COVERAGE, OPACITY
from tiscene.scene.placement import CURRENT

_SHADOW_SETS = 1 << 20  # number of the first set of random numbers for shadow rays, beyond the sets of any path
# t_max of a ray whose visibility is known: tracing it again finds no hit, and t_max > 0 still holds.
_RESOLVED = 1e-30


@ti.func
def continue_behind(shadow_rays: Template, i: ti.i32, surface: Template, t_max: ti.f32):
    """Let a ray begin behind a surface that it hit; returns whether a part of it is left."""
    links, direction = shadow_rays[i][LINKS], ray_direction(shadow_rays, i)
    start = offset_origin(surface, direction)
    traveled = (start - ray_origin(shadow_rays, i)).dot(direction)
    write_ray(shadow_rays, i, start, direction, t_max - traveled)
    shadow_rays[i][LINKS] = links
    return t_max > traveled


@ti.kernel
@bundled
def continue_shadow_rays(
    geometry: Geometry,
    materials: Materials,
    textures: Textures,
    light_values: Floats2,
    light_nodes: Float8s1,
    light_distribution: Floats1,
    energy: Floats1,
    pixels: Pixels,
    first: ti.i32,
    spp: ti.i32,
    frame_key: ti.i32,
    step: ti.i32,
    layer: ti.i32,
    queue: Ints1,
    count: ti.i32,
    shadow_rays: Rays,
    hits: Hits,
    hit_ids: HitIds,
    occluded: Ints1,
    first_sample: ti.i32,
    any_shadow_links: Template,
    keys: Ints1,
    stacked: Template,
) -> ti.i32:
    """Resolve the hits of shadow rays: accept them as occlusion, or continue the rays behind alpha-rejected surfaces.

    Args:
        pixels: See `upload_pixels`; with first, spp and first_sample they identify the random numbers of each path.
        step: Number of times the paths were advanced before.
        layer: Number of surfaces that the rays may have passed already.
        queue: Rows of the rays; count: their number.
        occluded: Output, i32 [ray]. It is 1 for a continued ray too, which holds if the ray is not traced again.
        any_shadow_links: Compile-time: whether the rays' LINKS say which meshes cast shadows in their lights.
        keys, stacked: `FrameStack.arguments`.

    Returns:
        The number of rays that continue.
    """
    continued = 0
    single_key = set_key(frame_key, _SHADOW_SETS + (step << 8) + layer)
    for k in range(count):
        i = queue[k]
        t_max = shadow_rays[i][7]
        if t_max > _RESOLVED:
            instance = hit_ids[i][0]
            passes = False
            if instance < 0:
                occluded[i] = 0
            else:
                occluded[i] = 1
                direction = ray_direction(shadow_rays, i)
                surface = surface_at(geometry, instance, hit_ids[i][1], hits[i][1], hits[i][2], CURRENT, direction)
                material = material_at(materials, textures, surface, 1 << OPACITY, Footprint())
                is_unlinked = False
                if ti.static(any_shadow_links):
                    table = ti.cast(shadow_rays[i][LINKS], ti.i32) - 1
                    if table >= 0:
                        link_class = geometry.instance_info[instance, INFO_LINK_CLASS]
                        is_unlinked = light_distribution[table + link_class] == 0.0
                    if is_unlinked:
                        passes = continue_behind(shadow_rays, i, surface, t_max)
                if material.flags & COVERAGE and not is_unlinked:
                    shadow_key = single_key
                    if ti.static(stacked):
                        frame = key_of(frame_key, keys, first + i, stacked)
                        shadow_key = set_key(frame, _SHADOW_SETS + (step << 8) + layer)
                    key = combine(shadow_key, ti.cast(pixels[(first + i) // spp][PLACE], ti.u32))
                    if uniform(combine(key, ti.cast(first_sample + (first + i) % spp, ti.u32))) >= material.opacity:
                        passes = continue_behind(shadow_rays, i, surface, t_max)
            if passes:
                continued += 1  # integer sums do not depend on the order
            else:
                shadow_rays[i][7] = _RESOLVED
    return continued
