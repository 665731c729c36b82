# SPDX-License-Identifier: Apache-2.0
"""OBJ files as Unity keeps them: coordinates in its left-handed space, materials in a JSON file beside the OBJ.

SAILenv's clients upload such models. The JSON is {material: {quantity: value}}, with the names of the OBJ's `usemtl`. A
value is the file of a texture, a number, or a color of three or four numbers, 0..1 (0..255 if one is above 1).

===========  =============================================  ============================================
quantity     other names                                    value
===========  =============================================  ============================================
albedo       diffuse, color, base_color, kd, map_kd         sRGB texture or color; alpha below 1/2 cuts out
normal       bump, map_bump                                 texture of a tangent-space normal map
metallic     metalness, metallic_smoothness                 number, or texture: red; alpha is the smoothness
smoothness   glossiness                                     number, 1 - roughness
roughness                                                   number, or texture: red
emission     emissive, ke, map_ke                           sRGB texture or color
===========  =============================================  ============================================

Spelling is free: case, spaces, underscores and a final "map" or "texture" do not matter.
"""

from __future__ import annotations

import json
import re
import warnings
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageChops

from tiscene.errors import StageError, StageWarning
from tiscene.scene.color import decode_srgb
from tiscene.usd.importers.import_template import Credit, license_beside, write_template
from tiscene.usd.importers.materials import ImportedMaterial, TextureMap, has_holes
from tiscene.usd.importers.mesh_file import find_file, load_model, material_libraries
from tiscene.usd.materials.image import open_picture

_FROM_UNITY = np.diag([1.0, 1.0, -1.0])
_GENERATED_MTL = "tiscene_generated.mtl"
_SPELLINGS = {
    "albedo": ("albedo", "diffuse", "color", "colour", "basecolor", "kd", "mapkd", "albedotransparency"),
    "normal": ("normal", "bump", "mapbump"),
    "metallic": ("metallic", "metalness", "metallicsmoothness"),
    "smoothness": ("smoothness", "glossiness"),
    "roughness": ("roughness",),
    "emission": ("emission", "emissive", "ke", "mapke"),
}
_QUANTITIES = {spelling: quantity for quantity, spellings in _SPELLINGS.items() for spelling in spellings}


def import_unity_model(path: Path, folder: Path, *, name: str, label: str) -> Path:
    """Import an OBJ file in Unity's left-handed space as a template, with its materials in JSON if it has any.

    Missing textures and ignored parts are named in a StageWarning.

    Args:
        path: the OBJ file; the files in its folder and below belong to it.
        folder: folder of the template; created if needed.
        name: displayName of the template.
        label: its semantic class.

    Returns:
        The file `folder`/template.usda.

    Raises:
        StageError: the file or its JSON cannot be read.
        ExportError: the template cannot be written.
    """
    found = (each for each in sorted(path.parent.rglob("*")) if each.is_file() and folder not in each.parents)
    files = {each.relative_to(path.parent).as_posix(): each.read_bytes() for each in found}
    definitions = read_definitions(files)
    meshes = load_model(path.name, files | _with_all_materials(path.name, files))
    ignored: list[str] = []
    made = {each.name: material_of(each, definitions, files, ignored) for each in (mesh.material for mesh in meshes)}
    unused = sorted({_plain(key) for key in definitions} - {_plain(key) for key in made})
    ignored += [f"material {key!r}, which no face uses" for key in definitions if _plain(key) in unused]
    if ignored:
        warnings.warn(StageWarning(f"{path.name}: ignored: {'; '.join(ignored)}"), stacklevel=2)
    placed = [replace(mesh, material=_usable(made[mesh.material.name], mesh.uv is not None)) for mesh in meshes]
    credit = Credit(path.name, license_beside(path), "")
    return write_template(placed, folder, name, label, _FROM_UNITY, credit, centered=False)


def read_definitions(files: Mapping[str, bytes]) -> dict[str, Mapping[str, Any]]:
    """Return the definitions of materials by name, of all JSON files. Raises StageError for damaged ones."""
    definitions: dict[str, Mapping[str, Any]] = {}
    for name, data in files.items():
        if not name.lower().endswith(".json"):
            continue
        try:
            content = json.loads(data.decode("utf-8-sig"))
        except (ValueError, RecursionError) as error:
            raise StageError(name, [f"is not valid JSON: {error}"]) from error
        if not isinstance(content, dict) or not all(isinstance(each, dict) for each in content.values()):
            raise StageError(name, ['must be an object {"material": {"albedo": "texture.png", ...}, ...}'])
        definitions |= content
    return definitions


