# SPDX-License-Identifier: Apache-2.0
"""What a glTF file says beside what trimesh reads of it: extensions of its materials, and what is left out of it."""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Mapping
from typing import Any

from tiscene.errors import StageError

SUFFIXES = (".gltf", ".glb")
# Of materials, as `looks.pbr` takes them.
_TAKEN = (
    "KHR_materials_clearcoat",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_transmission",
)
_READ_BY_TRIMESH = ("EXT_texture_webp", "KHR_draco_mesh_compression", "KHR_materials_pbrSpecularGlossiness")
_COMPRESSIONS = ("EXT_meshopt_compression", "KHR_draco_mesh_compression")


def header(name: str, data: bytes) -> dict[str, Any]:
    """The JSON of a .gltf or .glb file; {} if it is damaged, which trimesh tells. Raises StageError.

    A file is refused whose geometry is compressed in a way that nothing here undoes.
    """
    if data[:4] == b"glTF":  # 12 bytes of the file, 8 of its first chunk, which is the JSON
        data = data[20 : 20 + int.from_bytes(data[12:16], "little")]
    try:
        found = json.loads(data)
    except (ValueError, RecursionError):
        return {}
    found = found if isinstance(found, dict) else {}
    required = found.get("extensionsRequired")
    for extension in _COMPRESSIONS:
        undone = extension == "KHR_draco_mesh_compression" and importlib.util.find_spec("DracoPy") is not None
        if isinstance(required, list) and extension in required and not undone:
            hint = " (or pip install DracoPy)" if "draco" in extension else ""
            raise StageError(name, [f"its geometry is compressed by {extension}: export it without{hint}"])
    return found


def material_extensions(header: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """The extensions of materials, by the materials' names."""
    return {each.get("name", ""): each.get("extensions", {}) for each in header.get("materials", ())}


def left_out(header: Mapping[str, Any]) -> list[str]:
    """What of the file is not imported: extensions, animations, skins."""
    extensions = sorted({*header.get("extensionsUsed", ())} - {*_TAKEN, *_READ_BY_TRIMESH})
    return [*extensions, *(key for key in ("animations", "skins") if header.get(key))]
