"""The kernel that measuring objects needs beside those of the label pass."""

import taichi as ti

from tiscene.render.ray_arrays import write_ray
from tiscene.render.surface import FLOATS_2D, INTS_1D, INTS_2D
from tiscene.render.view import camera_ray
from tiscene.scene.placement import CURRENT


@ti.kernel
def pixel_rays(
    view: FLOATS_2D,
    samples: INTS_2D,
    count: ti.i32,
    width: ti.i32,
    height: ti.i32,
    rays: FLOATS_2D,
    targets: INTS_1D,
):
    """Rays through the centres of pixels, in the picture or not. samples: x, y and the instance to test."""
    for i in range(count):
        x, y = ti.cast(samples[i, 0], ti.f32), ti.cast(samples[i, 1], ti.f32)
        origin, direction = camera_ray(view, CURRENT, x, y, width, height)
        write_ray(rays, i, origin, direction, ti.math.inf)
        targets[i] = samples[i, 2]
