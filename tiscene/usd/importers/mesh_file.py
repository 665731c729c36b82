# SPDX-License-Identifier: Apache-2.0
"""Model files other than USD (OBJ, glTF, PLY, STL) as meshes of one material each, read by trimesh.

`load_model` also finds referenced files regardless of spelling, computes normals where a file has none, and warns about
missing files and unsupported features.
"""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tiscene.errors import StageError, StageWarning
from tiscene.scene.color import decode_srgb
from tiscene.usd.geometry.triangulate import cross
from tiscene.usd.geometry.vertex_weld import unique_rows
from tiscene.usd.importers import gltf
from tiscene.usd.importers.materials import ImportedMaterial, from_gltf, from_phong

# Meters per unit and up axis of each format, by its definition or by convention.
CONVENTIONS = {
    ".obj": (1.0, "Y"),
    ".gltf": (1.0, "Y"),
    ".glb": (1.0, "Y"),
    ".ply": (1.0, "Z"),
    ".stl": (0.001, "Z"),
}
_CREASE_ANGLE = np.radians(40.0)  # faces that meet at more get separate normals, if the file has none


@dataclass(frozen=True, eq=False)
class ImportedMesh:
    """Triangles of one material, in the file's units and axes.

    Attributes:
        name: name of the material.
        points: float64 [n, 3].
        triangles: int64 [m, 3].
        normals: float64 [m, 3, 3], one for each triangle corner.
        uv: float64 [n, 2], or None.
        colors: float64 [n, 3], linear, or None.
        material: the material; `colors` take precedence.
    """

    name: str
    points: NDArray[np.float64]
    triangles: NDArray[np.int64]
    normals: NDArray[np.float64]
    uv: NDArray[np.float64] | None
    colors: NDArray[np.float64] | None
    material: ImportedMaterial


def load_model(name: str, files: Mapping[str, bytes]) -> list[ImportedMesh]:
    """Read the meshes of a model file.

    Missing files and unsupported features are named in a StageWarning.

    Args:
        name: the model file, a key of `files`.
        files: contents of the model file and of the files beside it, by relative path.

    Raises:
        StageError: the file is damaged, has no triangles, or has points that are not finite.
    """
    import trimesh

    resolver = _FileResolver(files)
    suffix = Path(name).suffix.lower()
    header = gltf.read_header(name, files[name]) if suffix in gltf.SUFFIXES else {}
    try:
        extensions, unsupported = gltf.material_extensions(header), gltf.unsupported_features(header)
        scene = trimesh.load_scene(
            io.BytesIO(files[name]), file_type=suffix.removeprefix("."), resolver=resolver, process=False
        )
        meshes = [
            _read_mesh(node, scene.geometry[geometry], np.asarray(matrix, np.float64), extensions)
            for node in scene.graph.nodes_geometry
            for matrix, geometry in [scene.graph.get(node)]
            if isinstance(scene.geometry[geometry], trimesh.Trimesh) and len(scene.geometry[geometry].faces)
        ]
    except Exception as error:  # trimesh's readers raise many types on damaged files
        raise StageError(name, [f"cannot be read: {type(error).__name__}: {error}"]) from error
    if not meshes:
        raise StageError(name, ["it has no triangles"])
    if not all(np.isfinite(mesh.points).all() for mesh in meshes):
        raise StageError(name, ["it has points that are not finite numbers"])
    missing = sorted(set(resolver.missing) | _missing_maps(name, files))
    if missing:
        warnings.warn(StageWarning(f"{name} refers to missing files: {', '.join(missing)}"), stacklevel=3)
    if unsupported:
        warnings.warn(StageWarning(f"{name}: not imported: {', '.join(unsupported)}"), stacklevel=3)
    return meshes


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
    """Return the file that a reference means, ignoring case, backslashes and missing folders; None if there is none."""
    wanted = name.strip().replace("\\", "/").removeprefix("./")
    for same in (wanted, wanted.rpartition("/")[2]):
        for candidate in files:
            if candidate == same or candidate.lower() == same.lower():
                return candidate
    return None


