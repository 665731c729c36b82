# SPDX-License-Identifier: Apache-2.0
"""Kernels of the label pass for rays and motion. One loop iteration is one pixel of a queue; no sums over pixels."""

import taichi as ti

from tiscene.device.kernel_types import Bytes2, Floats1, Floats2, Floats3, Ints1, Ints2, Template, vec2, vec3
from tiscene.render.intersect.ray_queue import HitIds, Hits, Rays, write_ray
from tiscene.render.intersect.surface_interaction import object_point_at, transform_point, vertex_offset
from tiscene.render.view import FORWARD, POSITION, camera_ray, view_vector
from tiscene.scene.instance_upload import INFO_MOVED
from tiscene.scene.placement import CURRENT

# Columns of the instance motion array after the three matrices to camera coordinates, see `instance_motion`.
DISPLACEMENT, PRESENT, MOTION_COLUMNS = 36, 48, 51
FOCAL_LENGTH, ORTHOGRAPHIC, SHEAR = 9, 10, 11  # columns of the camera motion array, after the rotation

# Minimum depth for projection, m. Points nearer than this or behind the camera get a finite flow that leads far out of
# the image.
_MIN_DEPTH = 1e-4
# A hit in front of a point by less than this fraction of its distance is the point itself: on any instance, and on the
# point's own instance.
_TOLERANCE = 1e-5
_OWN_TOLERANCE = 1e-4


@ti.func
def affine(rows: Template, row: ti.i32, column: ti.i32, p: vec3) -> vec3:
    """Transform a point by the 3x4 matrix that starts at a column of a row."""
    return vec3(
        rows[row, column] * p.x + rows[row, column + 1] * p.y + rows[row, column + 2] * p.z + rows[row, column + 3],
        rows[row, column + 4] * p.x + rows[row, column + 5] * p.y + rows[row, column + 6] * p.z + rows[row, column + 7],
        rows[row, column + 8] * p.x + rows[row, column + 9] * p.y + rows[row, column + 10] * p.z
        + rows[row, column + 11],
    )  # fmt: skip


@ti.func
def rotate(rows: Template, row: ti.i32, v: vec3) -> vec3:
    """Transform a vector by the 3x3 matrix in the first columns of a row."""
    return vec3(
        rows[row, 0] * v.x + rows[row, 1] * v.y + rows[row, 2] * v.z,
        rows[row, 3] * v.x + rows[row, 4] * v.y + rows[row, 5] * v.z,
        rows[row, 6] * v.x + rows[row, 7] * v.y + rows[row, 8] * v.z,
    )


