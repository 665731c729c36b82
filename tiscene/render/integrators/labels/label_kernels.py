# SPDX-License-Identifier: Apache-2.0
"""The kernels of the label pass. One loop turn is one pixel of a queue; nothing is summed over pixels."""

import taichi as ti

from tiscene.device.kernel_types import Bytes2, Floats1, Floats2, Floats3, Ints1, Ints2, Template, vec2, vec3
from tiscene.render.intersect.ray_queue import HitIds, Hits, Rays, write_ray
from tiscene.render.intersect.surface_interaction import INFO_MOVED, object_point_at, transform_point, vertex_offset
from tiscene.render.view import FORWARD, POSITION, camera_ray, view_vector
from tiscene.scene.placement import CURRENT

# Columns of the instance motion array: three matrices to camera coordinates, then these.
DISPLACEMENT, PRESENT, MOTION_COLUMNS = 36, 48, 51
FOCAL_LENGTH, ORTHOGRAPHIC = 9, 10  # of the camera motion array, after a rotation

# A point closer to a camera's plane than this, or behind it, is projected as if it were here: it has no place in that
# picture, and so gets a finite flow that leads far out of it. m
_NEAREST = 1e-4
# A hit this much short of a point, as a part of its distance, is the point itself: on another instance, on its own.
_TOLERANCE = 1e-5
_OWN_TOLERANCE = 1e-4


@ti.func
def affine(rows: Template, row: ti.i32, column: ti.i32, p: vec3) -> vec3:
    """A point by the 3x4 matrix that starts at a column of a row."""
    return vec3(
        rows[row, column] * p.x + rows[row, column + 1] * p.y + rows[row, column + 2] * p.z + rows[row, column + 3],
        rows[row, column + 4] * p.x + rows[row, column + 5] * p.y + rows[row, column + 6] * p.z + rows[row, column + 7],
        rows[row, column + 8] * p.x + rows[row, column + 9] * p.y + rows[row, column + 10] * p.z
        + rows[row, column + 11],
    )  # fmt: skip


@ti.func
def rotate(rows: Template, row: ti.i32, v: vec3) -> vec3:
    """A vector by the 3x3 matrix in the first columns of a row."""
    return vec3(
        rows[row, 0] * v.x + rows[row, 1] * v.y + rows[row, 2] * v.z,
        rows[row, 3] * v.x + rows[row, 4] * v.y + rows[row, 5] * v.z,
        rows[row, 6] * v.x + rows[row, 7] * v.y + rows[row, 8] * v.z,
    )


@ti.func
def from_principal_point(p: vec3, camera_motion: Template, time: ti.i32) -> vec2:
    """Where a point in camera coordinates of that time appears, px right and down of the picture's center."""
    scale = camera_motion[time, FOCAL_LENGTH]
    if camera_motion[time, ORTHOGRAPHIC] == 0.0:
        scale = scale / ti.max(p.z, _NEAREST)
    return vec2(p.x, p.y) * scale


@ti.func
def seen_from(
    time: ti.i32,
    row: ti.i32,
    object_point: vec3,
    towards: vec3,
    instance_motion: Template,
    camera_motion: Template,
) -> vec3:
    """A pixel's point in the coordinates of the camera of that time; of the background (row < 0) its direction, which
    is infinitely far and so only turns."""
    point = rotate(camera_motion, time, towards)
    if row >= 0:
        point = affine(instance_motion, row, 12 * time, object_point)
    return point


@ti.func
def point_then(
    vertex_position: Template,
    triangle_vertices: Template,
    instance_info: Template,
    row: ti.i32,
    triangle: ti.i32,
    b1: ti.f32,
    b2: ti.f32,
    now: vec3,
    time: ti.i32,
) -> vec3:
    """Where a point that is at `now` in the space of its mesh is there at another time."""
    point = now
    if row >= 0:
        if instance_info[row, INFO_MOVED] > 0:
            moved = vertex_offset(instance_info, row, time)
            point = object_point_at(vertex_position, triangle_vertices, triangle, b1, b2, moved)
    return point


@ti.kernel
def primary_rays(queue: Ints1, count: ti.i32, view: Floats2, width: ti.i32, height: ti.i32, rays: Rays):
    for i in range(count):
        pixel = queue[i]
        origin, direction = camera_ray(
            view, CURRENT, ti.cast(pixel % width, ti.f32), ti.cast(pixel // width, ti.f32), width, height
        )
        write_ray(rays, pixel, origin, direction, ti.math.inf)


@ti.kernel
def occlusion_rays(
    queue: Ints1,
    count: ti.i32,
    time: ti.i32,
    hits: Hits,
    hit_ids: HitIds,
    vertex_position: Floats2,
    triangle_vertices: Ints2,
    instance_info: Ints2,
    world_from_instance: Floats3,
    instance_motion: Floats2,
    camera_motion: Floats2,
    view: Floats2,
    width: ti.i32,
    height: ti.i32,
    rays: Rays,
    expected: Floats1,
):
    """Rays from the camera of another time to where each pixel's point is then; `expected`: its distance, m.

    A ray that need not be traced, because the point is not in that picture at all, gets t_max 0 and expects -1.
    """
    for i in range(count):
        pixel = queue[i]
        row = hit_ids[pixel][0]
        origin = view_vector(view, time, POSITION)
        direction = view_vector(view, time, FORWARD)
        t_max, length = 0.0, -1.0
        if row >= 0:
            moved = vertex_offset(instance_info, row, time)
            object_point = object_point_at(
                vertex_position, triangle_vertices, hit_ids[pixel][1], hits[pixel][1], hits[pixel][2], moved
            )
            seen = affine(instance_motion, row, 12 * time, object_point)
            place = from_principal_point(seen, camera_motion, time)
            inside = ti.abs(place.x) < 0.5 * width and ti.abs(place.y) < 0.5 * height and seen.z > _NEAREST
            if inside and instance_motion[row, PRESENT + time] > 0.0:
                target = transform_point(world_from_instance, time, row, object_point)
                if camera_motion[time, ORTHOGRAPHIC] == 0.0:
                    length = (target - origin).norm()
                    direction = (target - origin) / length
                else:
                    length = seen.z
                    origin = target - length * direction
                # Coordinates far from the world's origin are coarse, however near the camera is.
                coarse = ti.max(ti.abs(target.x), ti.abs(target.y), ti.abs(target.z))
                t_max = length - _TOLERANCE * (length + 0.1 * coarse)
        write_ray(rays, pixel, origin, direction, t_max)
        expected[pixel] = length


@ti.kernel
def occlusion_labels(
    queue: Ints1,
    count: ti.i32,
    hit_ids: HitIds,
    expected: Floats1,
    other_hits: Hits,
    other_ids: HitIds,
    width: ti.i32,
    occluded: Bytes2,
):
    """From what the rays of `occlusion_rays` met: whether something else lies before the point.

    The point's own triangle, or its own mesh just short of it, is no obstacle: at a grazing angle the rounding of a
    direction moves the hit far along the ray.
    """
    for i in range(count):
        pixel = queue[i]
        length = expected[pixel]
        hidden = length < 0.0
        if not hidden and other_ids[pixel][0] >= 0:
            own = other_ids[pixel][0] == hit_ids[pixel][0]
            same = own and other_ids[pixel][1] == hit_ids[pixel][1]
            near = own and other_hits[pixel][0] >= length * (1.0 - _OWN_TOLERANCE)
            hidden = not (same or near)
        occluded[pixel // width, pixel % width] = ti.cast(hidden, ti.u8)
