# SPDX-License-Identifier: Apache-2.0
"""Reprojection: the image of a view, from the cells of a panorama around another point.

The points that subpixels show are looked up in the directions in which they are seen from the anchor. A cell counts if
what it shows is as far from the anchor as the point. Where no cell does, the anchor does not see the point; mirrors and
glass look different from there.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.device.kernel_types import float4
from tiscene.device.memory import device_array
from tiscene.render.integrators.labels import label_kernels
from tiscene.render.integrators.labels.first_hits import first_hits
from tiscene.render.integrators.panorama import reprojection_kernels as kernels
from tiscene.render.intersect.ray_queue import RayArrays
from tiscene.render.view import View
from tiscene.scene.camera import Vector3
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT

MAX_RAYS = 1 << 20  # traced at once


class Reprojection:
    """The points of a scene that a view shows, and their images.

    Args:
        scene: The scene.
    """

    def __init__(self, scene: DeviceScene) -> None:
        self._scene = scene
        self._rays = RayArrays()
        self._points: Any = None

    def trace(self, view: View, anchor: Vector3) -> None:
        """Find the points that a view shows of what is placed, as seen from an anchor."""
        width, height = view.width * kernels.SIDE, view.height * kernels.SIDE
        if self._points is None or self._points.shape[0] != width * height:
            self._points = device_array(float4, width * height)
        rows = max(1, MAX_RAYS // width)
        for first in range(0, height, rows):
            self._trace_rows(band(view, height, first, min(rows, height - first)), first * width, anchor)

    def _trace_rows(self, view: View, first_point: int, anchor: Vector3) -> None:
        """Find the points of some rows of subpixels, the pixels of a view."""
        rays, scene = self._rays.resized(view.width, view.height), self._scene
        label_kernels.primary_rays(rays.queue, rays.count, view.array(), view.width, view.height, rays.rays, False)
        first_hits(scene, CURRENT, rays, rays.queue, rays.count, coherent=True)
        kernels.find_points(
            rays.count, first_point, rays.rays, rays.hits, rays.hit_ids,
            scene.triangle_material, scene.materials.arrays().info,
            *np.subtract(view.current.position, anchor).tolist(), self._points,
        )  # fmt: skip

    def find_blocks(self, faces: int, found: NDArray[np.int32]) -> None:
        """Set found[face, row, column] to 1 for each block of a panorama in which points may be seen."""
        kernels.find_blocks(self._points, faces, found)

    def image(self, *cells: Any) -> NDArray[np.bool_]:
        """Write the image of the cells of a panorama; arguments as of `reproject`.

        Returns:
            bool [h, w], where it is known.
        """
        image = cells[-1]
        known = np.empty(image.shape[:2], np.int32)
        kernels.reproject(self._points, *cells, known)
        return known > 0


def band(view: View, height: int, first: int, rows: int) -> View:
    """Return the view of some rows of an image of a view that is SIDE times as large.

    Args:
        view: The view, of a pinhole camera.
        height: Rows of the large image.
        first: The first row of the band.
        rows: The number of rows of the band.
    """
    camera = view.current
    pixel = 2.0 * math.tan(0.5 * camera.vertical_fov) / height
    right, up = camera.aperture_offset
    center = (right, up + pixel * (0.5 * (height - rows) - first))
    camera = replace(camera, vertical_fov=2.0 * math.atan(0.5 * pixel * rows), aperture_offset=center)
    return replace(view, previous=camera, current=camera, next=camera, width=view.width * kernels.SIDE, height=rows)
