# SPDX-License-Identifier: Apache-2.0
"""Path tracing of several frames in one wavefront, for GPUs: one launch of each kernel per segment for all frames."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tiscene.render.integrators.path.frame_stack import FrameStack
from tiscene.render.integrators.path.path_image import PathImage, developed
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.integrators.path.path_state import PathSamples
from tiscene.render.intersect.ray_queue import tiled_order, upload_pixels
from tiscene.render.sampling.sobol import frame_key, index_bits
from tiscene.render.view import View
from tiscene.scene.placement import CURRENT, Placement


class PathFrames(PathPass):
    """Path tracer for several placements of a DeviceScene at once. Arguments are those of `PathPass`."""

    def render_frames(
        self,
        views: Sequence[View],
        placements: Sequence[Placement],
        frame_indices: Sequence[int],
        *,
        seed: int,
        spp: int,
        max_depth: int,
    ) -> list[PathImage] | None:
        """Place and render several frames: the bytes of `PathPass.render` frame by frame.

        Args:
            views: Camera of each frame.
            placements: The instances of each frame.
            frame_indices: Number of each frame.
            seed: See `PathPass.render`.
            spp: See `PathPass.render`.
            max_depth: See `PathPass.render`.

        Returns:
            The images. None if frames cannot be rendered at once: a mesh deforms, a light or a material varies, a mesh
            that emits light moves, comes or goes, the backgrounds differ, or fewer than two frames fit in a batch of
            paths.
        """
        paths = self.width * self.height * spp
        at_once = min(self._batch_size // paths, len(views))
        if at_once < 2 or not self._may_be_stacked(views, placements):
            return None
        for view in views:
            self._check(view, spp, max_depth)
        images: list[PathImage] = []
        for begin in range(0, len(views), at_once):
            part = slice(begin, begin + at_once)
            keys = [frame_key(seed, index) for index in frame_indices[part]]
            images += self._render_stack(views[part], placements[part], keys, spp, max_depth)
        return images

    def _may_be_stacked(self, views: Sequence[View], placements: Sequence[Placement]) -> bool:
        varies = any(placement.materials or placement.lights is not None for placement in placements)
        one_background = len({view.background for view in views}) == 1
        return one_background and not (varies or self.scene.deforms) and self._emit_alike(placements)

    def _emit_alike(self, placements: Sequence[Placement]) -> bool:
        """Return whether meshes emit no light, or the same in all frames."""
        if not self.scene.materials.any_emission:
            return True
        first = placements[0]
        rows = self.scene.emissive.of(first.mesh)
        return all(
            np.array_equal(each.mesh, first.mesh)
            and np.array_equal(each.present[CURRENT, rows], first.present[CURRENT, rows])
            and np.array_equal(each.world_from_object[CURRENT, rows], first.world_from_object[CURRENT, rows])
            for each in placements
        )

    def _render_stack(
        self, views: Sequence[View], placements: Sequence[Placement], keys: list[int], spp: int, max_depth: int
    ) -> list[PathImage]:
        count, pixels = len(views), self.width * self.height
        if self.scene.materials.any_emission:
            self.scene.place(placements[0])  # lights that are meshes; their rows are those of the first frame
        self.scene.place_frames(placements)
        instances, roots = len(placements[0].mesh), self.scene.frame_roots(CURRENT)
        cameras = np.concatenate([view.rows() for view in views])
        single, self._stack = self._stack, FrameStack.of(pixels * spp, instances, keys, cameras, roots)
        self._reserve(count)
        try:
            self._trace(views[0], count * pixels, PathSamples(spp, index_bits(spp), 0), max_depth)
        finally:
            self._stack = single
        image, self.nonfinite = developed(self.film, self.pixels, (count * self.height, self.width), spp)
        images = image.hdr, image.albedo, image.normal
        rows = [slice(row, row + self.height) for row in range(0, count * self.height, self.height)]
        return [PathImage(*(each[part].copy() for each in images)) for part in rows]

    def _reserve(self, frames: int) -> None:
        """Make the pixels of this many frames below each other."""
        if self._pixels is None or self._pixels.shape[0] != frames * self.width * self.height:
            self._pixels = upload_pixels(tiled_order(self.width, self.height), self.width, self.height, frames)
