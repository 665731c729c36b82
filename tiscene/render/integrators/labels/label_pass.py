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

from tiscene.device.kept_uploads import KeptUploads
from tiscene.device.memory import upload
from tiscene.device.restart import cached_on_device
from tiscene.errors import BufferNotFound
from tiscene.frame.buffers import LABELS, times_needed
from tiscene.render.integrators.labels import label_kernels as kernels
from tiscene.render.integrators.labels.coverage import COVERAGES, CoverageLabels, CoverageSamples
from tiscene.render.integrators.labels.first_hits import (
    StaticHits,
    counter,
    find_occlusion,
    first_hits,
    keep_nearer,
)
from tiscene.render.integrators.labels.label_frames import LabelFrames
from tiscene.render.integrators.labels.label_images import Images, LabelImages
from tiscene.render.integrators.labels.static_labels import StaticImage, StaticLabelCache, boxes_in_view
from tiscene.render.integrators.labels.surface_labels import (
    FILTERED_ALBEDO,
    MATERIAL_BUFFERS,
    SURFACE_BUFFERS,
    surface_labels,
)
from tiscene.render.intersect.ray_queue import RayArrays
from tiscene.render.intersect.surface_interaction import geometry_of
from tiscene.render.view import View
from tiscene.scene.affine_maps import corners_of
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT, MOVERS, NEXT, PREVIOUS, Placement