def _missing_maps(name: str, files: Mapping[str, bytes]) -> set[str]:
    """Return the images that an OBJ's MTL files name and that are missing; trimesh ignores them silently."""
    if Path(name).suffix.lower() != ".obj":
        return set()
    named = set()
    for library in re.findall(rb"^\s*mtllib\s+(.+?)\s*$", files[name], re.MULTILINE):
        found = find_file(library.decode("utf-8", "replace"), files)
        text = files[found].decode("utf-8", "replace") if found else ""
        named |= set(re.findall(r"^\s*map_Kd\s+(?:-\S+\s+[\d.\s-]+)*(.+?)\s*$", text, re.MULTILINE | re.IGNORECASE))
    return {image for image in named if find_file(image, files) is None}


def _read_mesh(
    node: str, mesh: Any, matrix: NDArray[np.float64], extensions: Mapping[str, Mapping[str, Any]]
) -> ImportedMesh:
    """Convert a mesh of a trimesh scene.

    Args:
        node: name of its node.
        mesh: a trimesh.Trimesh.
        matrix: 4x4, from the mesh to the scene.
        extensions: extensions of glTF materials, by the materials' names.
    """
    points = np.asarray(mesh.vertices, np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
    triangles = np.asarray(mesh.faces, np.int64)
    if np.linalg.det(matrix[:3, :3]) < 0.0:
        triangles = triangles[:, ::-1]
    if "vertex_normals" in mesh._cache.cache:  # otherwise trimesh would compute smooth ones without creases
        transformed = np.asarray(mesh.vertex_normals, np.float64) @ np.linalg.inv(matrix[:3, :3])
        normals = _unit(transformed)[triangles]
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
    elif source is not None and hasattr(source, "baseColorFactor"):
        material = from_gltf(str(source.name or node), source, extensions.get(source.name or "", {}))
    elif source is not None:
        material = _from_mtl(str(source.name or node), source)
    if uv is None and material.maps:  # textures are useless without coordinates
        inputs = {"diffuseColor": (0.5, 0.5, 0.5)} | {k: v for k, v in material.inputs.items() if k != "diffuseColor"}
        material = ImportedMaterial(material.name, inputs)
    return ImportedMesh(material.name, points, triangles, normals, uv, colors, material)


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


def corner_normals(points: NDArray[np.float64], triangles: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return normals [m, 3, 3] of corners: area-weighted means over faces at the point within _CREASE_ANGLE."""
    _, point = unique_rows([points.astype(np.float32)])
    a, b, c = (points[triangles[:, corner]] for corner in range(3))
    area = cross(b - a, c - a)
    facing = _unit(area)
    corner_point = point[triangles.reshape(-1)]
    face = np.repeat(np.arange(len(triangles)), 3)
    order = np.argsort(corner_point, kind="stable")
    count = np.bincount(corner_point)
    start = np.cumsum(count) - count
    total = np.zeros((len(face), 3))
    for step in range(int(count.max(initial=0))):  # step k adds the k-th corner at the same point to each corner
        with_another = np.flatnonzero(count[corner_point] > step)
        other = face[order[start[corner_point[with_another]] + step]]
        near = np.einsum("ij,ij->i", facing[face[with_another]], facing[other]) > np.cos(_CREASE_ANGLE)
        total[with_another[near]] += area[other[near]]
    flat = np.linalg.norm(total, axis=1) < 1e-300
    total[flat] = facing[face[flat]]
    return _unit(total).reshape(-1, 3, 3)


def _unit(vectors: NDArray[np.floating]) -> NDArray[np.float64]:
    """Normalize vectors over the last axis; zero vectors become +z."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(np.where(length > 0.0, vectors / np.maximum(length, 1e-300), (0.0, 0.0, 1.0)))
