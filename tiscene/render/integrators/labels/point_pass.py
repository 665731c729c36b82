# SPDX-License-Identifier: Apache-2.0
"""PointPass: points of surfaces, chosen in one frame, and where and whether a camera sees them in others.

A point is a place in a triangle. It moves and deforms with its mesh, so that nothing of the frame in which it was
chosen has to be placed again. Positions and occlusion are those of the flow and the occlusion of the label pass.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.render.integrators.labels import label_kernels as kernels
from tiscene.render.integrators.labels.first_hits import find_occlusion, first_hits
from tiscene.render.integrators.labels.label_frames import LabelFrames
from tiscene.render.intersect.ray_queue import RayArrays
from tiscene.render.view import View
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT

NOTHING = -1  # row of a ray that hits nothing, and of an instance that is not placed


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Points of surfaces.

    Attributes:
        pixels: float64 [n, 2], x and y where they were chosen, px; pixel centers at halves.
        keys: int64 [n], their instances, see `Placement.keys`; NOTHING for the background.
        triangles: int32 [n], rows of the scene's triangles.
        hits: float32 [n, 4], barycentrics in columns 1 and 2, see `closest`.
        projected: float32 [n, 2], where they were when chosen, px right and down of the image's center.
    """

    pixels: NDArray[np.float64]
    keys: NDArray[np.int64]
    triangles: NDArray[np.int32]
    hits: NDArray[np.float32]
    projected: NDArray[np.float32]


class PointPass:
    """Chooses and follows points of what a DeviceScene has placed at CURRENT.

    Args:
        scene: The scene.
    """

    def __init__(self, scene: DeviceScene) -> None:
        self.scene = scene
        self._image, self._points, self._sight = RayArrays(), RayArrays(), RayArrays()

    def choose(self, view: View, x: NDArray[np.int64], y: NDArray[np.int64]) -> SurfacePoints:
        """Return the points of surfaces at the centers of pixels.

        Args:
            view: The camera at CURRENT, and the image size.
            x: Columns of the pixels, int64 [n].
            y: Rows of the pixels, int64 [n].
        """
        rays = self._image.resized(view.width, view.height)
        pixels = np.zeros((view.height, view.width), bool)
        pixels[y, x] = True
        queue, count = rays.queue_of(pixels)
        kernels.primary_rays(queue, count, view.array(), view.width, view.height, rays.rays, False)
        first_hits(self.scene, CURRENT, rays, queue, count)
        rows = y * view.width + x
        hits, ids = rays.hits.to_numpy()[rows], rays.hit_ids.to_numpy()[rows]
        keys = np.append(self.scene.placement.keys(), NOTHING)[ids[:, 0]]
        centers = np.stack([x + 0.5, y + 0.5], axis=1)
        self._load(ids[:, 0], ids[:, 1], hits)
        return SurfacePoints(
            centers, keys, ids[:, 1], hits, self._project(LabelFrames.of([view], [self.scene.placement]))[: len(x)]
        )

    def follow(self, points: SurfacePoints, view: View) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return where points are in an image, and whether they are not visible there.

        Args:
            points: The points.
            view: The camera at CURRENT, and the image size.

        Returns:
            float64 [n, 2], x and y, px, where they were chosen if their instance is not placed; bool [n], True where
            another surface is in front, or the point is outside of the image or not present.
        """
        count = len(points.keys)
        rows = self.scene.placement.rows(points.keys)
        capacity = self._load(rows, points.triangles, points.hits)
        frames = LabelFrames.of([view], [self.scene.placement])
        moved = np.where(rows[:, None] == NOTHING, np.float32(0.0), self._project(frames)[:count] - points.projected)
        own, sight, occluded = self._points, self._sight.resized(capacity, 1), np.zeros((1, capacity), np.uint8)
        materials = self.scene.materials.arrays()
        find_occlusion(self.scene, frames, CURRENT, materials, own, sight, own.queue, capacity, occluded)
        return points.pixels + moved, occluded[0, :count] != 0

    def _load(self, rows: NDArray[Any], triangles: NDArray[np.int32], hits: NDArray[np.float32]) -> int:
        """Upload points as hits; return the number of rows that they take, the last ones of which hit nothing."""
        count = len(rows)
        capacity = 1 << max(count - 1, 0).bit_length()
        ids = np.full((capacity, 2), NOTHING, np.int32)
        ids[:count, 0], ids[:count, 1] = rows, triangles
        places = np.zeros((capacity, 4), np.float32)
        places[:count] = hits
        own = self._points.resized(capacity, 1)
        own.hit_ids.from_numpy(ids)
        own.hits.from_numpy(places)
        return capacity

    def _project(self, frames: LabelFrames) -> NDArray[np.float32]:
        """Return where the uploaded points are, float32 [capacity, 2], px right and down of the image's center."""
        scene, own = self.scene, self._points
        projected = np.zeros((own.count, 2), np.float32)
        kernels.project_points(
            own.queue, own.count, own.hits, own.hit_ids, scene.vertex_position, scene.triangle_vertices,
            scene.instance_info, frames.instance_motion, frames.camera_motion, projected,
        )  # fmt: skip
        return projected
