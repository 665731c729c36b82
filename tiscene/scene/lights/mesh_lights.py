# SPDX-License-Identifier: Apache-2.0
"""Meshes that give light: the triangles that do, as a tree of nodes that they are chosen by (see `light_nodes`)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.description import Material, Mesh, Texture, TextureLookup
from tiscene.scene.lights.image_distribution import LUMINANCE
from tiscene.scene.lights.light_tree import BACK, CENTRE, NORMAL, ROW, SIZE2, SPREAD2, STRENGTH, group, no_members, tree
from tiscene.scene.textures.atlas import linear_pixels

# Of a closed mesh the backs of its triangles are as good as never seen.
_INSIDE = 0.02


@dataclass(frozen=True, eq=False)
class MeshLight:
    """nodes: the tree of a mesh's glowing triangles, in its own space, as `tree` makes it; ROW: of the triangle in the
    mesh. whole: the row of all of them as a group. triangles: how many the mesh has."""

    nodes: NDArray[np.float32]
    whole: NDArray[np.float32]
    triangles: int

    def placed(self, world_from_object: NDArray[np.float64]) -> NDArray[np.float32]:
        """The row of the whole, where an instance of the mesh [3, 4] is."""
        node: NDArray[np.float32] = self.whole.copy()
        linear = world_from_object[:, :3]
        scale2 = abs(np.linalg.det(linear)) ** (2.0 / 3.0)
        node[CENTRE : CENTRE + 3] = linear @ node[CENTRE : CENTRE + 3] + world_from_object[:, 3]
        normal = np.linalg.inv(linear).T @ node[NORMAL : NORMAL + 3]
        length = float(np.linalg.norm(normal))
        if length > 0.0:
            node[NORMAL : NORMAL + 3] = normal * (np.linalg.norm(node[NORMAL : NORMAL + 3]) / length)
        node[[STRENGTH, SIZE2, SPREAD2]] *= scale2
        return node


def mesh_light(mesh: Mesh, glow: NDArray[np.float64]) -> MeshLight | None:
    """Of a mesh whose triangles emit so much luminance [m]; None if there is none, or none that is finite."""
    corners = np.asarray(mesh.positions, np.float64)[mesh.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.linalg.norm(normal, axis=1)
    shining = np.flatnonzero((glow > 0.0) & np.isfinite(glow) & (area > 0.0))
    if len(shining) == 0:
        return None
    leaves = no_members(len(shining))
    corners, area = corners[shining], area[shining]
    center = corners.mean(axis=1)
    leaves[:, CENTRE : CENTRE + 3] = center
    leaves[:, NORMAL : NORMAL + 3] = -normal[shining] / (2.0 * area[:, None])
    leaves[:, STRENGTH] = area * glow[shining]
    leaves[:, SIZE2] = area / (2.0 * math.pi)
    leaves[:, BACK] = 1.0
    leaves[:, ROW] = shining
    outside = _outside(mesh)
    if outside:
        leaves[:, BACK] = _INSIDE
        leaves[:, NORMAL : NORMAL + 3] *= outside
    return MeshLight(tree(leaves), group(leaves), len(mesh.triangles))


def _outside(mesh: Mesh) -> int:
    """1 for a closed mesh whose triangles are counter-clockwise from outside, -1 from inside, 0 for an open one."""
    _, vertex = np.unique(np.asarray(mesh.positions, np.float32), axis=0, return_inverse=True)
    triangles = vertex.reshape(-1)[mesh.triangles].astype(np.int64)
    begins, ends = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    size = len(mesh.positions)
    edges = np.sort(begins * size + ends)
    if not np.array_equal(edges, np.sort(ends * size + begins)):
        return 0
    corners = np.asarray(mesh.positions, np.float64)[mesh.triangles]
    return int(np.sign(np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))))


def glow_of(material: Material, textures: Sequence[Texture]) -> float:
    """The mean luminance of what a material emits. textures: of its description."""
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
