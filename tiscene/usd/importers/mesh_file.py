# SPDX-License-Identifier: Apache-2.0
"""Model files other than USD as meshes of one material each: OBJ, PLY and STL by trimesh, glTF by `gltf_scene`.

`load_model` also finds referenced files regardless of spelling, computes normals where a file has none, and warns about
missing files and unsupported features.
"""

from __future__ import annotations

import io
import os
import re
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tiscene.errors import StageError, StageWarning
from tiscene.scene.color import decode_srgb
from tiscene.usd.importers import gltf
from tiscene.usd.importers.gltf_scene import read_scene
from tiscene.usd.importers.imported_mesh import MAPS_WITHOUT_COORDINATES, ImportedMesh, corner_normals, unit
from tiscene.usd.importers.materials import ImportedMaterial, from_phong
from tiscene.usd.importers.polygons import face_properties, split_polygons

# Meters per unit and up axis of each format, by its definition or by convention.
CONVENTIONS = {
    ".obj": (1.0, "Y"),
    ".gltf": (1.0, "Y"),
    ".glb": (1.0, "Y"),
    ".ply": (1.0, "Z"),
    ".stl": (0.001, "Z"),
}


def load_model(name: str, files: Mapping[str, bytes]) -> list[ImportedMesh]:
    """Read the meshes of a model file.

    Missing files and unsupported features are named in a StageWarning.

    Args:
        name: the model file, a key of `files`.
        files: contents of the model file and of the files beside it, by relative path.

    Raises:
        StageError: the file is damaged, has no triangles, or has points that are not finite.
    """
    resolver = _FileResolver(files)
    suffix = Path(name).suffix.lower()
    missing: list[str] = []
    unsupported: list[str] = []
    try:
        if suffix in gltf.SUFFIXES:
            header = gltf.read_header(name, files[name])
            document = gltf.GltfDocument(header, files[name], resolver.get)
            unsupported = gltf.unsupported_features(header)
            meshes, left_out = read_scene(document)
            unsupported, missing = [*unsupported, *left_out], document.missing
        else:
            meshes = _read_with_trimesh(name, files, resolver)
            meshes, unsupported = _without_useless_maps(meshes)
            if suffix == ".ply" and (names := face_properties(files[name])):
                unsupported.append(f"values of faces ({', '.join(names)})")
    except StageError:
        raise
    except Exception as error:  # damaged files raise many types, in trimesh's readers too
        raise StageError(name, [f"cannot be read: {type(error).__name__}: {error}"]) from error
    if not meshes:
        raise StageError(name, ["it has no triangles"])
    if not all(np.isfinite(mesh.points).all() for mesh in meshes):
        raise StageError(name, ["it has points that are not finite numbers"])
    missing = sorted({*missing, *resolver.missing, *_missing_maps(name, files)})
    if missing:
        warnings.warn(StageWarning(f"{name} refers to missing files: {', '.join(missing)}"), stacklevel=3)
    if unsupported:
        warnings.warn(StageWarning(f"{name}: not imported: {', '.join(unsupported)}"), stacklevel=3)
    return meshes


class LazyFiles(Mapping[str, bytes]):
    """Contents of files by name, read on access.

    Args:
        readers: functions that return the contents of the files that are listed.
        folder: where others, such as ../textures/oak.png, are looked for; None: there are no others.
    """

    def __init__(self, readers: Mapping[str, Callable[[], bytes]], folder: Path | None = None) -> None:
        self._readers, self._folder = readers, folder

    def __getitem__(self, name: str) -> bytes:
        if name not in self:
            raise KeyError(name)
        return self._readers[name]() if name in self._readers else Path(self._folder or "", name).read_bytes()

    def __contains__(self, name: object) -> bool:
        return name in self._readers or (self._folder is not None and os.path.isfile(self._folder / str(name)))

    def __iter__(self) -> Iterator[str]:
        return iter(self._readers)

    def __len__(self) -> int:
        return len(self._readers)


class _FileResolver:
    """trimesh's resolver interface over files in memory.

    Attributes:
        missing: names that were requested and not found.
    """

    def __init__(self, files: Mapping[str, bytes]) -> None:
        self._files = files
        self.missing: list[str] = []

    def get(self, name: str) -> bytes:
        found = find_file(name, self._files)
        if found is None:
            self.missing.append(name.strip())
            raise FileNotFoundError(name)
        return self._files[found]

    __getitem__ = get

    def keys(self) -> list[str]:
        return list(self._files)

    def namespaced(self, namespace: str) -> _FileResolver:
        return self


def find_file(name: str, files: Mapping[str, bytes]) -> str | None:
    """Return the file that a reference means, ignoring backslashes and missing folders; None if there is none.

    A file of the same case is preferred to others.
    """
    wanted = name.strip().replace("\\", "/").removeprefix("./")
    for same in (wanted, wanted.rpartition("/")[2]):
        if same in files:
            return same
        for candidate in files:
            if candidate.lower() == same.lower():
                return candidate
    return None


