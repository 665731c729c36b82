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

from typing import NamedTuple

import taichi as ti

from tiscene.device.kernel_types import Float8s1, Template, vec3
from tiscene.render.integrators.path.path_state import DEPTH_MASK, FEATURES_WRITTEN, RELATIVE_IOR2, SPREAD
from tiscene.render.intersect.ray_queue import ray_direction, ray_origin
from tiscene.render.intersect.surface_interaction import surface_at
from tiscene.render.lights.intersect import nearest_light
from tiscene.render.sampling.cube import FACE_ANGLE, cell_of
from tiscene.scene.material_table import COVERAGE, EMITS, FLAGS, GLASS, MAY_MIRROR, UNSEEN
from tiscene.scene.placement import CURRENT

FLATNESS = 0.1  # largest distance of a point from the plane of its cell, in widths of the cell
ALIGNED = 0.9  # least cosine between the normals of a point and of its cell
LEAST_LEFT = 4  # segments that a path must have left to end at a later surface than the second


class RadianceCache(NamedTuple):
    """Radiance of the surfaces that one point sees, for cells of a cube around it; a parameter of kernels.

    Attributes:
        cells: On the device, [6 * size * size] of float8, by face, row and column: radiance, W/m²/sr; distance of the
            center from the surface's plane, m; the plane's normal, world, which points to the center; and 0. The normal
            of a cell that is not known is zero.
        size: Cells along a side of a face.
        x, y, z: The point, world, m.
    """

    cells: Float8s1
    size: ti.i32
    x: ti.f32
    y: ti.f32
    z: ti.f32


def last_depth(max_depth: int) -> int:
    """Return after how many surfaces a path of at most so many segments may still end in a cache."""
    return max(1, max_depth - 1 - LEAST_LEFT)


@ti.func
def cached_radiance(
    cache: Template,
    geometry: Template,
    material_info: Template,
    lights: Template,
    i: ti.i32,
    rays: Template,
    hits: Template,
    hit_ids: Template,
    state: Template,
    status: ti.i32,
):
    """Return whether a path may end where its ray hits, 1 or 0, and the radiance that it finds there.

    Args:
        cache: RadianceCache.
        geometry: Geometry.
        material_info: Of Materials.
        lights: LightTables.
        i: Row of the path, whose ray hits a surface.
        rays, hits, hit_ids, state: Of the PathState.
        status: Of the path.
    """
    known, radiance = 0, vec3(0.0)
    if (status & FEATURES_WRITTEN) != 0 and state[i][RELATIVE_IOR2] == 1.0:
        flags = material_info[geometry.triangle_material[hit_ids[i][1]], FLAGS]
        origin, direction, distance = ray_origin(rays, i), ray_direction(rays, i), hits[i][0]
        seen = origin + distance * direction - vec3(cache.x, cache.y, cache.z)
        place = cell_of(seen, cache.size)
        cell = cache.cells[(place[0] * cache.size + place[1]) * cache.size + place[2]]
        normal, width = vec3(cell[4], cell[5], cell[6]), seen.norm() * FACE_ANGLE / cache.size
        looks_alike = (flags & (COVERAGE | EMITS | GLASS | MAY_MIRROR | UNSEEN)) == 0
        is_wide = distance * state[i][SPREAD] > width
        if looks_alike and is_wide and ti.abs(normal.dot(seen) + cell[3]) < FLATNESS * width:
            surface = surface_at(geometry, hit_ids[i][0], hit_ids[i][1], hits[i][1], hits[i][2], CURRENT, direction)
            light, _ = nearest_light(lights, status & DEPTH_MASK, origin, direction, distance)
            if light < 0 and normal.dot(surface.geometric_normal) > ALIGNED:
                known, radiance = 1, vec3(cell[0], cell[1], cell[2])
    return known, radiance
