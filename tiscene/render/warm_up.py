# SPDX-License-Identifier: Apache-2.0
"""Warm-up: compile the kernels by rendering one pixel of a built-in scene, while the real scene is still being read."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from tiscene.frame.buffers import COLORS, times_needed
from tiscene.render.film.postprocess import Postprocessor
from tiscene.render.film.tone_map import tone_map
from tiscene.render.film.visible_lights import visible_lights
from tiscene.render.integrators.labels.label_pass import LabelPass
from tiscene.render.integrators.path.path_image import PathImage
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.render_settings import RenderSettings
from tiscene.render.renderer import UPSAMPLING_GUIDES
from tiscene.render.view import View
from tiscene.scene.camera import Camera
from tiscene.scene.description import Material, Mesh, SceneDescription
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import Placement

SIDE = 40  # vertices per side of the ground, large enough that its BVH is built by all kernels


def warm_up_steps(buffers: Sequence[str], settings: RenderSettings, emission: Callable[[], bool]) -> Iterator[None]:
    """Compile the kernels for frames of any scene, in steps.

    Args:
        buffers: Names of the buffers to render.
        settings: Render settings.
        emission: Called before the last and longest step: whether the scene has emissive surfaces, which selects the
            variant of the shading kernel.

    Yields:
        After each step.
    """
    scene = DeviceScene()
    scene.add(SceneDescription("warm-up", (_ground(),), (Material("gray"),)))
    yield
    camera = Camera()
    view = View(camera, camera, camera, 1, 1)
    scene.place(_placement(), times=times_needed(buffers))
    yield
    colored = not COLORS.isdisjoint(buffers)
    guides = UPSAMPLING_GUIDES if colored and settings.downscale > 1 else ()
    LabelPass(scene).render(view, [*guides, *(name for name in buffers if name not in (*COLORS, *guides))])
    yield
    if colored:
        black = np.zeros((1, 1, 3), np.float32)
        postprocessor = Postprocessor(settings.denoiser if settings.denoise else None, settings.downscale, True)
        tone_map(postprocessor.process(PathImage(black, black, black), black, black), 0.0)
        if guides:
            visible_lights(scene, view, np.ones((1, 1), np.float32))
        yield
        yield from PathPass(scene, 1, 1, pixel_filter=settings.pixel_filter).warm_up(view, emission)


def _ground() -> Mesh:
    """Return a grid of SIDE x SIDE vertices in the xz plane."""
    z, x = np.mgrid[:SIDE, :SIDE]
    corner = (z[:-1, :-1] * SIDE + x[:-1, :-1]).ravel()
    triangles = np.stack([corner, corner + SIDE, corner + 1], axis=-1).astype(np.int32)
    positions = np.stack([x, 0 * x, z], axis=-1).reshape(-1, 3).astype(np.float32)
    return Mesh("ground", positions, triangles, np.zeros(len(triangles), np.int32))


def _placement() -> Placement:
    """Return a placement of one instance at the identity."""
    row, pose = np.zeros(1, np.int32), np.eye(3, 4)
    return Placement(row, row + 1, row, np.tile(pose, (3, 1, 1, 1)), pose[None], np.ones((3, 1), bool))
