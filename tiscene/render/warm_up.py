# SPDX-License-Identifier: Apache-2.0
"""A rehearsal: next to nothing is rendered, so that kernels are compiled before there is anything to render."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from tiscene.frame.buffers import COLORS, times_needed
from tiscene.render.film.postprocess import Postprocessor
from tiscene.render.film.tone_map import tone_map
from tiscene.render.integrators.labels.label_pass import LabelPass
from tiscene.render.integrators.path.path_pass import PathImage, PathPass
from tiscene.render.renderer import GUIDES, RenderSettings
from tiscene.render.view import View
from tiscene.scene.camera import Camera
from tiscene.scene.description import Material, Mesh, SceneDescription
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import Placement

SIDE = 40  # points of a side of the ground: a mesh of some size, whose tree is made as that of any


def rehearsal(buffers: Sequence[str], quality: RenderSettings, emission: Callable[[], bool]) -> Iterator[None]:
    """Compile what frames with these buffers need of any scene, a part at each step.

    emission: whether surfaces of it give light, as shading has to know: that takes longest, and comes last.
    """
    scene = DeviceScene()
    scene.add(SceneDescription("rehearsal", (_ground(),), (Material("gray"),)))
    yield
    camera = Camera()
    view = View(camera, camera, camera, 1, 1)
    scene.place(_placement(), times=times_needed(buffers))
    yield
    colored = not COLORS.isdisjoint(buffers)
    guides = GUIDES if colored and quality.downscale > 1 else ()
    LabelPass(scene).render(view, [*guides, *(name for name in buffers if name not in (*COLORS, *guides))])
    yield
    if colored:
        black = np.zeros((1, 1, 3), np.float32)
        cleaner = Postprocessor(quality.denoiser if quality.denoise else None, quality.downscale, True)
        tone_map(cleaner.traced(PathImage(black, black, black), black, black), 0.0)
        yield
        yield from PathPass(scene, 1, 1, pixel_filter=quality.pixel_filter).rehearse(view, emission)


def _ground() -> Mesh:
    z, x = np.mgrid[:SIDE, :SIDE]
    corner = (z[:-1, :-1] * SIDE + x[:-1, :-1]).ravel()
    triangles = np.stack([corner, corner + SIDE, corner + 1], axis=-1).astype(np.int32)
    positions = np.stack([x, 0 * x, z], axis=-1).reshape(-1, 3).astype(np.float32)
    return Mesh("ground", positions, triangles, np.zeros(len(triangles), np.int32))


def _placement() -> Placement:
    row, pose = np.zeros(1, np.int32), np.eye(3, 4)
    return Placement(row, row + 1, row, np.tile(pose, (3, 1, 1, 1)), pose[None], np.ones((3, 1), bool))
