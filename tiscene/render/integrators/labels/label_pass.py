# SPDX-License-Identifier: Apache-2.0
"""The label pass: one ray through each pixel center, and all label buffers at its first hit.

Labels are not sampled and contain no randomness. Motion is exact to the float: the matrices from each object to the
cameras at k-1, k and k+1 are multiplied in double precision, so that large world coordinates do not cancel in a pixel
position, and static objects before a static camera move by exactly 0.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import BufferNotFound
from tiscene.frame.buffers import BUFFERS, LABELS, times_needed
from tiscene.render.integrators.labels import label_kernels as kernels
from tiscene.render.integrators.labels.coverage import COVERAGES, CoverageLabels, CoverageSamples
from tiscene.render.integrators.labels.first_hits import first_hits
from tiscene.render.integrators.labels.static_labels import StaticImage, StaticLabelCache
from tiscene.render.integrators.labels.surface_labels import (
    FILTERED_ALBEDO,
    MATERIAL_BUFFERS,
    SURFACE_BUFFERS,
    surface_labels,
)
from tiscene.render.intersect.ray_queue import RayArrays
from tiscene.render.intersect.surface_interaction import geometry_of
from tiscene.render.view import View
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT, NEXT, PREVIOUS, Placement

MAX_MIRRORS = 4  # a mirror behind this many others is labeled itself
_BUFFERS = BUFFERS | {FILTERED_ALBEDO: BUFFERS["albedo"]}
_OCCLUSIONS = (("backward_occlusion", PREVIOUS), ("forward_occlusion", NEXT))


class LabelPass:
    """Renders label buffers of what a DeviceScene has placed.

    Args:
        scene: The scene.

    Attributes:
        traced_pixels: Pixels that the last call of `render` traced, those for the cache of static labels included.
    """

    def __init__(self, scene: DeviceScene) -> None:
        self.scene = scene
        self.traced_pixels = 0
        self._rays = RayArrays()
        self._occlusion_rays = RayArrays()
        self._coverage = CoverageLabels(scene)
        self._static_labels = StaticLabelCache(scene)

    def render(self, view: View, buffers: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Render label buffers.

        Args:
            view: Camera and image size.
            buffers: Names of label buffers, or FILTERED_ALBEDO. Others cost nothing. The scene must be placed at
                `times_needed(buffers)`.

        Returns:
            New arrays by name.

        Raises:
            BufferNotFound: If a name is not that of a label buffer.
        """
        for name in buffers:
            if name not in LABELS and name != FILTERED_ALBEDO:
                raise BufferNotFound("label buffer", str(name), LABELS)
        self.traced_pixels = 0
        if not buffers:
            return {}
        cached = self._static_labels.lookup(view, buffers, times_needed(buffers), self._draw_static)
        if cached is None:
            rays = self._rays.resized(view.width, view.height)
            arrays = _empty(view, buffers)
            self._draw(view, rays.queue, rays.count, arrays)
        else:
            image, changed, moving = cached
            arrays = {name: image.arrays[name].copy() for name in buffers}
            queue, count = self._rays.resized(view.width, view.height).queue_of(changed)
            if count and not arrays.keys().isdisjoint(COVERAGES):
                self.scene.place_movers(moving)
            self._draw(view, queue, count, arrays, static=image.samples)
        return arrays

    def _draw_static(self, view: View, buffers: Sequence[str]) -> StaticImage:
        """Draw all pixels of a new image for the cache."""
        rays = self._rays.resized(view.width, view.height)
        shape = (view.height, view.width)
        arrays = _empty(view, buffers)
        samples = None if arrays.keys().isdisjoint(COVERAGES) else CoverageSamples.empty(rays.count)
        image = StaticImage(arrays, np.empty(shape, np.float32), np.zeros(shape, bool), samples)
        self._draw(view, rays.queue, rays.count, arrays, image)
        return image

    def _draw(
        self,
        view: View,
        queue: Any,
        count: int,
        arrays: dict[str, NDArray[Any]],
        image: StaticImage | None = None,
        static: CoverageSamples | None = None,
    ) -> None:
        """Write the queued pixels.

        Args:
            view: Camera and image size.
            queue: i32 pixel numbers on the device.
            count: Number of queued pixels.
            arrays: Output, buffers by name.
            image: Output, the cached image that the buffers belong to, if any.
            static: Coverage samples of the static instances; then only movers are traced for coverage.
        """
        if not count:
            return
        self.traced_pixels += count
        rays = self._rays
        kernels.primary_rays(queue, count, view.array(), view.width, view.height, rays.rays)
        first_hits(self.scene, CURRENT, rays, queue, count)
        if image is not None:
            image.max_distance[...] = rays.hits.to_numpy()[:, 0].reshape(image.max_distance.shape)

        if not arrays.keys().isdisjoint(COVERAGES):
            max_distance = np.zeros((view.height, view.width), np.float32) if image is None else image.max_distance
            samples = None if image is None else image.samples
            self._coverage.render(view, queue, count, arrays, max_distance, static, samples)

        motion = instance_motion(self.scene.placement, view)
        cameras = camera_motion(view)
        mirrors = self._draw_surfaces(view, queue, count, motion, cameras, arrays, SURFACE_BUFFERS, 0)
        for name, time in _OCCLUSIONS:
            if name in arrays:
                self._draw_occlusion(view, queue, count, time, motion, cameras, arrays[name])
        # Last: reflected rays overwrite the hits.
        followed = 0
        while mirrors:
            queue, count = rays.mirrored[followed % 2], mirrors
            if image is not None and followed == 0:
                image.mirrors.ravel()[queue.to_numpy()[:count]] = True
            first_hits(self.scene, CURRENT, rays, queue, count)
            followed += 1
            mirrors = self._draw_surfaces(view, queue, count, motion, cameras, arrays, MATERIAL_BUFFERS, followed)

    def _draw_surfaces(
        self,
        view: View,
        queue: Any,
        count: int,
        motion: NDArray[np.float32],
        cameras: NDArray[np.float32],
        arrays: dict[str, NDArray[Any]],
        buffers: Sequence[str],
        followed: int,
    ) -> int:
        """Write those of `buffers` that are among the arrays; return the number of rays that mirrors reflected.

        Args:
            view: Camera and image size.
            queue: i32 pixel numbers on the device.
            count: Number of queued pixels.
            motion: See `instance_motion`.
            cameras: See `camera_motion`.
            arrays: Output, buffers by name.
            buffers: Names of the buffers to write.
            followed: Number of mirrors that reflected the rays before.
        """
        wanted = np.array([name in arrays and name in buffers for name in SURFACE_BUFFERS], np.int32)
        if not wanted.any():
            return 0
        rays = self._rays
        mirrors = np.zeros(1, np.int32)
        surface_labels(
            queue,
            count,
            rays.rays,
            rays.hits,
            rays.hit_ids,
            *geometry_of(self.scene),
            *self.scene.materials.arrays(),
            *self.scene.textures.arrays(),
            self.scene.box_from_instance,
            self.scene.triangle_part,
            motion,
            cameras,
            view.array(),
            view.width,
            view.height,
            int(followed < MAX_MIRRORS),
            rays.mirrored[followed % 2],
            mirrors,
            wanted,
            *(arrays.get(name, _placeholder(name)) for name in SURFACE_BUFFERS),
        )
        return int(mirrors[0])

    def _draw_occlusion(
        self,
        view: View,
        queue: Any,
        count: int,
        time: int,
        motion: NDArray[np.float32],
        cameras: NDArray[np.float32],
        occluded: NDArray[np.bool_],
    ) -> None:
        """Write whether the queued pixels' surface points are occluded from the camera at another time."""
        rays, other = self._rays, self._occlusion_rays.resized(view.width, view.height)
        kernels.occlusion_rays(
            queue,
            count,
            time,
            rays.hits,
            rays.hit_ids,
            self.scene.vertex_position,
            self.scene.triangle_vertices,
            self.scene.instance_info,
            self.scene.world_from_instance,
            motion,
            cameras,
            view.array(),
            view.width,
            view.height,
            other.rays,
            other.distance,
        )
        first_hits(self.scene, time, other, queue, count)
        kernels.occlusion_labels(
            queue, count, rays.hit_ids, other.distance, other.hits, other.hit_ids, view.width, occluded.view(np.uint8)
        )


