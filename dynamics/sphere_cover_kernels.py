# SPDX-License-Identifier: Apache-2.0
"""Kernels that cover a surface with spheres; `dynamics.sphere_proxy` describes the algorithm.

Each sphere and each point is computed by one thread in a fixed order, so that the result does not depend on the number
of threads.
"""

import taichi as ti

from dynamics.body_access import read3, vec3d, write3
from dynamics.kernel_types import Doubles1, Doubles2, Ints1

BALL_STEPS = 24  # of the approximation of smallest balls


@ti.kernel
def find_nearest_centers(points: Doubles2, centers: Doubles2, owner: Ints1):
    """Set owner[i] to the row of the center nearest to points[i]; of equals the first."""
    for i in range(points.shape[0]):
        point = read3(points, i, 0)
        best = ti.cast(ti.math.inf, ti.f64)
        for k in range(centers.shape[0]):
            square = (point - read3(centers, k, 0)).norm_sqr()
            if square < best:
                best = square
                owner[i] = k


@ti.kernel
def find_ball_centers(corners: Doubles2, first: Ints1, centers: Doubles2):
    """Set centers[k] to the approximate center of the smallest ball around corners[first[k] : first[k + 1]].

    From the mean of the corners, takes ever shorter steps towards the farthest one (Badoiu and Clarkson, "Smaller
    Core-Sets for Balls", 2003).
    """
    for k in range(centers.shape[0]):
        begin = first[k]
        end = first[k + 1]
        center = vec3d(0.0)
        for i in range(begin, end):
            center += read3(corners, i, 0)
        center /= ti.cast(end - begin, ti.f64)
        for step in range(1, 1 + BALL_STEPS):
            farthest = begin
            farthest_square = ti.cast(-1.0, ti.f64)
            for i in range(begin, end):
                square = (read3(corners, i, 0) - center).norm_sqr()
                if square > farthest_square:
                    farthest_square = square
                    farthest = i
            center += (read3(corners, farthest, 0) - center) / ti.cast(step + 1, ti.f64)
        write3(centers, k, 0, center)


@ti.kernel
def sink_centers(
    corners: Doubles2,
    first: Ints1,
    outward: Doubles2,
    middles: Doubles2,
    normals: Doubles2,
    depths: Doubles1,
    centers: Doubles2,
    radii: Doubles1,
):
    """Move centers below a closed surface, where a larger ball covers the same corners and protrudes less.

    Args:
        corners: [n, 3], corners of triangles, m.
        first: [k + 1], rows of `corners` where those of each ball begin.
        outward: [k, 3], unit normals of the surface at the balls.
        middles: [m, 3], centroids of triangles sampled from the whole surface.
        normals: [m, 3], their outward normals.
        depths: Depths to try, in radii.
        centers: [k, 3], updated in place.
        radii: [k], updated in place.
    """
    for k in range(centers.shape[0]):
        start = read3(centers, k, 0)
        radius = radii[k]
        least = radius
        for tried in range(depths.shape[0]):
            below = start - depths[tried] * radius * read3(outward, k, 0)
            larger = radius * 0.0
            for i in range(first[k], first[k + 1]):
                larger = ti.max(larger, (read3(corners, i, 0) - below).norm_sqr())
            larger = ti.sqrt(larger)
            closest = 0
            square = ti.cast(ti.math.inf, ti.f64)
            for i in range(middles.shape[0]):
                here = (read3(middles, i, 0) - below).norm_sqr()
                if here < square:
                    square = here
                    closest = i
            protrusion = larger - ti.sqrt(square)
            inside = (below - read3(middles, closest, 0)).dot(read3(normals, closest, 0)) < 0.0
            if protrusion < least and inside:
                least = protrusion
                write3(centers, k, 0, below)
                radii[k] = larger
