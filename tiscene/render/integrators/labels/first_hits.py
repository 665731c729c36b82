# SPDX-License-Identifier: Apache-2.0
"""First hits for labels: a surface is present where its opacity is at least one half, and invisible elsewhere.

Leaves and lace are often rectangles with an opacity texture (`material_table.COVERAGE`). The path pass accepts a hit
with probability `opacity`; a label has to decide. Surfaces that the camera does not see (UNSEEN) are never present.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.argument_bundles import bundled
from tiscene.device.kernel_types import Bytes2, Ints1, Template
from tiscene.device.memory import device_array
from tiscene.device.restart import cached_on_device
from tiscene.render.bsdfs.material_inputs import Footprint, Materials, material_at
from tiscene.render.integrators.labels import label_kernels as kernels
from tiscene.render.integrators.labels.label_frames import LabelFrames
from tiscene.render.intersect.ray_queue import HitIds, Hits, RayArrays, Rays, TracedRays, ray_direction
from tiscene.render.intersect.surface_interaction import Geometry, geometry_of, offset_origin, surface_at
from tiscene.render.intersect.trace import closest
from tiscene.render.texture_lookup import Textures
from tiscene.render.view import CubeView, View
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.material_table import COVERAGE, FLAGS, OPACITY, UNSEEN, MaterialArrays
from tiscene.scene.placement import CURRENT, MOVERS

OPACITY_THRESHOLD = 0.5
MAX_LAYERS = 32  # after this many rejected hits, the next one counts as present
TRAVELED = 3  # column of a ray: distance of its origin from the original one


def first_hits(
    scene: DeviceScene,
    time: int,
    rays: TracedRays,
    queue: Any,
    count: int,
    *,
    coherent: bool = False,
    rays_per_frame: int = 0,
    materials: MaterialArrays | None = None,
) -> None:
    """Trace rays and write their hits and hit_ids, skipping alpha-rejected surfaces.

    Distances are measured from the original origins. Rays that passed a surface are modified.

    Args:
        scene: The scene.
        time: PREVIOUS, CURRENT, NEXT or MOVERS.
        rays: The rays and their hits.
        queue: i32 rows on the device; count: their number.
        coherent: See `closest`.
        rays_per_frame: See `closest`.
        materials: Those of the time. None: those of CURRENT.
    """
    closest(scene, time, rays.rays, queue, count, rays.hits, rays.hit_ids, coherent, rays_per_frame)
    if not scene.materials.any_coverage:
        return
    materials = materials or scene.materials.arrays()
    for layer in range(MAX_LAYERS):
        next_queue = rays.next_queues[layer % 2]
        count = reject_transparent_hits(
            queue, count, rays.rays, rays.hits, rays.hit_ids,
            *geometry_of(scene, time), *materials, *scene.textures.arrays(),
            CURRENT if time == MOVERS else time, next_queue, counter(),
        )  # fmt: skip
        queue = next_queue
        if count == 0:
            return
        closest(scene, time, rays.rays, queue, count, rays.hits, rays.hit_ids, rays_per_frame=rays_per_frame)


def center_hits(scene: DeviceScene, view: View | CubeView, rays: RayArrays, *, coherent: bool = False) -> RayArrays:
    """Trace the rays through the centers of all pixels of a view at CURRENT, see `first_hits`, and return them."""
    rays = rays.resized(view.width, view.height)
    kernels.primary_rays(rays.queue, rays.count, view.array(), view.width, view.height, rays.rays, False)
    first_hits(scene, CURRENT, rays, rays.queue, rays.count, coherent=coherent)
    return rays


@dataclass(frozen=True, eq=False)
class StaticHits:
    """First hits of a view's pixel centers on the instances that do not move.

    Attributes:
        rays: The rays, with their hits, which rendering labels changes.
        moving: bool [n], the other instances.
    """

    rays: RayArrays
    moving: NDArray[np.bool_]


@ti.kernel
def keep_nearer(
    queue: Ints1,
    count: ti.i32,
    other_rays: Rays,
    other_hits: Hits,
    other_ids: HitIds,
    rays: Rays,
    hits: Hits,
    hit_ids: HitIds,
    passed: Ints1,
    passed_count: Ints1,
) -> ti.i32:
    """Replace hits by others of the same rays that are nearer; at the same distance, by those of lower rows.

    Rays that have passed a transparent surface went on from there, and would have hit others a rounding error away.

    Args:
        passed: Output, rows of these rays, whose hits are to be found with all instances.
        passed_count: Scratch, i32 [1].

    Returns:
        Their number.
    """
    passed_count[0] = 0
    for i in range(count):
        ray = queue[i]
        here, there = hits[ray][0], other_hits[ray][0]
        if there < here or (there == here and other_ids[ray][0] < hit_ids[ray][0]):
            hits[ray] = other_hits[ray]
            hit_ids[ray] = other_ids[ray]
        if rays[ray][TRAVELED] > 0.0 or other_rays[ray][TRAVELED] > 0.0:
            passed[ti.atomic_add(passed_count[0], 1)] = ray
    return passed_count[0]


@cached_on_device(maxsize=1)
def counter() -> Any:
    """Return a device array, i32 [1], for kernels to count in."""
    return device_array(ti.i32, (1,))


@ti.func
def is_transparent(materials: Template, textures: Template, surface: Template):
    """Return whether labels show what is behind a surface of partial coverage."""
    return material_at(materials, textures, surface, 1 << OPACITY, Footprint()).opacity < OPACITY_THRESHOLD


@ti.kernel
@bundled
def reject_transparent_hits(
    queue: Ints1,
    count: ti.i32,
    rays: Rays,
    hits: Hits,
    hit_ids: HitIds,
    geometry: Geometry,
    materials: Materials,
    textures: Textures,
    time: ti.i32,
    next_queue: Ints1,
    next_count: Ints1,
) -> ti.i32:
    """Move rays with alpha-rejected hits behind the surface, append them to `next_queue`, and return their number.

    Args:
        next_count: Scratch, i32 [1].
    """
    next_count[0] = 0
    for i in range(count):
        ray = queue[i]
        row = hit_ids[ray][0]
        step = hits[ray][0]
        hits[ray][0] = rays[ray][TRAVELED] + step
        may_be_rejected, is_unseen = False, False
        if row >= 0:
            flags = materials.info[geometry.triangle_material[hit_ids[ray][1]], FLAGS]
            may_be_rejected, is_unseen = flags & (COVERAGE | UNSEEN) != 0, flags & UNSEEN != 0
        if may_be_rejected:
            direction = ray_direction(rays, ray)
            surface = surface_at(geometry, row, hit_ids[ray][1], hits[ray][1], hits[ray][2], time, direction)
            if is_unseen or is_transparent(materials, textures, surface):
                origin = offset_origin(surface, direction)
                for c in ti.static(range(3)):
                    rays[ray][c] = origin[c]
                rays[ray][TRAVELED] += step
                rays[ray][7] -= step
                next_queue[ti.atomic_add(next_count[0], 1)] = ray
    return next_count[0]


def find_occlusion(
    scene: DeviceScene,
    frames: LabelFrames,
    time: int,
    materials: MaterialArrays,
    points: RayArrays,
    sight: RayArrays,
    queue: Any,
    count: int,
    occluded: Any,
) -> None:
    """Write whether points of surfaces are not visible at a time.

    They are not where another surface is in front, or they are outside of the image, not present, or alpha-rejected.

    Args:
        scene: The scene.
        frames: The cameras, and the motion of the instances.
        time: PREVIOUS, CURRENT or NEXT.
        materials: Those of the time.
        points: The points, as hits.
        sight: Scratch, as many rows, for rays from the camera of that time to the points.
        queue: i32 rows on the device; count: their number.
        occluded: Output, bool as u8 [rows / width, width].
    """
    width = occluded.shape[1]
    kernels.occlusion_rays(
        queue, count, time, points.hits, points.hit_ids,
        scene.vertex_position, scene.triangle_vertices, scene.instance_info, scene.world_from_instance,
        frames.instance_motion, frames.camera_motion, frames.cameras, frames.width, frames.height,
        sight.rays, sight.distance, frames.stacked,
    )  # fmt: skip
    first_hits(scene, time, sight, queue, count, rays_per_frame=frames.pixels, materials=materials)
    kernels.occlusion_labels(queue, count, points.hit_ids, sight.distance, sight.hits, sight.hit_ids, width, occluded)
    if scene.materials.varies_coverage or scene.placement.color_varies:
        mark_transparent_points(
            queue, count, sight.rays, points.hits, points.hit_ids,
            *geometry_of(scene, time), *materials, *scene.textures.arrays(), time, width, occluded,
        )  # fmt: skip


@ti.kernel
@bundled
def mark_transparent_points(
    queue: Ints1,
    count: ti.i32,
    rays: Rays,
    hits: Hits,
    hit_ids: HitIds,
    geometry: Geometry,
    materials: Materials,
    textures: Textures,
    time: ti.i32,
    width: ti.i32,
    occluded: Bytes2,
):
    """Write 1 for points whose surface has an opacity below OPACITY_THRESHOLD; see `find_occlusion`."""
    for i in range(count):
        point = queue[i]
        row = hit_ids[point][0]
        if row >= 0 and materials.info[geometry.triangle_material[hit_ids[point][1]], FLAGS] & COVERAGE != 0:
            direction = ray_direction(rays, point)
            surface = surface_at(geometry, row, hit_ids[point][1], hits[point][1], hits[point][2], time, direction)
            if is_transparent(materials, textures, surface):
                occluded[point // width, point % width] = ti.u8(1)
