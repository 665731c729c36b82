# SPDX-License-Identifier: Apache-2.0
"""Materials of imported models as UsdPreviewSurface, or as MaterialX's gltf_pbr where they need further lobes.

glTF materials map to it directly (`gltf_materials`). Phong materials (MTL files) say little about roughness and
metalness, so those are guessed from the material's name and shininess.
"""

from __future__ import annotations

import io
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from PIL import Image
from pxr import Gf, Sdf, Usd, UsdShade

from tiscene.scene.color import decode_srgb
from tiscene.scene.description import Color

Wrap = Literal["repeat", "clamp", "mirror"]
VERTEX_COLOR, VERTEX_OPACITY, VERTEX_TINT = "displayColor", "displayOpacity", "tint"  # primvars of vertices' colors


@dataclass(frozen=True)
class TextureTransform:
    """Inputs of a UsdTransform2d.

    Attributes:
        scale: of u and v.
        rotation: counter-clockwise, degrees.
        translation: of u and v.
    """

    scale: tuple[float, float]
    rotation: float
    translation: tuple[float, float]


@dataclass(frozen=True, eq=False)
class TextureMap:
    """An image for a shader input.

    Attributes:
        image: the image.
        channel: the channel or channels that are read.
        scale: factor of each channel.
        raw: whether the values are data, not sRGB colors.
        bias: summand of each channel.
        wraps: wrap modes of u and v.
        uv_set: number of the mesh's texture coordinates.
        transform: of the texture coordinates; None: none.
    """

    image: Image.Image
    channel: Literal["rgb", "r", "g", "b", "a"] = "rgb"
    scale: Color = (1.0, 1.0, 1.0)
    raw: bool = False
    bias: Color = (0.0, 0.0, 0.0)
    wraps: tuple[Wrap, Wrap] = ("repeat", "repeat")
    uv_set: int = 0
    transform: TextureTransform | None = None


@dataclass(frozen=True, eq=False)
class ImportedMaterial:
    """A material as inputs of UsdPreviewSurface.

    Attributes:
        name: the material's name.
        inputs: constant values by input name.
        maps: textures by input name; they override `inputs`.
        vertex_inputs: primvars of the mesh by input name; they override `inputs`. VERTEX_TINT multiplies `maps`.
        lobes: constant inputs of MaterialX's gltf_pbr that UsdPreviewSurface lacks. If there are some, the material is
            written as gltf_pbr.
        lobe_maps: textures of such inputs; they override `lobes`.
    """

    name: str
    inputs: Mapping[str, float | int | Color | str]
    maps: Mapping[str, TextureMap] = field(default_factory=dict)
    vertex_inputs: Mapping[str, str] = field(default_factory=dict)
    lobes: Mapping[str, float | Color] = field(default_factory=dict)
    lobe_maps: Mapping[str, TextureMap] = field(default_factory=dict)


# Inputs of typical materials by words in a Phong material's name; the first match counts.
_KINDS: tuple[tuple[str, dict[str, float]], ...] = (
    ("mirror|spiegel|specchio", {"metallic": 1.0, "roughness": 0.0}),
    ("plastic|vinyl|pvc|polymer", {"roughness": 0.4}),
    ("chrom|polished|inox", {"metallic": 1.0, "roughness": 0.08}),
    ("metal|steel|iron|alu|brass|gold|silver|copper|bronze", {"metallic": 1.0, "roughness": 0.3}),
    ("glass|vidro|crystal|vetro|verre", {"roughness": 0.0, "glass": 1.0}),
    ("ceramic|porcelain|enamel|sanitary", {"roughness": 0.1}),
    ("leather|leder|cuir", {"roughness": 0.5}),
    (
        "fabric|cloth|textil|cotton|linen|wool|carpet|rug|towel|pillow|cushion|mattress|sheet|curtain|sofa",
        {"roughness": 0.9},
    ),
    ("wood|oak|pine|walnut|madera|legno|bois|holz|parquet", {"roughness": 0.45}),
    ("rubber|tire|tyre", {"roughness": 0.8}),
    ("leaf|leaves|plant|grass", {"roughness": 0.55}),
    ("stone|marble|granite|rock|concrete|brick", {"roughness": 0.6}),
)