MAX_MIRRORS = 4  # a mirror behind this many others is labeled itself
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
        on_card = scene.traversal == "bvh2"
        self._images = LabelImages(on_card)
        self._uploads = KeptUploads() if on_card else None
        self._coverage = CoverageLabels(scene)
        self._static_labels = StaticLabelCache(scene)

    def render(
        self, view: View, buffers: Sequence[str], static_hits: StaticHits | None = None
    ) -> dict[str, NDArray[Any]]:
        """Render label buffers.

        Args:
            view: Camera and image size.
            buffers: Names of label buffers, or FILTERED_ALBEDO. Others cost nothing. The scene must be placed at
                `times_needed(buffers)`.
            static_hits: What the view shows of static instances, if it is known; only others are traced then, and
                become part of it.

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
            arrays = self._images.empty(buffers, view.width, view.height)
            self._draw(self._frame(view), rays.queue, rays.count, arrays, static_hits=static_hits)
        else:
            image, changed, moving = cached
            arrays = self._images.copied(image.arrays, buffers)
            queue, count = self._rays.resized(view.width, view.height).queue_of(changed)
            if count and not arrays.keys().isdisjoint(COVERAGES):
                self.scene.place_movers(moving)
            if count:
                self._draw(self._frame(view), queue, count, arrays, static=image.samples)
        return self._images.results(arrays)

    def render_frames(
        self, views: Sequence[View], placements: Sequence[Placement], buffers: Sequence[str]
    ) -> list[dict[str, NDArray[Any]]] | None:
        """Place and render several frames at once, for GPUs: one launch of each kernel, the same bytes as one by one.

        Args:
            views: Camera of each frame; all of one image size.
            placements: The instances of each frame.
            buffers: Names of label buffers, as of `render`.

        Returns:
            New arrays by name for each frame. None if the frames cannot be rendered at once: a mesh deforms, a material
            varies, fractions of pixels are asked for, or there is one frame only.
        """
        varies = self.scene.deforms or any(placement.materials for placement in placements)
        if varies or len(views) < 2 or not buffers or not set(buffers).isdisjoint(COVERAGES):
            return None
        self.scene.place_frames(placements, times_needed(buffers))
        width, height = views[0].width, views[0].height
        rays = self._rays.resized(width, height * len(views))
        arrays = self._images.empty(buffers, width, height * len(views))
        self.traced_pixels = 0
        self._draw(LabelFrames.of(views, placements, self._uploads), rays.queue, rays.count, arrays)
        frames = [slice(row, row + height) for row in range(0, height * len(views), height)]
        results = self._images.results(arrays)
        return [{name: array[rows].copy() for name, array in results.items()} for rows in frames]

    def _draw_static(self, view: View, buffers: Sequence[str]) -> StaticImage:
        """Draw all pixels of a new image for the cache."""
        rays = self._rays.resized(view.width, view.height)
        shape = (view.height, view.width)
        arrays = self._images.empty(buffers, view.width, view.height, lasting=True)
        samples = None
        if not arrays.keys().isdisjoint(COVERAGES):
            samples = CoverageSamples.empty(rays.count, self._images.on_card)
        image = StaticImage(arrays, np.empty(shape, np.float32), np.zeros(shape, bool), samples)
        self._draw(self._frame(view), rays.queue, rays.count, arrays, image)
        return image

    def _frame(self, view: View) -> LabelFrames:
        return LabelFrames.of([view], [self.scene.placement], self._uploads)

    def _draw(
        self,
        frames: LabelFrames,
        queue: Any,
        count: int,
        arrays: Images,
        image: StaticImage | None = None,
        static: CoverageSamples | None = None,
        static_hits: StaticHits | None = None,
    ) -> None:
        """Write the queued pixels.

        Args:
            frames: What is rendered: one frame, or several without coverage.
            queue: i32 pixel numbers on the device.
            count: Number of queued pixels.
            arrays: Output, buffers by name.
            image: Output, the cached image that the buffers belong to, if any.
            static: Coverage samples of the static instances; then only movers are traced for coverage.
            static_hits: See `render`.
        """
        self.traced_pixels += count
        rays, pixels = self._rays, frames.pixels
        if static_hits is None:
            kernels.primary_rays(queue, count, frames.cameras, frames.width, frames.height, rays.rays, frames.stacked)
            first_hits(self.scene, CURRENT, rays, queue, count, coherent=True, rays_per_frame=pixels)
        else:
            rays = static_hits.rays
            self._find_movers(frames, static_hits)
        if image is not None:
            image.max_distance[...] = rays.hits.to_numpy()[:, 0].reshape(image.max_distance.shape)

        if not arrays.keys().isdisjoint(COVERAGES):
            view = frames.views[0]
            max_distance, samples = (None, None) if image is None else (image.max_distance, image.samples)
            self._coverage.render(view, queue, count, arrays, max_distance, static, samples)

        mirrors = self._draw_surfaces(frames, rays, queue, count, arrays, SURFACE_BUFFERS, 0)
        for name, time in _OCCLUSIONS:
            if name in arrays:
                self._draw_occlusion(frames, rays, queue, count, time, self._images.argument(arrays, name))
        # Last: reflected rays overwrite the hits.
        followed = 0
        while mirrors:
            queue, count = rays.mirrored[followed % 2], mirrors
            if image is not None and followed == 0:
                image.mirrors.ravel()[queue.to_numpy()[:count]] = True
            first_hits(self.scene, CURRENT, rays, queue, count, rays_per_frame=pixels)
            followed += 1
            mirrors = self._draw_surfaces(frames, rays, queue, count, arrays, MATERIAL_BUFFERS, followed)

    def _find_movers(self, frames: LabelFrames, static_hits: StaticHits) -> None:
        """Trace rays through the pixels that movers may cover, and put their hits among the static ones."""
        view, static, movers = frames.views[0], static_hits.rays, self._rays
        boxes = self.scene.place_movers(static_hits.moving)
        covered = np.zeros((view.height, view.width), bool)
        for here, _ in boxes_in_view(view, corners_of(boxes.reshape(-1, 2, 3))):
            covered[here] = True
        queue, count = movers.queue_of(covered)
        if not count:
            return
        camera = frames.cameras, frames.width, frames.height
        kernels.primary_rays(queue, count, *camera, movers.rays, frames.stacked)
        first_hits(self.scene, MOVERS, movers, queue, count)
        passed = movers.mirrored[0]
        count = keep_nearer(
            queue, count, movers.rays, movers.hits, movers.hit_ids, static.rays, static.hits, static.hit_ids, passed,
            counter(),
        )  # fmt: skip
        if count:
            kernels.primary_rays(passed, count, *camera, static.rays, frames.stacked)
            first_hits(self.scene, CURRENT, static, passed, count)

    def _draw_surfaces(
        self,
        frames: LabelFrames,
        rays: RayArrays,
        queue: Any,
        count: int,
        arrays: Images,
        buffers: Sequence[str],
        followed: int,
    ) -> int:
        """Write those of `buffers` that are among the arrays; return the number of rays that mirrors reflected.

        Args:
            frames: What is rendered.
            rays: The rays, with their hits.
            queue: i32 pixel numbers on the device.
            count: Number of queued pixels.
            arrays: Output, buffers by name.
            buffers: Names of the buffers to write.
            followed: Number of mirrors that reflected the rays before.
        """
        wanted = tuple(name in arrays and name in buffers for name in SURFACE_BUFFERS)
        if not any(wanted):
            return 0
        mirrors = surface_labels(
            queue, count, rays.rays, rays.hits, rays.hit_ids,
            *geometry_of(self.scene), *self.scene.materials.arrays(), *self.scene.textures.arrays(),
            self.scene.box_from_instance, self.scene.triangle_part,
            frames.instance_motion, frames.camera_motion, frames.cameras, frames.width, frames.height,
            int(followed < MAX_MIRRORS), rays.mirrored[followed % 2], counter(), _uploaded_flags(wanted),
            *(self._images.argument(arrays, name) for name in SURFACE_BUFFERS), frames.stacked,
        )  # fmt: skip
        return int(mirrors)

    def _draw_occlusion(
        self, frames: LabelFrames, rays: RayArrays, queue: Any, count: int, time: int, occluded: Any
    ) -> None:
        """Write whether the queued pixels' surface points are occluded from the camera at another time."""
        scene, sight = self.scene, self._occlusion_rays.resized(frames.width, frames.height * len(frames.views))
        materials = scene.materials.arrays_at(float(scene.placement.seconds[time]))
        find_occlusion(scene, frames, time, materials, rays, sight, queue, count, occluded)


@cached_on_device(maxsize=64)
def _uploaded_flags(flags: tuple[bool, ...]) -> Any:
    return upload(np.array(flags, np.int32))
