# SPDX-License-Identifier: Apache-2.0
"""Model files that are no USD (OBJ, glTF, PLY, STL and whatever else trimesh reads) as pieces of surface with looks."""

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
from tiscene.usd.importers.materials import ImportedMaterial, pbr, phong

# Meters per unit and the axis that is up, as each format has it, by its definition or by habit.
CONVENTIONS = {
    ".obj": (1.0, "Y"),
    ".gltf": (1.0, "Y"),
    ".glb": (1.0, "Y"),
    ".ply": (1.0, "Z"),
    ".stl": (0.001, "Z"),
}
_SHARP = np.radians(40.0)  # where faces meet at more than this, and the file has no normals, is an edge


@dataclass(frozen=True, eq=False)
class Piece:
    """Triangles of one look, in the file's units. points: [n, 3]. triangles: [m, 3]. normals: [m, 3, 3], of corners.

    uv: [n, 2] or None. colors: linear [n, 3] or None.
    """

    name: str
    points: NDArray[np.float64]
    triangles: NDArray[np.int64]
    normals: NDArray[np.float64]
    uv: NDArray[np.float64] | None
    colors: NDArray[np.float64] | None
    look: ImportedMaterial


def load_model(name: str, files: Mapping[str, bytes]) -> list[Piece]:
    """The pieces of the model in the file `name`; the files it refers to are those beside it.

    Maps that are not there, and what of the file is left out, are named in a StageWarning. Raises StageError.
    """
    import trimesh

    resolver = _Files(files)
    suffix = Path(name).suffix.lower()
    header = gltf.header(name, files[name]) if suffix in gltf.SUFFIXES else {}
    try:
        extensions, left_out = gltf.material_extensions(header), gltf.left_out(header)
        scene = trimesh.load_scene(
            io.BytesIO(files[name]), file_type=suffix.removeprefix("."), resolver=resolver, process=False
        )
        pieces = [
            _piece(node, scene.geometry[geometry], np.asarray(matrix, np.float64), extensions)
            for node in scene.graph.nodes_geometry
            for matrix, geometry in [scene.graph.get(node)]
            if isinstance(scene.geometry[geometry], trimesh.Trimesh) and len(scene.geometry[geometry].faces)
        ]
    except Exception as error:  # its readers fail in many ways on damaged files
        raise StageError(name, [f"cannot be read: {type(error).__name__}: {error}"]) from error
    if not pieces:
        raise StageError(name, ["it holds no triangles"])
    if not all(np.isfinite(piece.points).all() for piece in pieces):
        raise StageError(name, ["it holds points that are not finite numbers"])
    missing = sorted(set(resolver.missing) | _missing_maps(name, files))
    if missing:
        warnings.warn(StageWarning(f"{name} refers to files that are not there: {', '.join(missing)}"), stacklevel=3)
    if left_out:
        warnings.warn(StageWarning(f"of {name} is left out: {', '.join(left_out)}"), stacklevel=3)
    return pieces


class _Files:
    """What trimesh asks for the files that a model refers to, by their names."""

    def __init__(self, files: Mapping[str, bytes]) -> None:
        self._files = files
        self.missing: list[str] = []

    def get(self, name: str) -> bytes:
        found = find(name, self._files)
        if found is None:
            self.missing.append(name.strip())
            raise FileNotFoundError(name)
        return self._files[found]

    __getitem__ = get

    def keys(self) -> list[str]:
        return list(self._files)

    def namespaced(self, namespace: str) -> _Files:
        return self


def find(name: str, files: Mapping[str, bytes]) -> str | None:
    """The file that a reference means; spelling by another system does not matter."""
    wanted = name.strip().replace("\\", "/").removeprefix("./")
    for same in (wanted, wanted.rpartition("/")[2]):
        for candidate in files:
            if candidate == same or candidate.lower() == same.lower():
                return candidate
    return None


