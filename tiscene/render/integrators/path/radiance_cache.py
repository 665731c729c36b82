# SPDX-License-Identifier: Apache-2.0
"""A radiance cache: light that leaves surfaces, in which paths end that have scattered.

Most of a path's segments find indirect light, which hardly differs over a few centimeters. Where a cache knows the
light of the second surface that a path reaches, it takes that light instead of going on (final gathering; see Křivánek
et al., "Radiance Caching for Efficient Global Illumination Computation", 2005). A cache of paths with one segment less
keeps the largest number of segments. At later surfaces it has more segments than the path would have: paths end there
only while they have several left, since what is beyond those brings hardly any light. A path goes on

- where its footprint is smaller than a cell: near the vertex that it left, and after clear reflections;
- where the cache does not know the surface;
- where surfaces look different from elsewhere, emit light, or exist in part only;
- within solids, and where a light is in front of the surface.

Where the first surface is a mirror, albedo and normal are those of the next surface, and the path goes on there.
"""

from typing import Any, NamedTuple

import taichi as ti

from tiscene.device.argument_bundles import bundled
from tiscene.device.kernel_types import Float8s1, Floats1, Floats2, Ints1, Ints2, Template, vec3
from tiscene.render.integrators.path.path_state import (
    DEPTH_MASK,
    DIRECT,
    FEATURES_WRITTEN,
    LIGHT_PENDING,
    RADIANCE,
    RELATIVE_IOR2,
    SPREAD,
    THROUGHPUT,
    PathState,
    States,
    get3,
    set3,
)
from tiscene.render.integrators.path.wavefront_kernels import compact
from tiscene.render.intersect.ray_queue import HitIds, Hits, Rays, ray_direction, ray_origin
from tiscene.render.intersect.surface_interaction import Geometry, surface_at
from tiscene.render.lights.intersect import nearest_light
from tiscene.render.lights.light_sample import LightTables
from tiscene.render.sampling.cube import FACE_ANGLE, cell_of
from tiscene.scene.material_table import COVERAGE, EMITS, FLAGS, GLASS, MAY_MIRROR, UNSEEN
from tiscene.scene.placement import CURRENT

FLATNESS = 0.1  # largest distance of a point from the plane of its cell, in widths of the cell
ALIGNED = 0.9  # least cosine between the normals of a point and of its cell
LEAST_LEFT = 4  # segments that a path must have left to end at a later surface than the second


class RadianceCache(NamedTuple):
    """Radiance of the surfaces that one point sees, for cells of a cube around it.

    Attributes:
        cells: On the device, [6 * size * size] of float8, by face, row and column: radiance, W/m²/sr; distance of the
            center from the surface's plane, m; the plane's normal, world, which points to the center; and 0. The normal
            of a cell that is not known is zero.
        size: Cells along a side of a face.
        center: The point, world, m.
    """

    cells: Any
    size: int
    center: tuple[float, float, float]


def last_depth(max_depth: int) -> int:
    """Return after how many surfaces a path of at most so many segments may still end in a cache."""
    return max(1, max_depth - 1 - LEAST_LEFT)


def end_in_cache(
    arrays: Any, cache: RadianceCache, state: PathState, live: int, max_depth: int, any_links: bool
) -> int:
    """End those of the first `live` paths of the queue whose rays hit what a cache knows.

    Args:
        arrays: The scene, `SceneArrays`.
        cache: The cache.
        state: The paths, whose rays have been intersected; its queue is compacted.
        live: Number of paths.
        max_depth: Largest number of segments of a path.
        any_links: Whether light or shadow linking restricts a light.

    Returns:
        The number of paths that go on, at the head of the queue.
    """
    _end_in_cache(
        *arrays.surfaces[:8], arrays.material_info, *arrays.lighting[3:], cache.cells, cache.size, *cache.center,
        last_depth(max_depth), state.queue, live, state.rays, state.hits, state.hit_ids, state.occluded, state.state,
        state.status, any_links,
    )  # fmt: skip
    counts = compact(state.status, state.queue, live, state.next_queue, state.shadow_queue, state.chunks)
    state.swap_queues()
    return counts & 0xFFFFFFFF


@ti.kernel
@bundled
def _end_in_cache(
    geometry: Geometry,
    material_info: Ints2,
    light_values: Floats2,
    light_nodes: Float8s1,
    light_distribution: Floats1,
    cells: Float8s1,
    size: ti.i32,
    center_x: ti.f32,
    center_y: ti.f32,
    center_z: ti.f32,
    last_depth: ti.i32,
    queue: Ints1,
    count: ti.i32,
    rays: Rays,
    hits: Hits,
    hit_ids: HitIds,
    occluded: Ints1,
    state: States,
    status: Ints1,
    any_links: Template,
):
    """End the paths of queue[0..count) whose rays hit what a cache knows; their status is 0 afterwards.

    The arguments before `queue` are the scene and a `RadianceCache`, the others as of `shade`.
    """
    lights = ti.static(LightTables(light_values, light_nodes, light_distribution, with_links=any_links))
    for k in range(count):
        i = queue[k]
        depth, instance = status[i] & DEPTH_MASK, hit_ids[i][0]
        has_features = (status[i] & FEATURES_WRITTEN) != 0
        if depth >= 1 and depth <= last_depth and has_features and instance >= 0 and state[i][RELATIVE_IOR2] == 1.0:
            flags = material_info[geometry.triangle_material[hit_ids[i][1]], FLAGS]
            origin, direction, distance = ray_origin(rays, i), ray_direction(rays, i), hits[i][0]
            seen = origin + distance * direction - vec3(center_x, center_y, center_z)
            place = cell_of(seen, size)
            cell = cells[(place[0] * size + place[1]) * size + place[2]]
            normal, width = vec3(cell[4], cell[5], cell[6]), seen.norm() * FACE_ANGLE / size
            looks_alike = (flags & (COVERAGE | EMITS | GLASS | MAY_MIRROR | UNSEEN)) == 0
            is_wide = distance * state[i][SPREAD] > width
            if looks_alike and is_wide and ti.abs(normal.dot(seen) + cell[3]) < FLATNESS * width:
                surface = surface_at(geometry, instance, hit_ids[i][1], hits[i][1], hits[i][2], CURRENT, direction)
                light, _ = nearest_light(lights, depth, origin, direction, distance)
                if light < 0 and normal.dot(surface.geometric_normal) > ALIGNED:
                    radiance = get3(state, i, RADIANCE) + get3(state, i, THROUGHPUT) * vec3(cell[0], cell[1], cell[2])
                    if (status[i] & LIGHT_PENDING) != 0 and occluded[i] == 0:
                        radiance += get3(state, i, DIRECT)
                    set3(state, i, RADIANCE, radiance)
                    status[i] = 0
