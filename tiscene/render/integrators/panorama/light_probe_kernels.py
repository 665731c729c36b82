# SPDX-License-Identifier: Apache-2.0
"""Kernels of light probes."""

import taichi as ti

from tiscene.device.kernel_types import Float8s1, vec3
from tiscene.render.integrators.panorama.reprojection_kernels import FAR
from tiscene.render.integrators.path.wavefront_kernels import LENS_SET, path_number
from tiscene.render.intersect.ray_queue import ROW, Pixels, Rays, write_ray
from tiscene.render.sampling import warp
from tiscene.render.sampling.sobol import draw, reverse_bits, set_keys

CLEARANCE = 1e-3  # how far from its point a ray begins, relative to the point's distance from the center


@ti.kernel
def look_from_random_directions(
    surfaces: Float8s1,
    center_x: ti.f32,
    center_y: ti.f32,
    center_z: ti.f32,
    pixels: Pixels,
    first: ti.i32,
    count: ti.i32,
    spp: ti.i32,
    bits: ti.i32,
    frame_key: ti.i32,
    rays: Rays,
):
    """Replace camera rays by rays that reach the same points from random directions, with a cosine distribution.

    Args:
        surfaces: Of `find_surfaces`, one of each pixel of the image.
        center_x, center_y, center_z: The point that they are seen from, world, m.
        pixels: The pixels that are traced.
        first: Number of the path in row 0.
        count: Number of paths.
        spp, bits, frame_key: `PathSamples`.
        rays: Input and output.
    """
    center = vec3(center_x, center_y, center_z)
    for i in range(count):
        surface = surfaces[pixels[(first + i) // spp][ROW]]
        point, normal = vec3(surface[0], surface[1], surface[2]), vec3(surface[4], surface[5], surface[6])
        distance = point.norm()
        if distance < 0.5 * FAR:
            index = reverse_bits(path_number(pixels, first + i, spp, bits, 0))
            local = warp.cosine_hemisphere(draw(set_keys(frame_key, LENS_SET), index))
            right, up = warp.tangents(normal)
            direction = local.x * right + local.y * up + local.z * normal
            write_ray(rays, i, center + point + CLEARANCE * distance * direction, -direction, ti.math.inf)