def _missing_maps(name: str, files: Mapping[str, bytes]) -> set[str]:
    """Images that an OBJ's material files name, and that are not there: trimesh passes over them silently."""
    if Path(name).suffix.lower() != ".obj":
        return set()
    named = set()
    for library in re.findall(rb"^\s*mtllib\s+(.+?)\s*$", files[name], re.MULTILINE):
        found = find(library.decode("utf-8", "replace"), files)
        text = files[found].decode("utf-8", "replace") if found else ""
        named |= set(re.findall(r"^\s*map_Kd\s+(?:-\S+\s+[\d.\s-]+)*(.+?)\s*$", text, re.MULTILINE | re.IGNORECASE))
    return {image for image in named if find(image, files) is None}


def _piece(node: str, mesh: Any, matrix: NDArray[np.float64], extensions: Mapping[str, Mapping[str, Any]]) -> Piece:
    """One mesh of a trimesh scene, in the scene's axes. extensions: of glTF's materials, by their names."""
    points = np.asarray(mesh.vertices, np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
    triangles = np.asarray(mesh.faces, np.int64)
    if np.linalg.det(matrix[:3, :3]) < 0.0:
        triangles = triangles[:, ::-1]
    if "vertex_normals" in mesh._cache.cache:  # else trimesh would make some, without any edge
        turned = np.asarray(mesh.vertex_normals, np.float64) @ np.linalg.inv(matrix[:3, :3])
        normals = _unit(turned)[triangles]
    else:
        normals = corner_normals(points, triangles)
    visual = mesh.visual
    uv = getattr(visual, "uv", None)
    uv = np.asarray(uv, np.float64) if uv is not None and len(uv) == len(points) else None
    colors = None
    look = phong(node, (0.8, 0.8, 0.8))
    material = getattr(visual, "material", None)
    if visual.kind == "vertex":
        colors = decode_srgb(np.asarray(visual.vertex_colors, np.float64)[:, :3] / 255.0)
    elif material is not None and hasattr(material, "baseColorFactor"):
        look = pbr(str(material.name or node), material, extensions.get(material.name or "", {}))
    elif material is not None:
        look = _simple(str(material.name or node), material)
    if uv is None and look.maps:  # images without coordinates
        inputs = {"diffuseColor": (0.5, 0.5, 0.5)} | {k: v for k, v in look.inputs.items() if k != "diffuseColor"}
        look = ImportedMaterial(look.name, inputs)
    return Piece(look.name, points, triangles, normals, uv, colors, look)


def _simple(name: str, material: Any) -> ImportedMaterial:
    """A material of an MTL file: Phong's numbers, but for what it says of physical ones (Ke, Pr, Pm)."""
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
    look = phong(name, (r, g, b), shininess=exponent, opacity=opacity, image=image)
    physical: dict[str, Any] = {}
    for key, name_of_input in (("pr", "roughness"), ("pm", "metallic")):
        if key in material.kwargs:
            physical[name_of_input] = min(max(float(np.ravel(material.kwargs[key])[0]), 0.0), 1.0)
    glow = np.broadcast_to(np.ravel(material.kwargs.get("ke", 0.0)).astype(np.float64), 3)
    if glow.any():
        physical["emissiveColor"] = tuple(glow.tolist())
    return replace(look, inputs={**look.inputs, **physical})


def corner_normals(points: NDArray[np.float64], triangles: NDArray[np.int64]) -> NDArray[np.float64]:
    """Normals [m, 3, 3] of corners: of each, the mean over the faces at its point that are nearly in its plane."""
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
    for turn in range(int(count.max(initial=0))):  # each corner meets the others at its point, one a turn
        with_another = np.flatnonzero(count[corner_point] > turn)
        other = face[order[start[corner_point[with_another]] + turn]]
        near = np.einsum("ij,ij->i", facing[face[with_another]], facing[other]) > np.cos(_SHARP)
        total[with_another[near]] += area[other[near]]
    flat = np.linalg.norm(total, axis=1) < 1e-300
    total[flat] = facing[face[flat]]
    return _unit(total).reshape(-1, 3, 3)


def _unit(vectors: NDArray[np.floating]) -> NDArray[np.float64]:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(np.where(length > 0.0, vectors / np.maximum(length, 1e-300), (0.0, 0.0, 1.0)))
