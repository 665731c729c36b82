# SPDX-License-Identifier: Apache-2.0
"""Paths that movers change: finding them, and adding the change to the light of a frame.

The change of a path is its radiance in the scene with the movers minus that in the static scene, with the same random
numbers. A path that sees a mover first is replaced.
"""

import taichi as ti

from tiscene.device.kernel_types import Floats2, Ints1
from tiscene.render.integrators.path.path_state import (
    DIRECT,
    FEATURE_COLUMNS,
    LIGHT_PENDING,
    RADIANCE,
    States,
    get3,
    set3,
)
from tiscene.render.intersect.ray_queue import HitIds, Hits, Rays


@ti.kernel
def clear_rays(rays: Rays, count: ti.i32):
    """Make rays empty, so that they hit nothing."""
    for i in range(count):
        rays[i][7] = -1.0


@ti.kernel
def add_sharp_light(queue: Ints1, count: ti.i32, rays: Rays, occluded: Ints1, radiance: Floats2, state: States):
    """Add the light of unblocked rays to the paths in a queue."""
    for k in range(count):
        i = queue[k]
        if rays[i][7] > 0.0 and occluded[i] == 0:
            for c in ti.static(range(3)):
                state[i][RADIANCE + c] += radiance[i, c]


@ti.kernel
def copy_segments(rays: Rays, hits: Hits, queue: Ints1, count: ti.i32, segments: Rays):
    """Copy the rays in a queue up to their hits."""
    for k in range(count):
        i = queue[k]
        segments[i] = rays[i]
        segments[i][7] = hits[i][0]


@ti.kernel
def mark(rows: Ints1, count: ti.i32, blocked: Ints1, touched: Ints1):
    """Set `touched` of the rows whose ray is blocked."""
    for k in range(count):
        i = rows[k]
        if blocked[i] != 0:
            touched[i] = 1


@ti.kernel
def note_visible_movers(hit_ids: HitIds, count: ti.i32, moving: Ints1, visible: Ints1):
    """Set visible[i] to whether the first hit of path i is on a mover."""
    for i in range(count):
        instance = hit_ids[i][0]
        visible[i] = moving[instance] if instance >= 0 else 0


@ti.kernel
def store_radiance(count: ti.i32, status: Ints1, occluded: Ints1, state: States, radiance: Floats2):
    """Store the radiance of finished paths."""
    for i in range(count):
        total = get3(state, i, RADIANCE)
        if (status[i] & LIGHT_PENDING) != 0 and occluded[i] == 0:
            total += get3(state, i, DIRECT)
        for c in ti.static(range(3)):
            radiance[i, c] = total[c]


@ti.kernel
def add_changes(
    ranks: Ints1,
    count: ti.i32,
    spp: ti.i32,
    touched: Ints1,
    visible: Ints1,
    with_movers: Floats2,
    without_movers: Floats2,
    new_features: Floats2,
    status: Ints1,
    occluded: Ints1,
    state: States,
    features: Floats2,
):
    """Add the change by movers to the paths of some pixels. Afterwards no shadow ray of these paths is pending.

    Args:
        ranks: Pixels, numbered as in the batch of paths to correct; row k * spp + s of the four arrays of retraced
            paths belongs to path ranks[k] * spp + s.
        count: Number of retraced paths.
        spp: Paths per pixel.
        touched: i32, whether movers may change each path of the batch.
        visible: i32, whether a retraced path sees a mover.
        with_movers: f32 [n, 3], radiance of the retraced paths.
        without_movers: f32 [n, 3], the same in the static scene.
        new_features: f32 [n, FEATURE_COLUMNS], features of the retraced paths.
        status, occluded, state, features: The batch.
    """
    for k in range(count):
        i = ranks[k // spp] * spp + k % spp
        radiance = get3(state, i, RADIANCE)
        if (status[i] & LIGHT_PENDING) != 0 and occluded[i] == 0:
            radiance += get3(state, i, DIRECT)
        if visible[k] != 0:
            for c in ti.static(range(3)):
                radiance[c] = with_movers[k, c]
            for c in ti.static(range(FEATURE_COLUMNS)):
                features[i, c] = new_features[k, c]
        elif touched[i] != 0:
            for c in ti.static(range(3)):
                radiance[c] += with_movers[k, c] - without_movers[k, c]
        set3(state, i, RADIANCE, radiance)
        status[i] &= ~LIGHT_PENDING
