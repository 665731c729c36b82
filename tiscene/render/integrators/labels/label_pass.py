# SPDX-License-Identifier: Apache-2.0
"""The label pass: one ray through each pixel's center, and everything that can be said about what it meets.

No sampling, no randomness. Motion is exact to the float: the matrices that lead from each object to the cameras at
k-1, k and k+1 are multiplied in double precision, so a point's pixel position has no large world coordinates to cancel,
and what stands still before a still camera moves by exactly 0.
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
from tiscene.render.integrators.labels.static_labels import StaticImage, StillLabels
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

MAX_MIRRORS = 4  # a mirror behind so many others is labeled as itself
_AOVS = BUFFERS | {FILTERED_ALBEDO: BUFFERS["albedo"]}
_OCCLUSIONS = (("backward_occlusion", PREVIOUS), ("forward_occlusion", NEXT))


class LabelPass:
    """Renders label buffers of what a DeviceScene has placed."""

    def __init__(self, scene: DeviceScene) -> None:
        self.scene = scene
        self._rays = RayArrays()
        self._other = RayArrays()
        self._coverage = CoverageLabels(scene)
        self._still = StillLabels(scene)

    def render(self, view: View, buffers: Sequence[str]) -> dict[str, NDArray[Any]]:
        """The label buffers named, as new arrays; those not named cost nothing.

        FILTERED_ALBEDO is one of them here. The scene must have been placed at `times_needed(buffers)`. Raises
        BufferNotFound for any other name.
        """
        for name in buffers:
            if name not in LABELS and name != FILTERED_ALBEDO:
                raise BufferNotFound("label buffer", str(name), LABELS)
        if not buffers:
            return {}
        found = self._still.picture(view, buffers, times_needed(buffers), self._picture)
        if found is None:
            rays = self._rays.resized(view.width, view.height)
            arrays = _empty(view, buffers)
            self._draw(view, rays.queue, rays.count, arrays)
        else:
            picture, changed, moving = found
            arrays = {name: picture.arrays[name].copy() for name in buffers}
            queue, count = self._rays.resized(view.width, view.height).queue_of(changed)
            if count and not arrays.keys().isdisjoint(COVERAGES):
                self.scene.place_movers(moving)
            self._draw(view, queue, count, arrays, still=picture.samples)
        return arrays

    def _picture(self, view: View, buffers: Sequence[str]) -> StaticImage:
        rays = self._rays.resized(view.width, view.height)
        shape = (view.height, view.width)
        arrays = _empty(view, buffers)
        samples = None if arrays.keys().isdisjoint(COVERAGES) else CoverageSamples.empty(rays.count)
        picture = StaticImage(arrays, np.empty(shape, np.float32), np.zeros(shape, bool), samples)
        self._draw(view, rays.queue, rays.count, arrays, picture)
        return picture

    def _draw(
        self,
        view: View,
        queue: Any,
        count: int,
        arrays: dict[str, NDArray[Any]],
        picture: StaticImage | None = None,
        still: CoverageSamples | None = None,
    ) -> None:
        """Write the pixels of a queue into the arrays, and into what else belongs to a picture.

        still: what coverages have of all but the tree MOVERS.
        """
        if not count:
            return
        rays = self._rays
        kernels.primary_rays(queue, count, view.array(), view.width, view.height, rays.rays)
        first_hits(self.scene, CURRENT, rays, queue, count)
        if picture is not None:
            picture.reach[...] = rays.hits.to_numpy()[:, 0].reshape(picture.reach.shape)

        if not arrays.keys().isdisjoint(COVERAGES):
            reach = np.zeros((view.height, view.width), np.float32) if picture is None else picture.reach
            kept = None if picture is None else picture.samples
            self._coverage.render(view, queue, count, arrays, reach, still, kept)

        motion = instance_motion(self.scene.placement, view)
        cameras = camera_motion(view)
        mirrors = self._surfaces(view, queue, count, motion, cameras, arrays, SURFACE_BUFFERS, 0)
        for name, time in _OCCLUSIONS:
            if name in arrays:
                self._occlusion(view, queue, count, time, motion, cameras, arrays[name])
        # Last: what mirrors show overwrites what was hit.
        followed = 0
        while mirrors:
            queue, count = rays.mirrored[followed % 2], mirrors
            if picture is not None and followed == 0:
                picture.mirrors.ravel()[queue.to_numpy()[:count]] = True
            first_hits(self.scene, CURRENT, rays, queue, count)
            followed += 1
            mirrors = self._surfaces(view, queue, count, motion, cameras, arrays, MATERIAL_BUFFERS, followed)

    def _surfaces(
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
        """Write those of the buffers that are among the arrays; how many rays go on from mirrors.

        followed: how many mirrors led here.
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
            *(arrays.get(name, _unwanted(name)) for name in SURFACE_BUFFERS),
        )
        return int(mirrors[0])

    def _occlusion(
        self,
        view: View,
        queue: Any,
        count: int,
        time: int,
        motion: NDArray[np.float32],
        cameras: NDArray[np.float32],
        occluded: NDArray[np.bool_],
    ) -> None:
        rays, other = self._rays, self._other.resized(view.width, view.height)
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
    return {name: _AOVS[name].empty(view.width, view.height) for name in buffers}


_UNWANTED: dict[str, NDArray[Any]] = {}


def _unwanted(name: str) -> NDArray[Any]:
    """What a kernel gets in the place of a buffer that nobody wants: an array of its kind with one pixel."""
    if name not in _UNWANTED:
        _UNWANTED[name] = _AOVS[name].empty(1, 1)
    return _UNWANTED[name]


def instance_motion(placement: Placement, view: View) -> NDArray[np.float32]:
    """What kernels need of each instance's motion: float32 [max(n, 1), 51].

    Columns: 0-35 mesh to camera coordinates (x right, y down, z forward) at k-1, k, k+1, each 3x4; 36-47 world
    displacement from k to k+1, 3x4; 48-50 whether it is present at k-1, k, k+1.
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
    """float32 [3, 11], per time: the rotation from the current camera's coordinates to that camera's, 3x3, its focal
    length in px, and whether it is orthographic."""
    rotations = view.camera_from_world()[:, :, :3]
    motion = np.empty((3, 11), np.float32)
    for time in (PREVIOUS, CURRENT, NEXT):
        motion[time, :9] = _product(rotations[time], rotations[CURRENT].T).ravel()
    motion[:, kernels.FOCAL_LENGTH] = view.focal_lengths()
    motion[:, kernels.ORTHOGRAPHIC] = [camera.orthographic_height is not None for camera in view.cameras]
    return motion


def _product(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """The matrix product [..., 3, 3] x [..., 3, m], summed in one order on every machine: equal poses give equal bytes,
    wherever in an array they are."""
    columns = [a[..., :, axis, None] * b[..., axis, None, :] for axis in range(3)]
    return columns[0] + columns[1] + columns[2]
