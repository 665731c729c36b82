# SPDX-License-Identifier: Apache-2.0
"""Find the cells that the paths of a frame look up and the table lacks."""

import taichi as ti

from tiscene.device.argument_bundles import bundled
from tiscene.device.kernel_types import Ints1, vec2
from tiscene.render.integrators.light_cache.cells import CellList, Cells, cell_for, find, lookup_width
from tiscene.render.integrators.path.path_state import FEATURES_WRITTEN, SPREAD, States
from tiscene.render.integrators.path.shading import SETS, TEXTURE_SET
from tiscene.render.integrators.path.wavefront_kernels import FIRST_STEP_SET, path_index
from tiscene.render.intersect.ray_queue import HitIds, Hits, Pixels, Rays, ray_direction
from tiscene.render.intersect.surface_interaction import Geometry, surface_at
from tiscene.render.sampling.sobol import draw, set_keys
from tiscene.scene.placement import CURRENT


@ti.kernel
@bundled
def collect_missing(
    geometry: Geometry,
    cells: Cells,
    cell_width: ti.f32,
    pixels: Pixels,
    first: ti.i32,
    spp: ti.i32,
    bits: ti.i32,
    frame_key: ti.i32,
    step: ti.i32,
    queue: Ints1,
    count: ti.i32,
    rays: Rays,
    hits: Hits,
    hit_ids: HitIds,
    state: States,
    status: Ints1,
    first_sample: ti.i32,
    missing: CellList,
    missing_count: Ints1,
):
    """Append the cells that `shade` will look up at the hits of queue[0..count) and the table lacks.

    Cells may occur several times, in any order.

    Args:
        missing: Output, room for two cells per path.
        missing_count: Output, i32 [1], their number; must be 0 before.
    """
    first_set = FIRST_STEP_SET + SETS * step
    for k in range(count):
        i = queue[k]
        instance = hit_ids[i][0]
        if instance >= 0:
            direction = ray_direction(rays, i)
            surface = surface_at(geometry, instance, hit_ids[i][1], hits[i][1], hits[i][2], CURRENT, direction)
            index = path_index(pixels, first + i, spp, bits, first_sample)
            reflected = ti.cast((status[i] & FEATURES_WRITTEN) != 0, ti.i32)
            width = lookup_width(hits[i][0], state[i][SPREAD], cell_width, reflected)
            jitter = draw(set_keys(frame_key, first_set + TEXTURE_SET), index)
            for number in range(2):  # the displaced point's cell, and the point's own, as in `shade`
                each = cell_for(instance, width, surface, direction, jitter if number == 0 else vec2(0.5))
                if find(cells, each) < 0:
                    missing[ti.atomic_add(missing_count[0], 1)] = each
