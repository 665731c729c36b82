# SPDX-License-Identifier: Apache-2.0
"""The parts of a glTF 2.0 file that trimesh does not read: material extensions, and a list of unsupported features."""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Mapping
from typing import Any

from tiscene.errors import StageError

SUFFIXES = (".gltf", ".glb")
# Material extensions that `materials.from_gltf` reads.
_SUPPORTED = (
    "KHR_materials_clearcoat",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_transmission",
)
_READ_BY_TRIMESH = ("EXT_texture_webp", "KHR_draco_mesh_compression", "KHR_materials_pbrSpecularGlossiness")
_COMPRESSIONS = ("EXT_meshopt_compression", "KHR_draco_mesh_compression")


def read_header(name: str, data: bytes) -> dict[str, Any]:
    """Return the JSON of a .gltf or .glb file; {} if it is damaged, which trimesh reports.

    Raises:
        StageError: the geometry is compressed by an extension that cannot be decoded.
    """
    if data[:4] == b"glTF":  # 12 bytes of file header and 8 of chunk header precede the JSON chunk
        data = data[20 : 20 + int.from_bytes(data[12:16], "little")]
    try:
        found = json.loads(data)
    except (ValueError, RecursionError):
        return {}
    found = found if isinstance(found, dict) else {}
    required = found.get("extensionsRequired")
    for extension in _COMPRESSIONS:
        decodable = extension == "KHR_draco_mesh_compression" and importlib.util.find_spec("DracoPy") is not None
        if isinstance(required, list) and extension in required and not decodable:
            hint = " (or pip install DracoPy)" if "draco" in extension else ""
            raise StageError(name, [f"its geometry is compressed by {extension}: export it without{hint}"])
    return found


def material_extensions(header: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """Return the extensions of materials, by the materials' names."""
    return {each.get("name", ""): each.get("extensions", {}) for each in header.get("materials", ())}


def unsupported_features(header: Mapping[str, Any]) -> list[str]:
    """Return the names of what is not imported: extensions, animations, skins."""
    extensions = sorted({*header.get("extensionsUsed", ())} - {*_SUPPORTED, *_READ_BY_TRIMESH})
    return [*extensions, *(key for key in ("animations", "skins") if header.get(key))]