def from_phong(
    name: str, diffuse: Color, *, shininess: float | None = None, opacity: float = 1.0, image: Image.Image | None = None
) -> ImportedMaterial:
    """Convert a Phong material.

    Args:
        name: its name, from which metalness and roughness are guessed.
        diffuse: diffuse color, sRGB, 0..1.
        shininess: Phong exponent; None if unknown.
        opacity: 0..1.
        image: diffuse texture; transparent texels become cutouts.
    """
    words = re.sub(r"([a-z])([A-Z])", r"\1 \2", name).lower()
    kind = next((dict(kind) for pattern, kind in _KINDS if re.search(pattern, words)), {})
    roughness = 0.6 if shininess is None else min(max(math.sqrt(2.0 / (shininess + 2.0)) ** 0.5, 0.05), 1.0)
    glass = kind.pop("glass", 0.0) > 0.0 and image is None
    # An albedo above that of fresh snow comes from programs whose lights are dimmer than 1.
    color = tuple(np.minimum(decode_srgb(np.clip(diffuse, 0.0, 1.0)), 0.85).tolist())
    inputs: dict[str, Any] = {"diffuseColor": color, "roughness": roughness} | kind
    if glass or opacity < 1.0:
        inputs |= {"opacity": 0.1 if glass and opacity >= 1.0 else max(opacity, 0.0), "opacityMode": "presence"}
    maps = {} if image is None else {"diffuseColor": TextureMap(image)}
    if image is not None and has_holes(image):
        maps["opacity"] = TextureMap(image, "a")
        inputs |= {"opacityThreshold": 0.5}
    return ImportedMaterial(name, inputs, maps)


def has_holes(image: Image.Image) -> bool:
    """Return whether an image has texels of alpha below one half."""
    if image.mode not in ("RGBA", "LA", "PA") and "transparency" not in image.info:
        return False
    return bool((np.asarray(image.convert("RGBA"))[..., 3] < 128).any())


def define_material(stage: Usd.Stage, path: Sdf.Path, imported: ImportedMaterial, folder: Path) -> UsdShade.Material:
    """Author a material; its images are written to `folder`/textures."""
    material = UsdShade.Material.Define(stage, path)
    surface = UsdShade.Shader.Define(stage, path.AppendChild("Surface"))
    if imported.lobes:
        imported = _as_gltf_pbr(imported)
        surface.CreateIdAttr("ND_gltf_pbr_surfaceshader")
        output = surface.CreateOutput("out", Sdf.ValueTypeNames.Token)
        material.CreateSurfaceOutput("mtlx").ConnectToSource(output)
    else:
        surface.CreateIdAttr("UsdPreviewSurface")
        output = surface.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    for name, value in imported.inputs.items():
        if name not in imported.maps and name not in imported.vertex_inputs:
            value = Gf.Vec3f(*value) if isinstance(value, tuple) else value
            _input(surface, name).Set(value)
    for name, primvar in imported.vertex_inputs.items():
        kind = _VERTEX_TYPES[primvar]
        reader = UsdShade.Shader.Define(stage, path.AppendChild(f"Vertex{name[0].upper()}{name[1:]}"))
        reader.CreateIdAttr(f"UsdPrimvarReader_{kind}")
        reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set(primvar)
        color = reader.CreateOutput("result", kind)
        if primvar != VERTEX_TINT:
            _input(surface, name).ConnectToSource(color)
    for name, source in imported.maps.items():
        kind = Sdf.ValueTypeNames.Float3 if source.channel == "rgb" else Sdf.ValueTypeNames.Float
        texture = _define_texture(stage, path, name, source, folder)
        read = texture.CreateOutput(source.channel, kind)
        _input(surface, name).ConnectToSource(read)
        if name in imported.vertex_inputs:
            tint = path.AppendChild(f"Vertex{texture.GetPath().name}").AppendProperty("outputs:result")
            texture.CreateInput("scale", Sdf.ValueTypeNames.Float4).ConnectToSource(tint)
    material.CreateSurfaceOutput().ConnectToSource(output)
    return material


def _as_gltf_pbr(imported: ImportedMaterial) -> ImportedMaterial:
    """Return a material whose inputs have the names of gltf_pbr."""
    inputs = {_GLTF_NAMES[name]: value for name, value in imported.inputs.items() if name in _GLTF_NAMES}
    if "opacity" in imported.inputs:
        inputs["alpha_mode"] = 1 if imported.inputs.get("opacityThreshold") else 2  # mask, blend
    maps = {_GLTF_NAMES[name]: map_ for name, map_ in imported.maps.items() if name in _GLTF_NAMES}
    read = {_GLTF_NAMES[name]: primvar for name, primvar in imported.vertex_inputs.items()}
    return ImportedMaterial(imported.name, {**inputs, **imported.lobes}, {**maps, **imported.lobe_maps}, read)


