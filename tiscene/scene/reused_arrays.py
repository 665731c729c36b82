# SPDX-License-Identifier: Apache-2.0
"""ReusedArrays: the large device arrays of a scene, which scenes of the same stage use one after another."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.device.part_arrays import ArrayPart, PartArray
from tiscene.scene.description import Mesh


class ReusedArrays:
    """Device arrays of meshes and images.

    Attributes:
        vertex_position: See DeviceScene, as the next five.
        vertex_normal: f32 [n, 3].
        vertex_uv: f32 [n + 3 c, 2].
        triangle_vertices: i32 [m, 3].
        triangle_material: i32 [m].
        triangle_part: i32 [m].
        texture_words: See TextureArrays, as the next one.
        texture_floats: f32.
    """

    def __init__(self) -> None:
        self.vertex_position, self.vertex_normal = PartArray(np.float32, 3), PartArray(np.float32, 3)
        self.vertex_uv = PartArray(np.float32, 2)
        self.triangle_vertices = PartArray(np.int32, 3)
        self.triangle_material, self.triangle_part = PartArray(np.int32), PartArray(np.int32)
        self.texture_words, self.texture_floats = PartArray(np.int32), PartArray(np.float32)

    @property
    def nbytes(self) -> int:
        """The memory of the arrays, bytes."""
        return sum(each.nbytes for each in vars(self).values())

    def write_meshes(
        self,
        meshes: Sequence[Mesh],
        copies: Sequence[int],
        first_vertices: NDArray[np.int64],
        first_materials: Sequence[int],
    ) -> NDArray[np.int64]:
        """Make the arrays hold meshes.

        Args:
            meshes: The meshes, by row.
            copies: Number of blocks of vertices of each.
            first_vertices: int64 [n + 1], row of the first vertex of each, and the number of vertices.
            first_materials: Row of the first material of the description of each.

        Returns:
            int64 [n], the first row of colors of each mesh in `vertex_uv`.
        """
        positions, normals, uvs, triangles, materials, numbers = [], [], [], [], [], []
        firsts = first_vertices.tolist()
        for mesh, count, first, first_material in zip(meshes, copies, firsts, first_materials, strict=False):
            points, faces = len(mesh.positions), len(mesh.triangles)
            # Kernels overwrite the vertices of deforming meshes.
            source = mesh.positions if mesh.deformation is None else object()
            positions += [ArrayPart(source, 0, points, partial(_same, mesh.positions))] * count
            if mesh.normals is None:
                normals += [ArrayPart(source, 0, points, partial(_zeros, points, 3))] * count
            else:
                source = mesh.normals if mesh.deformation is None else object()
                normals += [ArrayPart(source, 1, points, partial(_same, mesh.normals))] * count
            if mesh.uv is None:
                uvs += [ArrayPart(None, 0, points, partial(_zeros, points, 2))] * count
            else:
                uvs += [ArrayPart(mesh.uv, 0, points, partial(_same, mesh.uv))] * count
            triangles.append(ArrayPart(mesh.triangles, first, faces, partial(_plus, mesh.triangles, first)))
            materials.append(
                ArrayPart(mesh.materials, first_material, faces, partial(_plus, mesh.materials, first_material))
            )
            if mesh.parts is None:
                numbers.append(ArrayPart(None, 0, faces, partial(_zeros, faces)))
            else:
                numbers.append(ArrayPart(mesh.parts, 0, faces, partial(_same, mesh.parts)))
        first_colors, row = [], firsts[-1]
        for mesh in meshes:
            first_colors.append(row)
            if mesh.colors is not None and mesh.second_uv is not None:
                uvs.append(ArrayPart(mesh.colors, 0, 3 * len(mesh.colors), partial(_color_rows, mesh)))
                row += 3 * len(mesh.colors)
        self.vertex_position.write(positions)
        self.vertex_normal.write(normals)
        self.vertex_uv.write(uvs)
        self.triangle_vertices.write(triangles)
        self.triangle_material.write(materials)
        self.triangle_part.write(numbers)
        return np.array(first_colors, np.int64)


def _same(rows: NDArray[Any]) -> NDArray[Any]:
    return rows


def _plus(rows: NDArray[Any], first: int) -> NDArray[np.int32]:
    return np.asarray(rows, np.int32) + np.int32(first)


def _zeros(*shape: int) -> NDArray[np.float32]:
    return np.zeros(shape, np.float32)


def _color_rows(mesh: Mesh) -> NDArray[Any]:
    """Return the rows of `vertex_uv` with second uv and colors."""
    return np.concatenate([np.asarray(mesh.second_uv), np.asarray(mesh.colors)], axis=1).reshape(-1, 2)
