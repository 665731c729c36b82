# SPDX-License-Identifier: Apache-2.0
"""The last edge of a path where no surface emits: only whether it reaches a light can count, so it is a shadow ray."""

import taichi as ti

from tiscene.device.kernel_types import Float8s1, Floats1, Floats2, Ints1, Ints2, vec3
from tiscene.render.integrators.path.path_state import (
    DEPTH_MASK,
    DIFFUSE_PART,
    DIRECT,
    ORIGIN,
    PDF,
    RADIANCE,
    SAMPLED,
    THROUGHPUT,
    States,
    get3,
    set3,
)
from tiscene.render.intersect.ray_queue import Rays, ray_direction, ray_origin, write_ray
from tiscene.render.lights.intersect import LIGHT_FRONT, nearest_light, seen_lights
from tiscene.render.lights.light_sample import FAR, LightTables
from tiscene.render.texture_lookup import Textures


@ti.kernel
def finish(
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
):
    """End the paths in the queue. Rays that would meet a light become shadow rays towards it."""
    textures = ti.static(Textures(texture_info, texture_words, texture_floats))
    lights = ti.static(LightTables(light_values, light_nodes, light_distribution))
    for k in range(count):
        i = queue[k]
        if (status[i] & SAMPLED) != 0 and occluded[i] == 0:
            set3(state, i, RADIANCE, get3(state, i, RADIANCE) + get3(state, i, DIRECT))
        depth = status[i] & DEPTH_MASK
        status[i] = 0
        origin, direction = ray_origin(rays, i), ray_direction(rays, i)
        pdf, part, last_vertex = state[i][PDF], state[i][DIFFUSE_PART], get3(state, i, ORIGIN)
        light, distance = nearest_light(lights, origin, direction, ti.math.inf)
        reach = distance * (1.0 - LIGHT_FRONT) if light >= 0 else FAR
        seen = seen_lights(
            lights, textures, light, -1, -1, vec3(0.0), origin, direction, distance, last_vertex, pdf, part, depth, mis
        )
        if seen.max() > 0.0:
            set3(state, i, DIRECT, get3(state, i, THROUGHPUT) * seen)
            write_ray(shadow_rays, i, origin, direction, reach)
            status[i] = SAMPLED
