# SPDX-License-Identifier: Apache-2.0
"""Materials and textures of a scene description: UsdPreviewSurface with its inputs, names and defaults."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Color = tuple[float, float, float]

VERTEX_COLORS = -1


@dataclass(frozen=True, eq=False)
class Texture:
    """An image, its first row at the top (v = 1).

    Attributes:
        name: For messages.
        pixels: uint8 or float32, shape (height, width, 4), RGBA.
        encoding: "srgb": decoded to linear when read; "raw": used as it is. Alpha is always raw.
        wrap_s: Values outside 0..1 in u. "black" is transparent black.
        wrap_t: The same in v.
        copies: The mipmap levels below this one (`textures.mipmaps`). None: not made yet.
    """

    name: str
    pixels: NDArray[np.uint8] | NDArray[np.float32]
    encoding: Literal["srgb", "raw"] = "srgb"
    wrap_s: Literal["repeat", "clamp", "mirror", "black"] = "repeat"
    wrap_t: Literal["repeat", "clamp", "mirror", "black"] = "repeat"
    copies: tuple[Texture, ...] | None = None


@dataclass(frozen=True)
class TextureLookup:
    """A material input that is read from a texture: `value = pixel[channel] * scale + bias`.

    Attributes:
        texture: Row of `SceneDescription.textures`. VERTEX_COLORS: the colors of the mesh's vertices.
        channel: "rgb" or one of "r", "g", "b", "a".
        scale: Factor, RGBA.
        bias: Summand, RGBA.
        uv_transform: 2x3 affine map, row-major, applied to uv before the lookup (UsdTransform2d).
        uv_set: 0 for the mesh's uv, 1 for its second uv.
    """

    texture: int
    channel: Literal["rgb", "r", "g", "b", "a"] = "rgb"
    scale: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    bias: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    uv_transform: tuple[float, float, float, float, float, float] = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    uv_set: Literal[0, 1] = 0


ColorInput = Color | TextureLookup
FloatInput = float | TextureLookup


@dataclass(frozen=True)
class Material:
    """UsdPreviewSurface; the inputs have its names and defaults.

    Attributes:
        name: Name of the prim.
        normal: Normal map in tangent space. None: the mesh's shading normals.
        prim_path: Path on the stage; in a template's file such as "Chair 01/Looks/Oak". "" for the default material of
            meshes without one.
    """

    name: str
    diffuse_color: ColorInput = (0.18, 0.18, 0.18)
    emissive_color: ColorInput = (0.0, 0.0, 0.0)
    use_specular_workflow: bool = False
    specular_color: ColorInput = (0.0, 0.0, 0.0)
    metallic: FloatInput = 0.0
    roughness: FloatInput = 0.5
    clearcoat: FloatInput = 0.0
    clearcoat_roughness: FloatInput = 0.01
    opacity: FloatInput = 1.0
    opacity_mode: Literal["transparent", "presence"] = "transparent"
    opacity_threshold: float = 0.0
    ior: float = 1.5
    normal: TextureLookup | None = None
    prim_path: str = ""
