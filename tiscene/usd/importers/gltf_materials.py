# SPDX-License-Identifier: Apache-2.0
"""Materials of glTF 2.0 files as inputs of UsdPreviewSurface: metallic-roughness, specular-glossiness and unlit.

Extensions that UsdPreviewSurface has no inputs for are those of `gltf_lobes`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from tiscene.scene.description import Color
from tiscene.usd.importers.gltf import GltfDocument
from tiscene.usd.importers.gltf_lobes import Channel, gltf_lobes
from tiscene.usd.importers.materials import ImportedMaterial, TextureMap, TextureTransform

_WRAPS: dict[int, Literal["repeat", "clamp", "mirror"]] = {10497: "repeat", 33071: "clamp", 33648: "mirror"}
_BLACK = (0.0, 0.0, 0.0)


def material_of(document: GltfDocument, index: int | None, name: str) -> ImportedMaterial:
    """Return a material of a glTF file.

    Args:
        document: the file.
        index: number of the material; None: glTF's default material.
        name: for a material without a name.
    """
    entry = {} if index is None else document.listed("materials")[index]
    if not isinstance(entry, dict):
        raise TypeError(f"material {index} is not an object")
    return _MaterialReader(document, entry).read(str(entry.get("name") or name))


class _MaterialReader:
    """Reads one material."""

    def __init__(self, document: GltfDocument, entry: Mapping[str, Any]) -> None:
        self._document = document
        self._entry = entry
        self._extensions = entry.get("extensions", {})
        self._maps: dict[str, TextureMap] = {}

    def read(self, name: str) -> ImportedMaterial:
        """Return the material."""
        glossy = self._extensions.get("KHR_materials_pbrSpecularGlossiness")
        if glossy is None:
            inputs, base, factor = self._metallic_roughness()
        else:
            inputs, base, factor = self._specular_glossiness(glossy)
        self._emission(inputs)
        self._alpha(inputs, base, factor[3])
        bumps = self._entry.get("normalTexture") or {}
        strength, bent = float(bumps.get("scale", 1.0)), self._map(bumps or None, raw=True)
        self._add("normal", bent, (2.0 * strength, 2.0 * strength, 2.0), bias=(-strength, -strength, -1.0))
        self._coat(inputs)
        if "KHR_materials_ior" in self._extensions:
            inputs["ior"] = float(self._extensions["KHR_materials_ior"].get("ior", 1.5))
        lobes, lobe_maps = gltf_lobes(self._extensions, self._map)
        if "KHR_materials_unlit" in self._extensions:
            inputs |= {"diffuseColor": _BLACK, "emissiveColor": factor[:3], "roughness": 1.0, "metallic": 0.0}
            if "diffuseColor" in self._maps:
                self._maps["emissiveColor"] = self._maps.pop("diffuseColor")
            self._maps = {key: map_ for key, map_ in self._maps.items() if key in ("emissiveColor", "opacity")}
            lobes, lobe_maps = {}, {}
        return ImportedMaterial(name, inputs, self._maps, lobes=lobes, lobe_maps=lobe_maps)

    def _metallic_roughness(self) -> tuple[dict[str, Any], TextureMap | None, tuple[float, ...]]:
        """Return the inputs, the map of the base color and its factor, RGBA."""
        values = self._entry.get("pbrMetallicRoughness", {})
        factor = _numbers(values.get("baseColorFactor"), 4)
        inputs: dict[str, Any] = {
            "diffuseColor": factor[:3],
            "metallic": float(values.get("metallicFactor", 1.0)),
            "roughness": float(values.get("roughnessFactor", 1.0)),
        }
        base = self._map(values.get("baseColorTexture"))
        self._add("diffuseColor", base, factor)
        data = self._map(values.get("metallicRoughnessTexture"), raw=True)
        self._add("metallic", data, inputs["metallic"], "b")
        self._add("roughness", data, inputs["roughness"], "g")
        return inputs, base, factor

    def _specular_glossiness(
        self, values: Mapping[str, Any]
    ) -> tuple[dict[str, Any], TextureMap | None, tuple[float, ...]]:
        """The same of a specular-glossiness material, as UsdPreviewSurface's specular workflow."""
        factor = _numbers(values.get("diffuseFactor"), 4)
        specular, gloss = _numbers(values.get("specularFactor"), 3), float(values.get("glossinessFactor", 1.0))
        inputs: dict[str, Any] = {
            "diffuseColor": factor[:3],
            "useSpecularWorkflow": 1,
            "specularColor": specular,
            "roughness": 1.0 - gloss,
        }
        base = self._map(values.get("diffuseTexture"))
        self._add("diffuseColor", base, factor)
        shine = self._map(values.get("specularGlossinessTexture"))
        self._add("specularColor", shine, specular)
        self._add("roughness", shine, -gloss, "a", (1.0, 1.0, 1.0))
        return inputs, base, factor

    def _emission(self, inputs: dict[str, Any]) -> None:
        strength = float(self._extensions.get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1.0))
        emissive = tuple(strength * each for each in _numbers(self._entry.get("emissiveFactor", _BLACK), 3))
        map_ = self._map(self._entry.get("emissiveTexture"))
        if any(emissive):
            inputs["emissiveColor"] = emissive
            self._add("emissiveColor", map_, emissive)

    def _alpha(self, inputs: dict[str, Any], base: TextureMap | None, factor: float) -> None:
        mode = self._entry.get("alphaMode", "OPAQUE")
        if mode not in ("MASK", "BLEND"):
            return
        inputs |= {"opacity": factor, "opacityMode": "presence"}
        if mode == "MASK":
            inputs["opacityThreshold"] = float(self._entry.get("alphaCutoff", 0.5))
        self._add("opacity", base, factor, "a")

    def _coat(self, inputs: dict[str, Any]) -> None:
        coat = self._extensions.get("KHR_materials_clearcoat", {})
        channels: dict[str, Channel] = {"clearcoat": "r", "clearcoatRoughness": "g"}
        for name, channel in channels.items() if coat else ():
            inputs[name] = float(coat.get(f"{name}Factor", 0.0))
            self._add(name, self._map(coat.get(f"{name}Texture"), raw=True), inputs[name], channel)

    def _add(
        self,
        name: str,
        map_: TextureMap | None,
        scale: float | tuple[float, ...],
        channel: Channel = "rgb",
        bias: Color = _BLACK,
    ) -> None:
        """Add the map of an input, if there is one, times a factor."""
        if map_ is not None:
            r, g, b = scale[:3] if isinstance(scale, tuple) else (scale,) * 3
            self._maps[name] = replace(map_, channel=channel, scale=(r, g, b), bias=bias)

    def _map(self, info: Mapping[str, Any] | None, *, raw: bool = False) -> TextureMap | None:
        """Return the texture that a texture info names; None for none, or for an image that cannot be read."""
        if info is None:
            return None
        image = self._document.image(int(info["index"]))
        if image is None:
            return None
        sampler = self._document.listed("textures")[int(info["index"])].get("sampler")
        modes = {} if sampler is None else self._document.listed("samplers")[sampler]
        wraps = tuple(_WRAPS.get(modes.get(key, 10497), "repeat") for key in ("wrapS", "wrapT"))
        change = info.get("extensions", {}).get("KHR_texture_transform", {})
        uv_set = int(change.get("texCoord", info.get("texCoord", 0)))
        transform = _transform(change) if change else None
        return TextureMap(image, raw=raw, wraps=(wraps[0], wraps[1]), uv_set=uv_set, transform=transform)


def _transform(change: Mapping[str, Any]) -> TextureTransform:
    """Return a KHR_texture_transform as a UsdTransform2d, whose v runs upwards.

    With c and s of the rotation, glTF maps (u, v) to (c sx u + s sy v + ox, -s sx u + c sy v + oy), v downwards.
    """
    (offset_u, offset_v), (scale_u, scale_v) = (
        _numbers(change.get(key, default), 2) for key, default in (("offset", (0.0, 0.0)), ("scale", (1.0, 1.0)))
    )
    angle = float(change.get("rotation", 0.0))
    c, s = math.cos(angle), math.sin(angle)
    move = (s * scale_v + offset_u, 1.0 - c * scale_v - offset_v)
    return TextureTransform((scale_u, scale_v), math.degrees(angle), move)


def _numbers(values: Any, count: int) -> tuple[float, ...]:
    """Return a factor as floats; 1 where it is not given."""
    numbers = np.ones(count) if values is None else np.asarray(values, np.float64)
    if numbers.shape != (count,) or not np.isfinite(numbers).all():
        raise ValueError(f"{values!r} must be {count} numbers")
    return tuple(numbers.tolist())
