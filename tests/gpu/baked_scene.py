# SPDX-License-Identifier: Apache-2.0
"""Scenes as arrays in one small file, with what the CPU renders of them, for a machine without OpenUSD and textures.

A file is a pickle, compressed by LZMA. Read only files that `python -m tests.gpu.bake` wrote.
"""

from __future__ import annotations

import lzma
import math
import pickle
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynamics.rotation import multiply
from tiscene.render.integrators.labels.label_pass import LabelPass
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.view import View
from tiscene.scene.camera import Camera
from tiscene.scene.description import SceneDescription, Texture
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT, NEXT, PREVIOUS, Placement

LABELS = ("semantic", "instance", "part", "depth", "normal", "uv", "forward_flow", "albedo")
LABEL_SIZE, COLOR_SIZE = (160, 120), (48, 36)
COLOR_SPP, COLOR_DEPTH = 256, 6
SUFFIX = ".scene"
FOLDER_NAME = "gpu-scenes"
SPHERE = "sphere"  # name of the closed scene


@dataclass(frozen=True, eq=False)
class BakedScene:
    """A scene description, placements, and expected images.

    Attributes:
        name: its name.
        description: all meshes, materials, textures and lights.
        camera: the camera.
        placements: placements of successive frames.
        moving: bool [n], the instances that move.
        labels: label buffers of frame 0 by name, LABEL_SIZE.
        radiance: two path-traced images of frame 0 with independent noise, float32 [2, h, w, 3], COLOR_SIZE.
    """

    name: str
    description: SceneDescription
    camera: Camera
    placements: tuple[Placement, ...]
    moving: NDArray[np.bool_]
    labels: dict[str, NDArray[Any]]
    radiance: NDArray[np.float32]

    def view(self, size: tuple[int, int], turned: float = 0.0) -> View:
        """Return the camera's view in an image size, turned about the vertical axis by an angle, rad."""
        turn = np.array([math.cos(0.5 * turned), 0.0, math.sin(0.5 * turned), 0.0])
        w, x, y, z = multiply(turn, np.array(self.camera.rotation)).tolist()
        camera = self.camera.with_pose(self.camera.position, (w, x, y, z))
        return View(camera, camera, camera, *size)

    def device_scene(self) -> DeviceScene:
        """Return the scene on the device, placed at frame 0."""
        scene = DeviceScene()
        scene.add(self.description)
        scene.place(self.placements[0], times=(PREVIOUS, CURRENT, NEXT))
        return scene

    def render_labels(self, scene: DeviceScene) -> dict[str, NDArray[Any]]:
        """Return the label buffers of frame 0."""
        return LabelPass(scene).render(self.view(LABEL_SIZE), LABELS)

    def render_radiance(self, scene: DeviceScene, seed: int, spp: int = COLOR_SPP) -> NDArray[np.float32]:
        """Return a path-traced image of frame 0."""
        paths = PathPass(scene, *COLOR_SIZE)
        return paths.render(self.view(COLOR_SIZE), frame_index=0, seed=seed, spp=spp, max_depth=COLOR_DEPTH).hdr

    def save(self, folder: Path) -> Path:
        """Write the scene to a folder and return the file's path."""
        path = folder / f"{self.name}{SUFFIX}"
        path.write_bytes(lzma.compress(pickle.dumps(self, protocol=5), preset=6))
        return path


def load(folder: Path) -> list[BakedScene]:
    """Return the scenes of a folder by name.

    Raises:
        FileNotFoundError: The folder has none.
    """
    files = sorted(folder.glob(f"*{SUFFIX}"))
    if not files:
        raise FileNotFoundError(f"{folder}: no baked scene; write them first: python -m tests.gpu.bake {folder}")
    return [pickle.loads(lzma.decompress(file.read_bytes())) for file in files]


def bake(
    name: str,
    description: SceneDescription,
    camera: Camera,
    placements: tuple[Placement, ...],
    moving: NDArray[np.bool_],
    largest_texture: int,
) -> BakedScene:
    """Render what the CPU expects of a scene and return both.

    Args:
        name: of the scene.
        description: its data.
        camera: its camera.
        placements: of successive frames.
        moving: bool [n], the instances that move.
        largest_texture: textures are reduced to at most this width and height, px, for expectations as well.
    """
    textures = tuple(_reduced(texture, largest_texture) for texture in description.textures)
    bare = BakedScene(
        name, replace(description, textures=textures, templates=()), camera, placements, moving, {}, np.zeros(0)
    )
    scene = bare.device_scene()
    labels = bare.render_labels(scene)
    radiance = np.stack([bare.render_radiance(scene, seed) for seed in (1, 2)])
    return replace(bare, labels=labels, radiance=radiance)


def _reduced(texture: Texture, largest: int) -> Texture:
    """Return a texture with every n-th pixel."""
    pixels = texture.pixels
    step = -(-max(pixels.shape[:2]) // largest)
    return texture if step == 1 else replace(texture, pixels=np.ascontiguousarray(pixels[::step, ::step]), copies=None)
