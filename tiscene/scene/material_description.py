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
    """A material input that is read from a texture: `value = (pixel[channel] * scale + bias) * vertex_factor`.

    Attributes:
        texture: Row of `SceneDescription.textures`. VERTEX_COLORS: the colors of the mesh's vertices.
        channel: "rgb" or one of "r", "g", "b", "a".
        scale: Factor, RGBA.
        bias: Summand, RGBA.
        uv_transform: 2x3 affine map, row-major, applied to uv before the lookup (UsdTransform2d).
        uv_set: 0 for the mesh's uv, 1 for its second uv.
        vertex_factor: "rgb": the colors of the mesh's vertices; "a": their opacity; "": 1.
    """

    texture: int
    channel: Literal["rgb", "r", "g", "b", "a"] = "rgb"
    scale: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    bias: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    uv_transform: tuple[float, float, float, float, float, float] = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    uv_set: Literal[0, 1] = 0
    vertex_factor: Literal["", "rgb", "a"] = ""


ColorInput = Color | TextureLookup
FloatInput = float | TextureLookup


@dataclass(frozen=True)
class ExtendedLobes:
    """Lobes that UsdPreviewSurface lacks, of MaterialX and glTF materials. The defaults have no effect.

    Attributes:
        transmission_color: Factor of light that crosses the surface of glass, once for each crossing.
        absorption: Absorption coefficients of the solid that glass encloses, 1/m: Beer and Lambert's law.
        thin_walled: The surface is a sheet without thickness: light passes it without refraction.
        sheen_color: Factor of the sheen of cloth, above all lobes except the coat.
        sheen_roughness: Roughness r of Estevez and Kulla's sheen.
        anisotropy: 1 - alpha_y / alpha_x of specular reflection, 0..1. alpha_x, along u, is `roughness`² times the root
            of 2 / (1 + (1 - anisotropy)²), as in OpenPBR: the mean of the squares is roughness⁴.
        rotation: Of the direction of alpha_x from that of u towards that of v, turns.
        specular: Factor of specular reflection of dielectrics, at all angles.
        specular_tint: Factor of their reflectance at normal incidence.
        coat_color: Factor of the light from below the coat.
        coat_ior: Index of refraction of the coat, which gives its reflectance.
        translucency: Fraction of diffuse light that leaves on the other side.
        translucent_color: Its color.
    """

    transmission_color: ColorInput = (1.0, 1.0, 1.0)
    absorption: Color = (0.0, 0.0, 0.0)
    thin_walled: bool = False
    sheen_color: ColorInput = (0.0, 0.0, 0.0)
    sheen_roughness: FloatInput = 0.3
    anisotropy: FloatInput = 0.0
    rotation: FloatInput = 0.0
    specular: FloatInput = 1.0
    specular_tint: ColorInput = (1.0, 1.0, 1.0)
    coat_color: ColorInput = (1.0, 1.0, 1.0)
    coat_ior: float = 1.5
    translucency: FloatInput = 0.0
    translucent_color: ColorInput = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class Material:
    """UsdPreviewSurface; the inputs have its names and defaults.

    Attributes:
        name: Name of the prim.
        opacity_mode: "presence": opacity is coverage. "transmission": the rest, even of a texture, enters the solid.
            "transparent": see `material_table.flags_of`.
        normal: Normal map in tangent space. None: the mesh's shading normals.
        prim_path: Path on the stage; in a template's file such as "Chair 01/Looks/Oak". "" for the default material of
            meshes without one.
        lobes: Further lobes; None: none.
        seen_by_camera: False: rays from the camera pass the surface, and it has no labels; mirrors, glass and shadows
            show it.
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
    opacity_mode: Literal["transparent", "presence", "transmission"] = "transparent"
    opacity_threshold: float = 0.0
    ior: float = 1.5
    normal: TextureLookup | None = None
    prim_path: str = ""
    lobes: ExtendedLobes | None = None
    seen_by_camera: bool = True