@ti.func
def first_camera(y: ti.i32, height: ti.i32, stacked: Template) -> ti.i32:
    """Return the first of three rows of the cameras of the frame that image row y belongs to.

    Args:
        y: Row of an image, or of the images of several frames below each other.
        height: Rows of one frame.
        stacked: Static; whether there are several frames.
    """
    row = 0
    if ti.static(stacked):
        row = 3 * (y // height)
    return row


@ti.func
def row_in_frame(y: ti.i32, height: ti.i32, stacked: Template) -> ti.i32:
    """Return the row within its frame of image row y; arguments as of `first_camera`."""
    row = y
    if ti.static(stacked):
        row = y % height
    return row


@ti.func
def from_principal_point(p: vec3, camera_motion: Template, time: ti.i32) -> vec2:
    """Project a point in camera coordinates: px right and down of the image center."""
    scale = camera_motion[time, FOCAL_LENGTH]
    if camera_motion[time, ORTHOGRAPHIC] == 0.0:
        scale = scale / ti.max(p.z, _MIN_DEPTH)
    return vec2(p.x, p.y) * scale


@ti.func
def camera_point(
    time: ti.i32,
    row: ti.i32,
    object_point: vec3,
    towards: vec3,
    instance_motion: Template,
    camera_motion: Template,
    first: ti.i32,
) -> vec3:
    """Return a pixel's surface point in the coordinates of the camera at a time. first: of `first_camera`.

    The background (row < 0) is infinitely far: its direction is only rotated.
    """
    point = rotate(camera_motion, first + time, towards)
    if row >= 0:
        point = affine(instance_motion, row, 12 * time, object_point)
    return point


@ti.func
def deformed_point(
    geometry: Template,
    row: ti.i32,
    triangle: ti.i32,
    b1: ti.f32,
    b2: ti.f32,
    now: vec3,
    time: ti.i32,
) -> vec3:
    """Return where a point at `now` in the space of its mesh is at another time, if the mesh deforms."""
    point = now
    if row >= 0:
        if geometry.instance_info[row, INFO_MOVED] > 0:
            moved = vertex_offset(geometry.instance_info, row, time)
            point = object_point_at(geometry.vertex_position, geometry.triangle_vertices, triangle, b1, b2, moved)
    return point


@ti.kernel
def primary_rays(
    queue: Ints1, count: ti.i32, view: Floats2, width: ti.i32, height: ti.i32, rays: Rays, stacked: Template
):
    """Generate the rays through the centers of the queued pixels. stacked: see `first_camera`."""
    for i in range(count):
        pixel = queue[i]
        y = pixel // width
        time = first_camera(y, height, stacked) + CURRENT
        origin, direction = camera_ray(
            view, time, ti.cast(pixel % width, ti.f32), ti.cast(row_in_frame(y, height, stacked), ti.f32), width, height
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
    stacked: Template,
):
    """Generate rays from the camera of another time to where each pixel's surface point is at that time.

    Args:
        stacked: See `first_camera`.
        expected: Output, f32 [pixels], distance of the point, m; -1, and t_max 0, if it is outside of that image.
    """
    for i in range(count):
        pixel = queue[i]
        row = hit_ids[pixel][0]
        camera = first_camera(pixel // width, height, stacked) + time
        origin = view_vector(view, camera, POSITION)
        direction = view_vector(view, camera, FORWARD)
        t_max, length = 0.0, -1.0
        if row >= 0:
            moved = vertex_offset(instance_info, row, time)
            object_point = object_point_at(
                vertex_position, triangle_vertices, hit_ids[pixel][1], hits[pixel][1], hits[pixel][2], moved
            )
            target_in_camera = affine(instance_motion, row, 12 * time, object_point)
            projected = from_principal_point(target_in_camera, camera_motion, camera)
            inside = (
                ti.abs(projected.x) < 0.5 * width
                and ti.abs(projected.y) < 0.5 * height
                and target_in_camera.z > _MIN_DEPTH
            )
            if inside and instance_motion[row, PRESENT + time] > 0.0:
                target = transform_point(world_from_instance, time, row, object_point)
                if camera_motion[camera, ORTHOGRAPHIC] == 0.0:
                    length = (target - origin).norm()
                    direction = (target - origin) / length
                else:
                    length = target_in_camera.z
                    origin = target - length * direction
                # Rounding grows with the coordinates, however near the camera is.
                magnitude = ti.max(ti.abs(target.x), ti.abs(target.y), ti.abs(target.z))
                t_max = length - _TOLERANCE * (length + 0.1 * magnitude)
        write_ray(rays, pixel, origin, direction, t_max)
        expected[pixel] = length


@ti.kernel
def project_points(
    queue: Ints1,
    count: ti.i32,
    hits: Hits,
    hit_ids: HitIds,
    vertex_position: Floats2,
    triangle_vertices: Ints2,
    instance_info: Ints2,
    instance_motion: Floats2,
    camera_motion: Floats2,
    projected: Floats2,
):
    """Write where points of surfaces are in the image of the camera at CURRENT."""
    for i in range(count):
        point = queue[i]
        row = hit_ids[point][0]
        if row >= 0:
            moved = vertex_offset(instance_info, row, CURRENT)
            object_point = object_point_at(
                vertex_position, triangle_vertices, hit_ids[point][1], hits[point][1], hits[point][2], moved
            )
            in_camera = affine(instance_motion, row, 12 * CURRENT, object_point)
            place = from_principal_point(in_camera, camera_motion, CURRENT)
            projected[point, 0], projected[point, 1] = place.x, place.y


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
    """Write whether another surface occludes each pixel's point, from the hits of `occlusion_rays`.

    The point's own triangle, or its own instance just in front of it, does not occlude: at grazing angles the rounding
    of the direction moves the hit far along the ray.
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