def material_libraries(obj: bytes, files: Mapping[str, bytes]) -> list[str]:
    """Return the MTL files that an OBJ file names and that exist."""
    names = re.findall(rb"^\s*mtllib\s+(.+?)\s*$", obj, re.MULTILINE)
    found = (find_file(name.decode("utf-8", "replace"), files) for name in names)
    return [each for each in found if each is not None]


def _missing_maps(name: str, files: Mapping[str, bytes]) -> set[str]:
    """Return the images that an OBJ's MTL files name and that are missing; trimesh ignores them silently."""
    if Path(name).suffix.lower() != ".obj":
        return set()
    named = set()
    for library in material_libraries(files[name], files):
        text = files[library].decode("utf-8", "replace")
        named |= set(re.findall(r"^\s*map_Kd\s+(?:-\S+\s+[\d.\s-]+)*(.+?)\s*$", text, re.MULTILINE | re.IGNORECASE))
    return {image for image in named if find_file(image, files) is None}


def _read_with_trimesh(name: str, files: Mapping[str, bytes], resolver: _FileResolver) -> list[ImportedMesh]:
    """Read the meshes of an OBJ, PLY or STL file."""
    import trimesh

    suffix = Path(name).suffix.lower()
    file = io.BytesIO(split_polygons(suffix, files[name]))
    scene = trimesh.load_scene(file, file_type=suffix.removeprefix("."), resolver=resolver, process=False)
    return [
        _read_mesh(node, scene.geometry[geometry], np.asarray(matrix, np.float64))
        for node in scene.graph.nodes_geometry
        for matrix, geometry in [scene.graph.get(node)]
        if isinstance(scene.geometry[geometry], trimesh.Trimesh) and len(scene.geometry[geometry].faces)
    ]


def _read_mesh(node: str, mesh: Any, matrix: NDArray[np.float64]) -> ImportedMesh:
    """Convert a mesh of a trimesh scene.

    Args:
        node: name of its node.
        mesh: a trimesh.Trimesh.
        matrix: 4x4, from the mesh to the scene.
    """
    points = np.asarray(mesh.vertices, np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
    triangles = np.asarray(mesh.faces, np.int64)
    if np.linalg.det(matrix[:3, :3]) < 0.0:
        triangles = triangles[:, ::-1]
    if "vertex_normals" in mesh._cache.cache:  # otherwise trimesh would compute smooth ones without creases
        transformed = np.asarray(mesh.vertex_normals, np.float64) @ np.linalg.inv(matrix[:3, :3])
        normals = unit(transformed)[triangles]
    else:
        normals = corner_normals(points, triangles)
    visual = mesh.visual
    uv = getattr(visual, "uv", None)
    uv = np.asarray(uv, np.float64) if uv is not None and len(uv) == len(points) else None
    colors = None
    material = from_phong(node, (0.8, 0.8, 0.8))
    source = getattr(visual, "material", None)
    if visual.kind == "vertex":
        colors = decode_srgb(np.asarray(visual.vertex_colors, np.float64)[:, :3] / 255.0)
    elif source is not None:
        material = _from_mtl(str(source.name or node), source)
    return ImportedMesh(material.name, points, triangles, normals, uv, colors, material)


def _without_useless_maps(meshes: list[ImportedMesh]) -> tuple[list[ImportedMesh], list[str]]:
    """Return meshes without the textures whose coordinates some of their faces lack, and what to say of it."""
    result = []
    for mesh in meshes:
        material = mesh.material
        if mesh.uv is None and material.maps:
            material = ImportedMaterial(material.name, {**material.inputs, "diffuseColor": (0.5, 0.5, 0.5)})
        result.append(replace(mesh, material=material))
    dropped = any(old.material.maps and not new.material.maps for old, new in zip(meshes, result, strict=True))
    return result, [MAPS_WITHOUT_COORDINATES] * dropped


def _from_mtl(name: str, material: Any) -> ImportedMaterial:
    """Convert a material of an MTL file: Phong's values, overridden by physically based ones (Ke, Pr, Pm)."""
    diffuse = np.asarray(material.diffuse, np.float64)[:3] / 255.0
    opacity = 1.0
    for key, invert in (("d", False), ("tr", True)):
        value = material.kwargs.get(key)
        if value is not None:
            number = float(np.ravel(value)[-1])
            opacity = 1.0 - number if invert else number
    shininess = material.kwargs.get("ns")
    exponent = None if shininess is None else float(np.ravel(shininess)[0])
    r, g, b = diffuse.tolist()
    image = material.image if isinstance(material.image, Image.Image) else None
    phong = from_phong(name, (r, g, b), shininess=exponent, opacity=opacity, image=image)
    physical: dict[str, Any] = {}
    for key, name_of_input in (("pr", "roughness"), ("pm", "metallic")):
        if key in material.kwargs:
            physical[name_of_input] = min(max(float(np.ravel(material.kwargs[key])[0]), 0.0), 1.0)
    emission = np.broadcast_to(np.ravel(material.kwargs.get("ke", 0.0)).astype(np.float64), 3)
    if emission.any():
        physical["emissiveColor"] = tuple(emission.tolist())
    return replace(phong, inputs={**phong.inputs, **physical})
