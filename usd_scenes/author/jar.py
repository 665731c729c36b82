# SPDX-License-Identifier: Apache-2.0
"""`python -m usd_scenes.author.jar FILE.glb`: write a glazed floor jar as glTF, to try `tiscene import` with."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

from usd_scenes.author.shapes import curve

HEIGHT = 0.62
PROFILE = [[0.0, 0.0], [0.10, 0.0], [0.17, 0.16], [0.19, 0.32], [0.15, 0.47], [0.085, 0.55], [0.11, HEIGHT]]
CLAY, BLUE, RUST = (196, 178, 150), (38, 62, 84), (150, 84, 48)
BANDS = (
    (0.0, 0.27, BLUE),
    (0.33, 0.36, BLUE),
    (0.69, 0.71, RUST),
    (0.84, 1.0, BLUE),
)  # from, to, color; as fractions of the height


def write(path: Path) -> None:
    """Write a jar of 0.62 m with painted bands in a texture."""
    outside = curve(PROFILE, 60)
    inside = outside[:0:-1] + np.array([-0.008, 0.008])
    jar = trimesh.creation.revolve(np.concatenate([outside, inside]).clip(0.0), sections=96)
    paint = np.full((256, 8, 3), CLAY, np.uint8)
    for low, high, color in BANDS:
        paint[256 - round(256 * high) : 256 - round(256 * low)] = color
    material = trimesh.visual.material.PBRMaterial(
        name="Glaze", baseColorTexture=Image.fromarray(paint), roughnessFactor=0.18, metallicFactor=0.0
    )
    x, y, z = jar.vertices.T
    uv = np.stack([np.abs(np.arctan2(y, x)) / np.pi, z / HEIGHT], axis=-1)
    jar.visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    jar.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2.0, (1.0, 0.0, 0.0)))
    jar.export(path)


if __name__ == "__main__":
    write(Path(sys.argv[1]))
