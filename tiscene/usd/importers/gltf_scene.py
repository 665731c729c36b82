# SPDX-License-Identifier: Apache-2.0
"""Meshes of a glTF 2.0 scene: primitives with their attributes, morph targets and skins, at rest and over time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import counted
from tiscene.usd.importers.gltf import GltfDocument
from tiscene.usd.importers.gltf_animation import AnimationSampler, ScenePose
from tiscene.usd.importers.gltf_materials import material_of
from tiscene.usd.importers.imported_mesh import (
    MAPS_WITHOUT_COORDINATES,
    ImportedMesh,
    ShapeSamples,
    corner_normals,
    unit,
)
from tiscene.usd.importers.materials import VERTEX_COLOR, VERTEX_OPACITY, VERTEX_TINT, ImportedMaterial

Floats = NDArray[np.float64]

_POINTS_AND_LINES, _TRIANGLES, _STRIP, _FAN = (0, 1, 2, 3), 4, 5, 6
_MAX_SAMPLE_BYTES = 1 << 30  # of one primitive over time


@dataclass(frozen=True, eq=False)
class _Primitive:
    """A primitive of a node.

    Attributes:
        node: the node.
        points: float64 [n, 3].
        normals: float64 [n, 3]; None: the file has none.
        triangles: int64 [m, 3].
        targets: offsets of points and of normals (None: none) of each morph target.
        joints: int64 [n, k], rows of `skin`.
        weights: float64 [n, k], of the joints.
        skin: nodes of the joints, and their inverse bind matrices [j, 4, 4]; None: rigid.
    """

    node: int
    points: Floats
    normals: Floats | None
    triangles: NDArray[np.int64]
    targets: tuple[tuple[Floats | None, Floats | None], ...]
    joints: NDArray[np.int64] | None
    weights: Floats | None
    skin: tuple[NDArray[np.int64], Floats] | None


def read_scene(document: GltfDocument) -> tuple[list[ImportedMesh], list[str]]:
    """Return the meshes of a file's default scene, one for each primitive, and what is not imported.

    Raises:
        ValueError, KeyError, IndexError, TypeError: the file contradicts itself.
    """
    sampler = AnimationSampler(document)
    rest = sampler.pose()
    found: list[ImportedMesh] = []
    left_out: dict[str, None] = {}
    nodes, meshes = document.listed("nodes"), document.listed("meshes")
    poses: list[ScenePose] | None = None
    for node, _ in sampler.order:
        entry = nodes[node]
        if entry.get("mesh") is None:
            continue
        mesh = meshes[int(entry["mesh"])]
        name = str(entry.get("name") or mesh.get("name") or f"Mesh{node}")
        for primitive in mesh["primitives"]:
            if primitive.get("mode", _TRIANGLES) in _POINTS_AND_LINES:
                left_out["points and lines"] = None
                continue
            shape = _read_primitive(document, primitive, entry, node)
            if not len(shape.triangles):
                continue
            imported = _imported(document, primitive, shape, rest, _weights(mesh, entry), name, left_out)
            if len(sampler.times):
                poses = poses or [sampler.pose(float(time)) for time in sampler.times]
                imported = _with_samples(imported, shape, poses, sampler.times, _weights(mesh, entry), left_out)
            found.append(imported)
    return found, [*left_out]


def _weights(mesh: Mapping[str, Any], node: Mapping[str, Any]) -> Floats:
    return np.asarray(node.get("weights") or mesh.get("weights") or (), np.float64)


def _read_primitive(
    document: GltfDocument, primitive: Mapping[str, Any], node: Mapping[str, Any], row: int
) -> _Primitive:
    """Read the geometry of a primitive; `node` and `row`: the node that draws it."""
    attributes, draco = primitive["attributes"], primitive.get("extensions", {}).get("KHR_draco_mesh_compression")
    decoded = None if draco is None or "bufferView" in document.listed("accessors")[attributes["POSITION"]] else draco
    if decoded is not None:
        points, normals, triangles = _draco(document, decoded)
    else:
        points = document.accessor(attributes["POSITION"]).astype(np.float64)
        normals = document.accessor(attributes["NORMAL"]).astype(np.float64) if "NORMAL" in attributes else None
        indices = primitive.get("indices")
        corners = np.arange(len(points)) if indices is None else document.accessor(indices)[:, 0].astype(np.int64)
        triangles = _triangles(corners, int(primitive.get("mode", _TRIANGLES)))
    if len(triangles) and (triangles.min() < 0 or triangles.max() >= len(points)):
        raise ValueError(f"an index refers to vertex {triangles.max()}, but there are {len(points)}")
    targets = tuple(
        tuple(
            document.accessor(each[key]).astype(np.float64) if key in each else None for key in ("POSITION", "NORMAL")
        )
        for each in primitive.get("targets", ())
    )
    joints = weights = skin = None
    if node.get("skin") is not None and "JOINTS_0" in attributes:
        sets = [number for number in range(8) if f"JOINTS_{number}" in attributes]
        joints = np.concatenate([document.accessor(attributes[f"JOINTS_{each}"]) for each in sets], axis=1)
        weights = np.concatenate([document.accessor(attributes[f"WEIGHTS_{each}"]) for each in sets], axis=1)
        joints, weights = joints.astype(np.int64), weights.astype(np.float64)
        weights = weights / np.maximum(weights.sum(axis=1, keepdims=True), 1e-12)
        entry = document.listed("skins")[int(node["skin"])]
        nodes = np.asarray(entry["joints"], np.int64)
        binds = np.tile(np.eye(4), (len(nodes), 1, 1))
        if entry.get("inverseBindMatrices") is not None:
            binds = document.accessor(entry["inverseBindMatrices"]).astype(np.float64).reshape(-1, 4, 4)
            binds = binds.transpose(0, 2, 1)
        if len(binds) < len(nodes) or joints.max(initial=0) >= len(nodes):
            raise ValueError("a skin has fewer joints than its mesh refers to")
        skin = nodes, binds[: len(nodes)]
    return _Primitive(row, points, normals, triangles, targets, joints, weights, skin)  # type: ignore[arg-type]


def _triangles(corners: NDArray[np.int64], mode: int) -> NDArray[np.int64]:
    """Return the triangles [m, 3] of a list, strip or fan."""
    if mode == _STRIP and len(corners) >= 3:
        found = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1)
        found[1::2] = found[1::2][:, [1, 0, 2]]
        return found
    if mode == _FAN and len(corners) >= 3:
        return np.stack([np.full(len(corners) - 2, corners[0]), corners[1:-1], corners[2:]], axis=1)
    return corners[: len(corners) // 3 * 3].reshape(-1, 3)


def _draco(document: GltfDocument, entry: Mapping[str, Any]) -> tuple[Floats, Floats | None, NDArray[np.int64]]:
    import DracoPy

    mesh = DracoPy.decode(document.view(int(entry["bufferView"]))[0])
    normals = getattr(mesh, "normals", None)
    own = None if normals is None or not len(normals) else np.asarray(normals, np.float64).reshape(-1, 3)
    return np.asarray(mesh.points, np.float64).reshape(-1, 3), own, np.asarray(mesh.faces, np.int64).reshape(-1, 3)


def _posed(shape: _Primitive, pose: ScenePose, rest_weights: Floats) -> tuple[Floats, Floats, bool]:
    """Return points [n, 3] and corner normals [m, 3, 3] in a pose, and whether it mirrors the mesh."""
    points, normals = shape.points, shape.normals
    weights = pose.weights.get(shape.node, rest_weights)
    for weight, (moves, turns) in zip(weights.tolist(), shape.targets, strict=False):
        points = points if moves is None else points + weight * moves
        normals = normals if turns is None or normals is None else normals + weight * turns
    if shape.skin is not None and shape.joints is not None and shape.weights is not None:
        nodes, binds = shape.skin
        joints = (pose.worlds[nodes] @ binds)[shape.joints]
        matrices = np.einsum("nk,nkij->nij", shape.weights, joints)
        moved = np.einsum("nij,nj->ni", matrices[:, :3, :3], points) + matrices[:, :3, 3]
        turned = None if normals is None else np.einsum("nij,nj->ni", matrices[:, :3, :3], normals)
        mirrors = False
    else:
        matrix = pose.worlds[shape.node]
        moved = points @ matrix[:3, :3].T + matrix[:3, 3]
        mirrors = bool(np.linalg.det(matrix[:3, :3]) < 0.0)
        inverse = np.linalg.pinv(matrix[:3, :3])
        turned = None if normals is None else normals @ inverse
    triangles = shape.triangles[:, ::-1] if mirrors else shape.triangles
    corners = corner_normals(moved, triangles) if turned is None else unit(turned)[triangles]
    return moved, corners, mirrors


def _imported(
    document: GltfDocument,
    primitive: Mapping[str, Any],
    shape: _Primitive,
    rest: ScenePose,
    weights: Floats,
    name: str,
    left_out: dict[str, None],
) -> ImportedMesh:
    """Return a primitive at rest with its material; what is not imported is added to `left_out`."""
    points, normals, mirrors = _posed(shape, rest, weights)
    attributes, count = primitive["attributes"], len(points)

    def values(key: str, width: int) -> Floats | None:
        if key not in attributes:
            return None
        found = document.accessor(attributes[key])
        if len(found) != count:
            raise ValueError(f"{key} has {counted(len(found), 'value')} for {counted(count, 'vertex', 'vertices')}")
        return found[:, :width].astype(np.float64)

    uv = [_flipped(values(f"TEXCOORD_{number}", 2)) for number in (0, 1)]
    material = material_of(document, primitive.get("material"), name)
    used = {map_.uv_set for map_ in (*material.maps.values(), *material.lobe_maps.values())}
    if any(number > 1 or uv[number] is None for number in used):
        left_out[MAPS_WITHOUT_COORDINATES] = None
        kept, kept_lobes = (
            {key: map_ for key, map_ in maps.items() if map_.uv_set < 2 and uv[map_.uv_set] is not None}
            for maps in (material.maps, material.lobe_maps)
        )
        material = replace(material, maps=kept, lobe_maps=kept_lobes)
    colors = values("COLOR_0", 4)
    if colors is not None:
        colors = np.concatenate([colors, np.ones((count, 4 - colors.shape[1]))], axis=1)
        material, colors = _with_vertex_colors(material, colors, left_out)
    triangles = shape.triangles[:, ::-1] if mirrors else shape.triangles
    return ImportedMesh(material.name, points, triangles, normals, uv[0], colors, material, uv[1])


def _flipped(uv: Floats | None) -> Floats | None:
    """Return texture coordinates whose v runs upwards, as in USD."""
    return None if uv is None else uv * (1.0, -1.0) + (0.0, 1.0)


def _with_vertex_colors(
    material: ImportedMaterial, colors: Floats, left_out: dict[str, None]
) -> tuple[ImportedMaterial, Floats | None]:
    """Return a material that is multiplied by vertices' colors [n, 4], and what of them the mesh keeps."""
    inputs, maps = dict(material.inputs), dict(material.maps)
    name = "emissiveColor" if inputs.get("diffuseColor") == (0.0, 0.0, 0.0) else "diffuseColor"
    if (colors == colors[:1]).all():  # one color is a factor
        tint = colors[0, :3]
        inputs[name] = tuple((np.asarray(inputs.get(name, (1.0,) * 3)) * tint).tolist())
        if name in maps:
            r, g, b = (np.asarray(maps[name].scale) * tint).tolist()
            maps[name] = replace(maps[name], scale=(r, g, b))
        return replace(material, inputs=inputs, maps=maps), None
    read = {name: VERTEX_TINT if name in maps else VERTEX_COLOR}
    factor = maps[name].scale if name in maps else inputs.get(name, (1.0,) * 3)
    colors = colors * (*np.asarray(factor), 1.0)
    if name in maps:
        maps[name] = replace(maps[name], scale=(1.0, 1.0, 1.0))
    if "opacity" in maps:
        if (colors[:, 3] != 1.0).any():
            left_out["opacities of vertices of materials with an opacity texture"] = None
    elif inputs.get("opacityMode") == "presence":
        opacity = inputs.get("opacity", 1.0)
        colors[:, 3] *= opacity if isinstance(opacity, float | int) else 1.0
        read["opacity"] = VERTEX_OPACITY
    return replace(material, maps=maps, vertex_inputs=read), colors


def _with_samples(
    imported: ImportedMesh,
    shape: _Primitive,
    poses: list[ScenePose],
    times: Floats,
    weights: Floats,
    left_out: dict[str, None],
) -> ImportedMesh:
    """Return a mesh with its points and normals at all times; unchanged if it never moves."""
    if len(times) * (len(shape.points) + 3 * len(shape.triangles)) * 24 > _MAX_SAMPLE_BYTES:
        left_out["motion of large meshes"] = None
        return imported
    found = [_posed(shape, pose, weights) for pose in poses]
    if all(np.array_equal(points, found[0][0]) for points, _, _ in found):
        return imported
    points = np.stack([points for points, _, _ in found])
    return replace(imported, samples=ShapeSamples(times, points, np.stack([normals for _, normals, _ in found])))
