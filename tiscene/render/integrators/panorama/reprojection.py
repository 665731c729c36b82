# SPDX-License-Identifier: Apache-2.0
"""Reprojection: the image of a view, from the cells of a panorama around another point.

The points that subpixels show are looked up in the directions in which they are seen from the anchor. A cell counts if
what it shows is as far from the anchor as the point. Where no cell does, the anchor does not see the point; mirrors and
glass look different from there.

A ray through each pixel's center finds what it shows. Where neighbors lie in one plane, so do the points of subpixels;
elsewhere a ray through each subpixel finds them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.device.kernel_types import float4, float8
from tiscene.device.memory import device_array
from tiscene.render.integrators.labels import label_kernels
from tiscene.render.integrators.labels.first_hits import first_hits
from tiscene.render.integrators.panorama import reprojection_kernels as kernels
from tiscene.render.integrators.panorama.reprojection_kernels import EDGE_COUNT, FLAT_COUNT
from tiscene.render.intersect.ray_queue import RayArrays, RayWave
from tiscene.render.intersect.surface_interaction import geometry_of
from tiscene.render.view import View
from tiscene.scene.camera import Vector3
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT

MAX_RAYS = 1 << 18  # through subpixels, traced at once


@dataclass(eq=False)
class ShownPoints:
    """Points that some pixels show.

    Attributes:
        per_pixel: Number of points of a pixel.
        pixels: int32 [n], the pixels, y * width + x.
        points: [at least n * per_pixel] of float4, see `extend_surfaces`.
    """

    per_pixel: int
    pixels: NDArray[np.int32]
    points: Any = None

    @property
    def count(self) -> int:
        """Number of points."""
        return len(self.pixels) * self.per_pixel

    def reserve(self, pixels: NDArray[np.int32]) -> None:
        """Make room for other pixels."""
        self.pixels = pixels
        if self.points is None or self.points.shape[0] < self.count:
            self.points = device_array(float4, 1 << max(0, self.count - 1).bit_length())


class Reprojection:
    """The points of a scene that a view shows, and their images.

    Args:
        scene: The scene.
    """

    def __init__(self, scene: DeviceScene) -> None:
        self._scene = scene
        self._centers, self._subpixels = RayArrays(), RayWave()
        self._surfaces: Any = None
        nothing = np.zeros(0, np.int32)
        self._flat, self._edges = ShownPoints(FLAT_COUNT, nothing), ShownPoints(EDGE_COUNT, nothing)

    def trace(self, view: View, anchor: Vector3) -> None:
        """Find the points that a view shows of what is placed, as seen from an anchor."""
        rays, scene = self._centers.resized(view.width, view.height), self._scene
        if self._surfaces is None or self._surfaces.shape[0] != rays.count:
            self._surfaces = device_array(float8, rays.count)
        label_kernels.primary_rays(rays.queue, rays.count, view.array(), view.width, view.height, rays.rays, False)
        first_hits(scene, CURRENT, rays, rays.queue, rays.count, coherent=True)
        surface_info = *geometry_of(scene), scene.materials.arrays().info
        kernels.find_surfaces(rays.count, rays.rays, rays.hits, rays.hit_ids, *surface_info, self._surfaces)
        is_edge = np.empty((view.height, view.width), np.int32)
        kernels.find_edges(self._surfaces, is_edge)
        self._flat.reserve(np.flatnonzero(is_edge == 0).astype(np.int32))
        self._edges.reserve(np.flatnonzero(is_edge).astype(np.int32))
        offset = np.subtract(view.current.position, anchor).tolist()
        size = view.array(), view.width, view.height
        if self._flat.count:
            kernels.extend_surfaces(self._flat.pixels, self._surfaces, *size, *offset, self._flat.points)
        at_once = max(1, MAX_RAYS // EDGE_COUNT)  # pixels
        for first in range(0, len(self._edges.pixels), at_once):
            pixels = min(at_once, len(self._edges.pixels) - first)
            count = pixels * EDGE_COUNT
            wave = self._subpixels.reserved(count)
            kernels.subpixel_rays(self._edges.pixels, first, pixels, *size, wave.rays)
            first_hits(scene, CURRENT, wave, wave.queue, count, coherent=True)
            kernels.find_points(
                first * EDGE_COUNT, count, wave.rays, wave.hits, wave.hit_ids, *surface_info, *offset,
                self._edges.points,
            )  # fmt: skip

    def find_blocks(self, faces: int, found: NDArray[np.int32]) -> None:
        """Set found[face, row, column] to 1 for each block of a panorama in which points may be seen."""
        for each in self._shown():
            kernels.find_blocks(each.points, each.count, faces, found)

    def images(self, *cells: Any) -> NDArray[np.int32] | None:
        """Write the images of the cells of a panorama; arguments as of `reproject`, which has `known` too.

        Returns:
            int32 [h, w], `known`; None if cells are missing.
        """
        known = np.empty(cells[-1].shape[1:3], np.int32)
        missing = [kernels.reproject(each.pixels, each.points, each.per_pixel, *cells, known) for each in self._shown()]
        return None if any(missing) else known

    def _shown(self) -> list[ShownPoints]:
        return [each for each in (self._flat, self._edges) if each.count]