def material_of(
    material: ImportedMaterial,
    definitions: Mapping[str, Mapping[str, Any]],
    files: Mapping[str, bytes],
    ignored: list[str],
) -> ImportedMaterial:
    """Return a material with the values of its definition in place of its own.

    Args:
        material: the material by the OBJ's own files.
        definitions: definitions by material name.
        files: contents of textures by name.
        ignored: descriptions of values that have no effect are appended.
    """
    entry = next((each for key, each in definitions.items() if _plain(key) == _plain(material.name)), None)
    if entry is None:
        return material
    inputs: dict[str, Any] = {"diffuseColor": (0.8, 0.8, 0.8), "roughness": 0.6}
    maps: dict[str, TextureMap] = {}
    for key, value in entry.items():
        quantity = _QUANTITIES.get(
            _plain(key).removesuffix("map").removesuffix("texture"), _QUANTITIES.get(_plain(key))
        )
        where = f"{material.name}.{key} = {value!r}"
        if quantity is None:
            ignored.append(f"{where} (unknown quantity)")
            continue
        if isinstance(value, str):
            file = find_file(value, files)
            image = None if file is None else _image(files[file])
            if image is None or quantity == "smoothness":
                ignored.append(f"{where} ({'no such image' if image is None else 'must be a number'})")
            else:
                _add_texture(quantity, image, inputs, maps)
        elif not _add_constant(quantity, value, inputs):
            ignored.append(f"{where} (not a value of {quantity})")
    return ImportedMaterial(material.name, inputs, maps)


def _add_texture(quantity: str, image: Image.Image, inputs: dict[str, Any], maps: dict[str, TextureMap]) -> None:
    match quantity:
        case "albedo":
            maps["diffuseColor"] = TextureMap(image)
            if has_holes(image):
                maps["opacity"] = TextureMap(image, "a")
                inputs["opacityThreshold"] = 0.5
        case "normal":
            maps["normal"] = TextureMap(image, raw=True)
        case "metallic":
            maps["metallic"] = TextureMap(image, "r", raw=True)
            if "A" in image.getbands():
                maps["roughness"] = TextureMap(ImageChops.invert(image.getchannel("A")), "r", raw=True)
        case "roughness":
            maps["roughness"] = TextureMap(image, "r", raw=True)
        case "emission":
            maps["emissiveColor"] = TextureMap(image)


def _add_constant(quantity: str, value: Any, inputs: dict[str, Any]) -> bool:
    """Set an input to a number or a color; return False if the quantity cannot have this value."""
    try:
        numbers = np.atleast_1d(np.asarray(value, np.float64))
    except (TypeError, ValueError):
        return False
    if quantity == "normal" or numbers.ndim > 1 or not np.isfinite(numbers).all() or (numbers < 0.0).any():
        return False
    if quantity in ("albedo", "emission"):
        if len(numbers) not in (3, 4):
            return False
        color = decode_srgb(np.clip(numbers / (255.0 if numbers.max() > 1.0 else 1.0), 0.0, 1.0))
        inputs["diffuseColor" if quantity == "albedo" else "emissiveColor"] = tuple(color[:3].tolist())
        return True
    if len(numbers) != 1 or numbers[0] > 1.0:
        return False
    number = float(numbers[0])
    inputs["metallic" if quantity == "metallic" else "roughness"] = 1.0 - number if quantity == "smoothness" else number
    return True


def _usable(material: ImportedMaterial, has_uv: bool) -> ImportedMaterial:
    """Return a material without textures if its mesh has no texture coordinates."""
    return material if has_uv else ImportedMaterial(material.name, material.inputs)


def _with_all_materials(name: str, files: Mapping[str, bytes]) -> dict[str, bytes]:
    """Return the OBJ and an MTL file with the materials that its own MTL files lack, so that their names are kept."""
    used = {
        each.decode("utf-8", "replace") for each in re.findall(rb"^\s*usemtl\s+(.+?)\s*$", files[name], re.MULTILINE)
    }
    text = b"\n".join(files[each] for each in material_libraries(files[name], files))
    known = {each.decode("utf-8", "replace") for each in re.findall(rb"^\s*newmtl\s+(.+?)\s*$", text, re.MULTILINE)}
    missing = "".join(f"newmtl {each}\nKd 0.8 0.8 0.8\n" for each in sorted(used - known))
    if not missing:
        return {}
    body = re.sub(rb"^\s*mtllib\s.*$", b"", files[name], flags=re.MULTILINE)
    merged = text + b"\n" + missing.encode()
    return {name: f"mtllib {_GENERATED_MTL}\n".encode() + body, _GENERATED_MTL: merged}


def _image(data: bytes) -> Image.Image | None:
    with suppress(ValueError):
        return open_picture(data)
    return None


def _plain(name: str) -> str:
    return re.sub(r"[\s_-]", "", name).casefold()
