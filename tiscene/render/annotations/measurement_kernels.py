# SPDX-License-Identifier: Apache-2.0
"""Kernels of object measurements: rays of amodal masks, and extents of instances."""

import taichi as ti

from tiscene.device.kernel_types import Doubles1, Doubles2, Floats2, Ints1, Ints2, Template
from tiscene.render.intersect.ray_queue import Rays, write_ray
from tiscene.render.view import camera_ray
from tiscene.scene.placement import CURRENT

INSTANCE, OWNER, LEFT, TOP, COLUMNS, ROWS, STRIDE, OUTSIDE = range(8)  # columns of `windows`
X, Y, WINDOW = range(3)  # columns of `samples`
EXTENT_COLUMNS = 13
WORLD, BOX, IN_FRONT, BEHIND, CLIP = 0, 6, 10, 11, 12  # columns of `extents`
_CLIP = 0.1  # of an instance's greatest depth


@ti.kernel
def pixel_rays(
    view: Floats2,
    windows: Ints2,
    firsts: Ints1,
    width: ti.i32,
    height: ti.i32,
    samples: Ints2,
    rays: Rays,
    targets: Ints1,
):
    """Write rays through the centers of pixels, inside the image or not, and the instances they are tested against.

    Args:
        view: `View.array()`.
        windows: i32 [w, 8], grids of pixels, columns as above; OUTSIDE: 1 leaves out pixels inside the image.
        firsts: i32 [w + 1], first sample of each window, and the number of samples.
        width: Of the image.
        height: Of the image.
        samples: i32 [n, 3]; receives x, y and window.
        rays: [n]; receives the rays.
        targets: i32 [n]; receives the instance rows.
    """
    for i in range(firsts[windows.shape[0]]):
        window, end = 0, windows.shape[0]
        while end - window > 1:
            middle = (window + end) // 2
            if firsts[middle] <= i:
                window = middle
            else:
                end = middle
        at = i - firsts[window]
        stride = windows[window, STRIDE]
        x = windows[window, LEFT] + at % windows[window, COLUMNS] * stride
        y = windows[window, TOP] + at // windows[window, COLUMNS] * stride
        samples[i, X], samples[i, Y], samples[i, WINDOW] = x, y, window
        origin, direction = camera_ray(view, CURRENT, ti.cast(x, ti.f32), ti.cast(y, ti.f32), width, height)
        t_max = ti.math.inf
        if windows[window, OUTSIDE] != 0 and 0 <= x < width and 0 <= y < height:
            t_max = 0.0  # in another window
        write_ray(rays, i, origin, direction, t_max)
        targets[i] = windows[window, INSTANCE]


@ti.func
def _world_point(vertex_position: Template, vertex: ti.i32, world_from_object: Template, row: ti.i32):
    """Return a vertex of an instance, world, m, in double precision."""
    point = ti.Vector([ti.f64(0.0)] * 3)
    for a in ti.static(range(3)):
        point[a] = world_from_object[row, 4 * a + 3]
        for c in ti.static(range(3)):
            point[a] += world_from_object[row, 4 * a + c] * ti.cast(vertex_position[vertex, c], ti.f64)
    return point


@ti.kernel
def measure_extents(
    vertex_position: Floats2,
    vertices: Ints2,
    world_from_object: Doubles2,
    camera_from_world: Doubles1,
    near: ti.f64,
    focal: ti.f64,
    orthographic: ti.i32,
    half_width: ti.f64,
    half_height: ti.f64,
    extents: Doubles2,
):
    """Measure instances: world-space bounds, and bounds of the projection.

    What is nearer than the near plane is seen, but projections are unbounded where an instance reaches behind the
    camera. So it is clipped by the near plane, or nearer if it is near itself.

    Args:
        vertex_position: f32 [n, 3], object space.
        vertices: i32 [i, 2], rows of each instance's vertices, [begin, end).
        world_from_object: f64 [i, 12], row-major 3x4.
        camera_from_world: f64 [12], row-major 3x4.
        near: Near plane, m.
        focal: Focal length, px.
        orthographic: 1 for an orthographic camera.
        half_width: Of the image, px.
        half_height: Of the image, px.
        extents: f64 [i, EXTENT_COLUMNS]; receives WORLD: bounds, m (6); BOX: of vertices in front of the clipping
            plane, x0, y0, x1, y1, px, whole numbers at corners of pixels; numbers of vertices IN_FRONT and BEHIND it;
            CLIP: its depth, m.
    """
    for row in range(vertices.shape[0]):
        low, high = ti.Vector([ti.f64(1e300)] * 3), ti.Vector([ti.f64(-1e300)] * 3)
        box_low, box_high = ti.Vector([ti.f64(1e300)] * 2), ti.Vector([ti.f64(-1e300)] * 2)
        behind = 0
        clip = ti.f64(0.0)
        for vertex in range(vertices[row, 0], vertices[row, 1]):
            point = _world_point(vertex_position, vertex, world_from_object, row)
            depth = camera_from_world[11]
            for c in ti.static(range(3)):
                depth += camera_from_world[8 + c] * point[c]
            clip = ti.max(clip, _CLIP * depth)
        clip = ti.min(clip, near)
        for vertex in range(vertices[row, 0], vertices[row, 1]):
            point = _world_point(vertex_position, vertex, world_from_object, row)
            camera_point = ti.Vector([ti.f64(0.0)] * 3)
            for a in ti.static(range(3)):
                camera_point[a] = camera_from_world[4 * a + 3]
                for c in ti.static(range(3)):
                    camera_point[a] += camera_from_world[4 * a + c] * point[c]
            low, high = ti.min(low, point), ti.max(high, point)
            if camera_point[2] > 0.0 and camera_point[2] >= clip:
                scale = focal
                if orthographic == 0:
                    scale = focal / camera_point[2]
                pixel = ti.Vector([camera_point[0], camera_point[1]]) * scale + ti.Vector([half_width, half_height])
                box_low, box_high = ti.min(box_low, pixel), ti.max(box_high, pixel)
            else:
                behind += 1
        for a in ti.static(range(3)):
            extents[row, WORLD + a] = low[a]
            extents[row, WORLD + 3 + a] = high[a]
        for a in ti.static(range(2)):
            extents[row, BOX + a] = box_low[a]
            extents[row, BOX + 2 + a] = box_high[a]
        extents[row, IN_FRONT] = vertices[row, 1] - vertices[row, 0] - behind
        extents[row, BEHIND] = behind
        extents[row, CLIP] = clip
