# SPDX-License-Identifier: Apache-2.0
"""Extensions of glTF materials beyond UsdPreviewSurface, as inputs of MaterialX's gltf_pbr.

KHR_materials_sheen, anisotropy, volume, specular and transmission. A material with one of them is written as gltf_pbr,
see `materials.define_material`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Literal

from tiscene.scene.description import Color
from tiscene.usd.importers.materials import TextureMap

Channel = Literal["rgb", "r", "g", "b", "a"]
MapReader = Callable[..., TextureMap | None]
_WHITE, _BLACK = (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)


def gltf_lobes(
    extensions: Mapping[str, Any], read_map: MapReader
) -> tuple[dict[str, float | Color], dict[str, TextureMap]]:
    """Return inputs and maps of gltf_pbr that the extensions of a material set; both empty for none with an effect.

    Args:
        extensions: of the material.
        read_map: returns the texture of a texture info, None for none; `raw=True` for data.

    Raises:
        ValueError: a value is no number or no color.
    """
    inputs: dict[str, float | Color] = {}
    maps: dict[str, TextureMap] = {}

    def add(name: str, value: Any, neutral: Any, info: Any = None, channel: Channel = "rgb") -> bool:
        """Add an input that is a factor of a texture; return whether it has an effect."""
        factor = _color(value) if isinstance(neutral, tuple) else float(value)
        map_ = read_map(info, raw=channel != "rgb") if info is not None else None
        if factor == neutral and map_ is None:
            return False
        inputs[name] = factor
        if map_ is not None:
            scale = factor if isinstance(factor, tuple) else (factor,) * 3
            maps[name] = replace(map_, channel=channel, scale=scale)
        return True

    sheen = extensions.get("KHR_materials_sheen", {})
    if add("sheen_color", sheen.get("sheenColorFactor", _BLACK), _BLACK, sheen.get("sheenColorTexture")):
        add("sheen_roughness", sheen.get("sheenRoughnessFactor", 0.0), -1.0, sheen.get("sheenRoughnessTexture"), "a")
    bent = extensions.get("KHR_materials_anisotropy", {})
    if add("anisotropy_strength", bent.get("anisotropyStrength", 0.0), 0.0, bent.get("anisotropyTexture"), "b"):
        add("anisotropy_rotation", bent.get("anisotropyRotation", 0.0), 0.0)
    specular = extensions.get("KHR_materials_specular", {})
    add("specular", specular.get("specularFactor", 1.0), 1.0, specular.get("specularTexture"), "a")
    add("specular_color", specular.get("specularColorFactor", _WHITE), _WHITE, specular.get("specularColorTexture"))
    clear = extensions.get("KHR_materials_transmission", {})
    if float(clear.get("transmissionFactor", 0.0)) > 0.0:
        add("transmission", clear["transmissionFactor"], 0.0, clear.get("transmissionTexture"), "r")
        volume = extensions.get("KHR_materials_volume", {})
        add("thickness", volume.get("thicknessFactor", 0.0), 0.0)
        add("attenuation_color", volume.get("attenuationColor", _WHITE), _WHITE)
        add("attenuation_distance", volume.get("attenuationDistance", 0.0), 0.0)
    return inputs, maps


def lost_parts(materials: Any) -> list[str]:
    """Return what the materials of a file have that is not imported, though their extensions are."""
    found = set()
    for entry in materials if isinstance(materials, list) else ():
        extensions = entry.get("extensions", {}) if isinstance(entry, dict) else {}
        if "anisotropyTexture" in extensions.get("KHR_materials_anisotropy", {}):
            found.add("directions of KHR_materials_anisotropy's textures")
        if "clearcoatNormalTexture" in extensions.get("KHR_materials_clearcoat", {}):
            found.add("normal maps of KHR_materials_clearcoat")
        if "KHR_materials_volume" in extensions and "KHR_materials_transmission" not in extensions:
            found.add("KHR_materials_volume without transmission")
    return sorted(found)


def _color(values: Any) -> Color:
    r, g, b = (float(each) for each in values)
    return (r, g, b)
