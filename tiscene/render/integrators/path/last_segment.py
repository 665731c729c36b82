# SPDX-License-Identifier: Apache-2.0
"""The last segment of a path in scenes whose surfaces do not emit and are never alpha-rejected.

Such a segment contributes only if it reaches a light, so a shadow ray toward that light replaces the closest-hit query
and the shading of the last vertex.
"""

import taichi as ti

from tiscene.device.kernel_types import Float8s1, Floats1, Floats2, Ints1, Ints2, Template, vec3
from tiscene.render.integrators.path.path_state import (
    DEPTH_MASK,
    DIFFUSE_FRACTION,
    DIRECT,
    LIGHT_PENDING,
    LINK_CLASS_SHIFT,
    ORIGIN,
    PDF,
    RADIANCE,
    THROUGHPUT,
    States,
    get3,
    set3,
)
from tiscene.render.intersect.ray_queue import Rays, ray_direction, ray_origin, write_ray
from tiscene.render.lights.intersect import LIGHT_FRONT, nearest_light, weighted_emission
from tiscene.render.lights.light_sample import FAR, LightTables
from tiscene.render.texture_lookup import Textures


@ti.kernel
def finish_at_lights(
    texture_info: Ints2,
    texture_words: Ints1,
    texture_floats: Floats1,
    light_values: Floats2,
    light_nodes: Float8s1,
    light_distribution: Floats1,
    mis: ti.i32,
    queue: Ints1,
    count: ti.i32,
    rays: Rays,
    shadow_rays: Rays,
    occluded: Ints1,
    state: States,
    status: Ints1,
    any_links: Template,
):
    """End the paths in the queue. Rays whose nearest light emits toward them become shadow rays to that light."""
    textures = ti.static(Textures(texture_info, texture_words, texture_floats))
    lights = ti.static(LightTables(light_values, light_nodes, light_distribution, with_links=any_links))
    for k in range(count):
        i = queue[k]
        if (status[i] & LIGHT_PENDING) != 0 and occluded[i] == 0:
            set3(state, i, RADIANCE, get3(state, i, RADIANCE) + get3(state, i, DIRECT))
        depth, link_class = status[i] & DEPTH_MASK, status[i] >> LINK_CLASS_SHIFT
        status[i] = 0
        origin, direction = ray_origin(rays, i), ray_direction(rays, i)
        pdf, diffuse_fraction, last_vertex = state[i][PDF], state[i][DIFFUSE_FRACTION], get3(state, i, ORIGIN)
        light, distance = nearest_light(lights, depth, origin, direction, ti.math.inf)
        reach = distance * (1.0 - LIGHT_FRONT) if light >= 0 else FAR
        emitted = weighted_emission(
            lights, textures, light, -1, -1, vec3(0.0),
            origin, direction, distance, last_vertex, pdf, diffuse_fraction, depth, mis, link_class,
        )  # fmt: skip
        if emitted.max() > 0.0:
            set3(state, i, DIRECT, get3(state, i, THROUGHPUT) * emitted)
            write_ray(shadow_rays, i, origin, direction, reach)
            status[i] = LIGHT_PENDING
