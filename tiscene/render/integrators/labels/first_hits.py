# SPDX-License-Identifier: Apache-2.0
"""First hits as labels see them: a surface that is more than half absent where a ray meets it is not there.

Leaves and lace are rectangles whose opacity is painted (`material_table.COVERAGE`). The path pass lets a part of the
light through; a label has to decide.
"""

from typing import Any

import numpy as np
import taichi as ti

from tiscene.device.kernel_types import Floats1, Floats2, Floats3, Ints1, Ints2
from tiscene.render.bsdfs.material_inputs import Footprint, Materials, material_at
from tiscene.render.intersect.ray_queue import HitIds, Hits, RayArrays, Rays, RayWave, ray_direction
from tiscene.render.intersect.surface_interaction import Geometry, geometry_of, offset_origin, surface_at
from tiscene.render.intersect.trace import closest
from tiscene.render.texture_lookup import Textures
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.material_table import COVERAGE, FLAGS, OPACITY
from tiscene.scene.placement import CURRENT, MOVERS

PRESENT_FROM = 0.5  # opacity
MAX_LAYERS = 32  # the last of so many absent surfaces behind each other counts as present
TRAVELLED = 3  # column of a ray: how far from its first origin it starts


def first_hits(
    scene: DeviceScene, time: int, rays: RayArrays | RayWave, queue: Any, count: int, *, together: bool = False
) -> None:
    """Trace rays of a queue and fill their hits and hit_ids; distances count from where the rays began.

    time: or MOVERS.
    Rays that pass through something are moved on: their rows are not what they were. together: as for `closest`.
    """
    closest(scene, time, rays.rays, queue, count, rays.hits, rays.hit_ids, coherent=together)
    if not scene.materials.any_coverage:
        return
    for layer in range(MAX_LAYERS):
        further = rays.next_queues[layer % 2]
        found = np.zeros(1, np.int32)
        pass_absent(
            queue,
            count,
            rays.rays,
            rays.hits,
            rays.hit_ids,
            *geometry_of(scene),
            *scene.materials.arrays(),
            *scene.textures.arrays(),
            CURRENT if time == MOVERS else time,
            further,
            found,
        )
        queue, count = further, int(found[0])
        if count == 0:
            return
        closest(scene, time, rays.rays, queue, count, rays.hits, rays.hit_ids)


@ti.kernel
def pass_absent(
    queue: Ints1,
    count: ti.i32,
    rays: Rays,
    hits: Hits,
    hit_ids: HitIds,
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
    time: ti.i32,
    further: Ints1,
    further_count: Ints1,
):
    """Put rays that met something absent into the queue `further`, to go on behind it."""
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
    for i in range(count):
        ray = queue[i]
        row = hit_ids[ray][0]
        step = hits[ray][0]
        hits[ray][0] = rays[ray][TRAVELLED] + step
        may_be_absent = False
        if row >= 0:
            may_be_absent = material_info[triangle_material[hit_ids[ray][1]], FLAGS] & COVERAGE != 0
        if may_be_absent:
            direction = ray_direction(rays, ray)
            surface = surface_at(geometry, row, hit_ids[ray][1], hits[ray][1], hits[ray][2], time, direction)
            if material_at(materials, textures, surface, 1 << OPACITY, Footprint()).opacity < PRESENT_FROM:
                origin = offset_origin(surface, direction)
                for c in ti.static(range(3)):
                    rays[ray][c] = origin[c]
                rays[ray][TRAVELLED] += step
                rays[ray][7] -= step
                further[ti.atomic_add(further_count[0], 1)] = ray