def _define_texture(stage: Usd.Stage, path: Sdf.Path, name: str, source: TextureMap, folder: Path) -> UsdShade.Shader:
    """Author the texture of an input, and the shaders of its coordinates."""
    texture = UsdShade.Shader.Define(stage, path.AppendChild(name[0].upper() + name[1:]))
    texture.CreateIdAttr("UsdUVTexture")
    file = _save_image(source.image, folder / "textures", path.name, raw=source.raw)
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(Sdf.AssetPath(f"./textures/{file}"))
    texture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("raw" if source.raw else "sRGB")
    number = str(source.uv_set or "")
    reader = UsdShade.Shader.Define(stage, path.AppendChild(f"Coordinates{number}"))
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set(f"st{number}")
    coordinates = reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    if source.transform is not None:
        moved = UsdShade.Shader.Define(stage, path.AppendChild(f"{texture.GetPath().name}Transform"))
        moved.CreateIdAttr("UsdTransform2d")
        moved.CreateInput("in", Sdf.ValueTypeNames.Float2).ConnectToSource(coordinates)
        moved.CreateInput("scale", Sdf.ValueTypeNames.Float2).Set(Gf.Vec2f(*source.transform.scale))
        moved.CreateInput("rotation", Sdf.ValueTypeNames.Float).Set(source.transform.rotation)
        moved.CreateInput("translation", Sdf.ValueTypeNames.Float2).Set(Gf.Vec2f(*source.transform.translation))
        coordinates = moved.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(coordinates)
    for axis, mode in zip(("wrapS", "wrapT"), source.wraps, strict=True):
        texture.CreateInput(axis, Sdf.ValueTypeNames.Token).Set(mode)
    is_alpha = source.channel == "a"
    scale = (*source.scale, source.scale[0] if is_alpha else 1.0)
    bias = (*source.bias, source.bias[0] if is_alpha else 0.0)
    if name == "normal" and not any(bias):  # of formats that say nothing about its range
        scale, bias = (2.0, 2.0, 2.0, 1.0), (-1.0, -1.0, -1.0, 0.0)
    if scale != (1.0,) * 4:
        texture.CreateInput("scale", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*scale))
    if any(bias):
        texture.CreateInput("bias", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*bias))
    return texture


_VERTEX_TYPES = {
    VERTEX_COLOR: Sdf.ValueTypeNames.Float3,
    VERTEX_OPACITY: Sdf.ValueTypeNames.Float,
    VERTEX_TINT: Sdf.ValueTypeNames.Float4,
}
_GLTF_NAMES = {
    "diffuseColor": "base_color",
    "metallic": "metallic",
    "roughness": "roughness",
    "clearcoat": "clearcoat",
    "clearcoatRoughness": "clearcoat_roughness",
    "emissiveColor": "emissive",
    "opacity": "alpha",
    "opacityThreshold": "alpha_cutoff",
    "ior": "ior",
    "normal": "normal",
}
_TYPES = {  # of inputs that are no number
    **dict.fromkeys(("diffuseColor", "emissiveColor", "specularColor"), Sdf.ValueTypeNames.Color3f),
    **dict.fromkeys(("base_color", "emissive", "sheen_color"), Sdf.ValueTypeNames.Color3f),
    **dict.fromkeys(("specular_color", "attenuation_color"), Sdf.ValueTypeNames.Color3f),
    **dict.fromkeys(("alpha_mode", "useSpecularWorkflow"), Sdf.ValueTypeNames.Int),
    "normal": Sdf.ValueTypeNames.Normal3f,
    "opacityMode": Sdf.ValueTypeNames.Token,
}


def _input(surface: UsdShade.Shader, name: str) -> UsdShade.Input:
    """Create an input of a surface shader, of its type."""
    return surface.CreateInput(name, _TYPES.get(name, Sdf.ValueTypeNames.Float))


def _save_image(image: Image.Image, folder: Path, name: str, *, raw: bool) -> str:
    """Write an image, once for all its uses; JPEG files stay JPEG. Return the file's name."""
    folder.mkdir(parents=True, exist_ok=True)
    jpeg = image.format == "JPEG" and image.mode in ("RGB", "L")
    file = folder / f"{name}_{'data' if raw else 'color'}{'.jpg' if jpeg else '.png'}"
    number = 1
    while file.exists() and file.read_bytes() != _encode(image, jpeg):
        number += 1
        file = file.with_name(f"{file.stem.rstrip('0123456789')}{number}{file.suffix}")
    file.write_bytes(_encode(image, jpeg))
    return file.name


def _encode(image: Image.Image, jpeg: bool) -> bytes:
    """Return an image as the bytes of a JPEG or PNG file."""
    buffer = io.BytesIO()
    image = image if image.mode in ("RGB", "RGBA", "L", "LA", "I;16") else image.convert("RGBA")
    image.save(buffer, "JPEG" if jpeg else "PNG", **({"quality": 95} if jpeg else {}))
    return buffer.getvalue()
