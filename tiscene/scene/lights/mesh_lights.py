# SPDX-License-Identifier: Apache-2.0
"""Emissive meshes: a light tree over the triangles that emit (see `light_tree`)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.color import LUMINANCE
from tiscene.scene.description import Material, Mesh, Texture, TextureLookup
from tiscene.scene.lights.light_tree import (
    BACK,
    CENTER,
    NORMAL,
    ROW,
    SIZE2,
    SPREAD2,
    STRENGTH,
    build_tree,
    empty_rows,
    group_row,
)
from tiscene.scene.textures.atlas import linear_pixels

# Weight of the back faces of closed meshes, which are rarely visible.
_CLOSED_BACK = 0.02


@dataclass(frozen=True, eq=False)
class MeshLight:
    """The light tree of a mesh, in object space.

    Attributes:
        nodes: float32 [m, NODE_COLUMNS], as `build_tree` returns; ROW is the triangle's number in the mesh.
        whole: float32 [ATTRIBUTES], all emissive triangles as one group.
        triangles: Number of triangles of the mesh, emissive or not.
    """

    nodes: NDArray[np.float32]
    whole: NDArray[np.float32]
    triangles: int

    def placed(self, world_from_object: NDArray[np.float64]) -> NDArray[np.float32]:
        """Return the attributes of the whole for an instance with that matrix [3, 4]."""
        node: NDArray[np.float32] = self.whole.copy()
        linear = world_from_object[:, :3]
        scale2 = abs(np.linalg.det(linear)) ** (2.0 / 3.0)
        node[CENTER : CENTER + 3] = linear @ node[CENTER : CENTER + 3] + world_from_object[:, 3]
        normal = np.linalg.inv(linear).T @ node[NORMAL : NORMAL + 3]
        length = float(np.linalg.norm(normal))
        if length > 0.0:
            node[NORMAL : NORMAL + 3] = normal * (np.linalg.norm(node[NORMAL : NORMAL + 3]) / length)
        node[[STRENGTH, SIZE2, SPREAD2]] *= scale2
        return node


def build_mesh_light(mesh: Mesh, luminance: NDArray[np.float64]) -> MeshLight | None:
    """Return the MeshLight of a mesh, None if no triangle emits.

    Args:
        mesh: The mesh.
        luminance: [m], of the radiance that each triangle emits; one that is not finite counts as 0.
    """
    corners = np.asarray(mesh.positions, np.float64)[mesh.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.linalg.norm(normal, axis=1)
    emissive = np.flatnonzero((luminance > 0.0) & np.isfinite(luminance) & (area > 0.0))
    if len(emissive) == 0:
        return None
    leaves = empty_rows(len(emissive))
    corners, area = corners[emissive], area[emissive]
    center = corners.mean(axis=1)
    leaves[:, CENTER : CENTER + 3] = center
    leaves[:, NORMAL : NORMAL + 3] = -normal[emissive] / (2.0 * area[:, None])
    leaves[:, STRENGTH] = area * luminance[emissive]
    leaves[:, SIZE2] = area / (2.0 * math.pi)
    leaves[:, BACK] = 1.0
    leaves[:, ROW] = emissive
    orientation = _orientation(mesh)
    if orientation:
        leaves[:, BACK] = _CLOSED_BACK
        leaves[:, NORMAL : NORMAL + 3] *= orientation
    return MeshLight(build_tree(leaves), group_row(leaves), len(mesh.triangles))


def _orientation(mesh: Mesh) -> int:
    """Return 1 for a closed mesh with triangles counter-clockwise from outside, -1 if from inside, 0 if open."""
    _, vertex = np.unique(np.asarray(mesh.positions, np.float32), axis=0, return_inverse=True)
    triangles = vertex.reshape(-1)[mesh.triangles].astype(np.int64)
    begins, ends = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    size = len(mesh.positions)
    edges = np.sort(begins * size + ends)
    if not np.array_equal(edges, np.sort(ends * size + begins)):
        return 0
    corners = np.asarray(mesh.positions, np.float64)[mesh.triangles]
    return int(np.sign(np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))))


def mean_emission(material: Material, textures: Sequence[Texture]) -> float:
    """Return the mean luminance of a material's emission, W/m²/sr. textures: of its description."""
    emitted = material.emissive_color
    if not isinstance(emitted, TextureLookup):
        return max(float(np.asarray(emitted) @ LUMINANCE), 0.0)
    mean = np.ones(3)
    if emitted.texture is not None and emitted.texture >= 0:
        pixels = linear_pixels(textures[emitted.texture]).astype(np.float64)
        channels = {"rgb": [0, 1, 2], "r": [0] * 3, "g": [1] * 3, "b": [2] * 3, "a": [3] * 3}[emitted.channel]
        scale, bias = np.asarray(emitted.scale)[channels], np.asarray(emitted.bias)[channels]
        mean = np.maximum(pixels[..., channels] * scale + bias, 0.0).mean(axis=(0, 1))
    return float(mean @ LUMINANCE)
