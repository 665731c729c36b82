# SPDX-License-Identifier: Apache-2.0
"""Reprojection: the image of a view, from the cells of a panorama around another point.

The points that subpixels show are looked up in the directions in which they are seen from the anchor. A cell counts if
what it shows is as far from the anchor as the point. Where no cell does, the anchor does not see the point. Mirrors and
glass look different from there, but for edges: thin chrome, and rims of glass, are too narrow for that to matter.

A ray through each pixel's center finds what it shows. Where neighbors lie in one plane, so do the points of subpixels;
elsewhere a ray through each subpixel finds them. Pixels that show one plane take coarse cells where these are even.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.device.kernel_types import float4, float8
from tiscene.device.memory import device_array
from tiscene.render.integrators.labels.first_hits import center_hits, first_hits
from tiscene.render.integrators.panorama import reprojection_kernels as kernels
from tiscene.render.integrators.panorama.reprojection_kernels import NOT_FOUND, SUBPIXELS
from tiscene.render.intersect.ray_queue import RayArrays, RayWave, tiled_order
from tiscene.render.intersect.surface_interaction import geometry_of
from tiscene.render.view import View
from tiscene.scene.camera import Vector3
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT

AT_ONCE = 1 << 16  # pixels at edges whose subpixels are traced at once


class Reprojection:
    """The points of a scene that a view shows, and their images.

    Args:
        scene: The scene.

    Attributes:
        centers: The rays through the centers of the pixels, with their hits.
    """

    def __init__(self, scene: DeviceScene) -> None:
        self.centers = RayArrays()
        self._scene = scene
        self._subpixels = RayWave()
        self._surfaces: Any = None
        self._points: Any = None
        self._pixels: Any = None  # `PixelSurfaces` of the view traced last

    def trace(self, view: View, anchor: Vector3) -> None:
        """Find the points that a view shows of what is placed, as seen from an anchor."""
        scene = self._scene
        rays = center_hits(scene, view, self.centers, coherent=True)
        if self._surfaces is None or self._surfaces.shape[0] != rays.count:
            self._surfaces = device_array(float8, rays.count)
            self._points = device_array(float4, rays.count * SUBPIXELS)
        info = scene.materials.arrays().info
        kernels.find_surfaces(rays.count, rays.rays, rays.hits, rays.hit_ids, *geometry_of(scene), info, self._surfaces)
        offset = np.subtract(view.current.position, anchor).tolist()
        size = view.array(), view.width, view.height
        is_edge = np.empty((view.height, view.width), np.int32)
        kernels.find_edges(self._surfaces, is_edge)
        self._pixels = kernels.PixelSurfaces(self._surfaces, view.array(), offset[0], offset[1], offset[2], is_edge)
        order = tiled_order(view.width, view.height)
        edges = order[is_edge.ravel()[order] > 0]
        for first in range(0, len(edges), AT_ONCE):
            pixels = edges[first : first + AT_ONCE]
            count = len(pixels) * SUBPIXELS
            wave = self._subpixels.reserved(count)
            kernels.subpixel_rays(pixels, *size, wave.rays)
            first_hits(scene, CURRENT, wave, wave.queue, count, coherent=True)
            kernels.find_points(pixels, wave.rays, wave.hits, wave.hit_ids, *offset, self._points)

    def find_blocks(self, faces: int, found: NDArray[np.int32]) -> None:
        """Set found[face, row, column] to 1 for each block of a panorama in which points may be seen."""
        kernels.find_blocks(*self._pixels, self._points, faces, found)

    def images(self, *cells: Any) -> NDArray[np.int32] | None:
        """Write the images of the cells of a panorama; arguments as of `reproject_planes`, from `blocks` to `images`.

        Returns:
            int32 [h, w], `known`; None if cells are missing.
        """
        known, missing = np.empty(cells[-1].shape[1:3], np.int32), np.zeros(1, np.int32)
        kernels.reproject_planes(*self._pixels, self._points, *cells, known, missing)
        pixels = np.flatnonzero(known == NOT_FOUND).astype(np.int32)
        kernels.reproject(pixels, self._points, *cells, known, missing)
        return None if missing.any() else known
