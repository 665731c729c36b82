# SPDX-License-Identifier: Apache-2.0
"""ReusedArrays: the large device arrays of a scene, which scenes of the same stage use one after another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tiscene.device.memory import write_rows
from tiscene.device.part_arrays import ArrayPart, PartArray
from tiscene.scene.description import Mesh


class MeshGroup(NamedTuple):
    """The meshes of a description.

    Attributes:
        meshes: The description's own tuple, or one that lives as long.
        first_material: Row of the description's first material.
    """

    meshes: Sequence[Mesh]
    first_material: int


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
        self, groups: Sequence[MeshGroup], first_vertices: NDArray[np.int64], copies: NDArray[np.int64]
    ) -> NDArray[np.int64]:
        """Make the arrays hold meshes.

        Args:
            groups: The meshes of each description.
            first_vertices: int64 [n + 1], row of the first vertex of each mesh, and the number of vertices.
            copies: int64 [n], number of blocks of vertices of each mesh.

        Returns:
            int64 [n], the first row of colors of each mesh in `vertex_uv`.
        """
        parts: list[list[ArrayPart]] = [[] for _ in range(6)]
        colors, first_colors, row, begin = [], [], int(first_vertices[-1]), 0
        for group in groups:
            meshes, end = group.meshes, begin + len(group.meshes)
            firsts, counts = first_vertices[begin:end], copies[begin:end]
            vertices, faces = int(first_vertices[end] - first_vertices[begin]), sum(len(m.triangles) for m in meshes)
            # Kernels overwrite the vertices of deforming meshes.
            source = object() if any(mesh.deformation is not None for mesh in meshes) else meshes
            rows = (
                (source, 0, vertices, partial(_vertices, meshes, counts, _positions)),
                (source, 0, vertices, partial(_vertices, meshes, counts, _normals)),
                (meshes, 0, vertices, partial(_vertices, meshes, counts, _uvs)),
                (meshes, int(firsts[0]) if len(firsts) else 0, faces, partial(_triangles, meshes, firsts)),
                (meshes, group.first_material, faces, partial(_materials, meshes, group.first_material)),
                (meshes, 0, faces, partial(_parts, meshes)),
            )
            for each, part in zip(parts, rows, strict=True):
                each.append(ArrayPart(*part))
            for mesh in meshes:
                first_colors.append(row)
                if mesh.colors is not None and mesh.second_uv is not None:
                    colors.append(ArrayPart(mesh, 0, 3 * len(mesh.colors), partial(_color_rows, mesh)))
                    row += 3 * len(mesh.colors)
            begin = end
        parts[2] += colors
        arrays = self.vertex_position, self.vertex_normal, self.vertex_uv
        for array, each in zip(
            (*arrays, self.triangle_vertices, self.triangle_material, self.triangle_part), parts, strict=True
        ):
            array.write(each)
        return np.array(first_colors, np.int64)

    def overwrite(self, mesh: Mesh, first_material: int, first_vertex: int, first_triangle: int) -> None:
        """Write a mesh without colors over others that are no longer needed.

        Args:
            mesh: The mesh.
            first_material: Row of its description's first material.
            first_vertex: Row of its first vertex.
            first_triangle: Row of its first triangle.
        """
        vertices = (self.vertex_position, _positions), (self.vertex_normal, _normals), (self.vertex_uv, _uvs)
        for array, values in vertices:
            write_rows(array.array, first_vertex, np.ascontiguousarray(values(mesh), np.float32))
        faces = (
            (self.triangle_vertices, _triangles([mesh], np.array([first_vertex]))),
            (self.triangle_material, _materials([mesh], first_material)),
            (self.triangle_part, _parts([mesh])),
        )
        for array, rows in faces:
            write_rows(array.array, first_triangle, np.ascontiguousarray(rows, np.int32))


def _vertices(
    meshes: Sequence[Mesh], copies: NDArray[np.int64], values: Callable[[Mesh], NDArray[Any]]
) -> NDArray[np.float32]:
    """Return values of the vertices of meshes, with the copies of each mesh one after another."""
    return np.concatenate(
        [values(mesh) for mesh, count in zip(meshes, copies.tolist(), strict=True) for _ in range(count)]
    )


def _positions(mesh: Mesh) -> NDArray[Any]:
    return mesh.positions


def _normals(mesh: Mesh) -> NDArray[Any]:
    return np.zeros_like(mesh.positions) if mesh.normals is None else mesh.normals


def _uvs(mesh: Mesh) -> NDArray[Any]:
    return np.zeros((len(mesh.positions), 2), np.float32) if mesh.uv is None else mesh.uv


def _triangles(meshes: Sequence[Mesh], firsts: NDArray[np.int64]) -> NDArray[Any]:
    return np.concatenate([mesh.triangles + first for mesh, first in zip(meshes, firsts, strict=True)])


def _materials(meshes: Sequence[Mesh], first: int) -> NDArray[Any]:
    return np.concatenate([np.asarray(mesh.materials, np.int32) + first for mesh in meshes])


def _parts(meshes: Sequence[Mesh]) -> NDArray[Any]:
    return np.concatenate(
        [np.zeros(len(mesh.triangles), np.int32) if mesh.parts is None else mesh.parts for mesh in meshes]
    )


def _color_rows(mesh: Mesh) -> NDArray[Any]:
    """Return the rows of `vertex_uv` with second uv and colors."""
    return np.concatenate([np.asarray(mesh.second_uv), np.asarray(mesh.colors)], axis=1).reshape(-1, 2)