def _empty(view: View, buffers: Sequence[str]) -> dict[str, NDArray[Any]]:
    """Return uninitialized buffers by name."""
    return {name: _BUFFERS[name].empty(view.width, view.height) for name in buffers}


_PLACEHOLDERS: dict[str, NDArray[Any]] = {}


def _placeholder(name: str) -> NDArray[Any]:
    """Return the kernel argument for a buffer that is not requested: an array of its type with one pixel."""
    if name not in _PLACEHOLDERS:
        _PLACEHOLDERS[name] = _BUFFERS[name].empty(1, 1)
    return _PLACEHOLDERS[name]


def instance_motion(placement: Placement, view: View) -> NDArray[np.float32]:
    """Return the kernels' description of each instance's motion, float32 [max(n, 1), 51].

    Columns: 0-35 mesh to camera coordinates (x right, y down, z forward) at k-1, k, k+1, each 3x4; 36-47 world
    displacement from k to k+1, 3x4; 48-50 whether the instance is present at k-1, k, k+1.
    """
    world = placement.world_from_object
    count = world.shape[1]
    motion = np.zeros((max(count, 1), kernels.MOTION_COLUMNS), np.float32)
    for time, camera in enumerate(view.cameras):
        pose = camera.world_from_camera()
        relative = world[time].copy()
        relative[:, :, 3] -= pose[:3, 3]
        motion[:count, 12 * time : 12 * time + 12] = _product(pose[:3, :3].T, relative).reshape(count, 12)
    motion[:count, kernels.DISPLACEMENT : kernels.PRESENT] = (world[NEXT] - world[CURRENT]).reshape(count, 12)
    motion[:count, kernels.PRESENT :] = placement.present.T
    return motion


def camera_motion(view: View) -> NDArray[np.float32]:
    """Return the kernels' description of the camera's motion, float32 [3, 11], one row per time.

    Columns: 0-8 rotation from the current camera's coordinates to that camera's, 3x3; 9 focal length, px; 10 whether it
    is orthographic.
    """
    rotations = view.camera_from_world()[:, :, :3]
    motion = np.empty((3, 11), np.float32)
    for time in (PREVIOUS, CURRENT, NEXT):
        motion[time, :9] = _product(rotations[time], rotations[CURRENT].T).ravel()
    motion[:, kernels.FOCAL_LENGTH] = view.focal_lengths()
    motion[:, kernels.ORTHOGRAPHIC] = [camera.orthographic_height is not None for camera in view.cameras]
    return motion


def _product(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the matrix product [..., 3, 3] x [..., 3, m] with a fixed order of summation.

    Equal poses give equal bytes on every machine and in every row of an array, unlike with BLAS or SIMD sums.
    """
    columns = [a[..., :, axis, None] * b[..., axis, None, :] for axis in range(3)]
    return columns[0] + columns[1] + columns[2]
