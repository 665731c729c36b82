# SPDX-License-Identifier: Apache-2.0
"""Meshes that are on the device only while frames need them: the topologies of shapes that change.

Each shape has room for three meshes, those of the frames k-1, k and k+1, which its meshes use in turn.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.bvh.blas import Blas, TreeRoom
from tiscene.scene.bvh.bvh import Bvh
from tiscene.scene.description import Mesh
from tiscene.scene.placement import Placement
from tiscene.scene.reused_arrays import ReusedArrays

FRAMES = 3  # k-1, k and k+1


@dataclass(eq=False)
class MeshRoom:
    """Rows of the scene's arrays that one mesh after another uses.

    Attributes:
        size: A mesh of zeros, as large as the largest of the meshes.
        first_material: Row of the first material of their description.
        first_vertex: Row of the first vertex.
        first_triangle: Row of the first triangle.
        tree: Rows of the tree.
        row: The mesh that is there; -1: none.
    """

    size: Mesh
    first_material: int
    first_vertex: int = 0
    first_triangle: int = 0
    tree: TreeRoom = field(default_factory=TreeRoom)
    row: int = -1


class TransientMeshes:
    """The transient meshes of a scene, and the rooms that they use.

    Attributes:
        rooms: The rooms.
    """

    def __init__(self) -> None:
        self.rooms: tuple[MeshRoom, ...] = ()
        # Of a mesh, by its row; the room used least recently comes first.
        self._rooms_of: dict[int, list[MeshRoom]] = {}

    def __bool__(self) -> bool:
        return bool(self.rooms)

    def add(self, meshes: Sequence[Mesh], first: int, first_material: int) -> None:
        """Make room for the transient meshes of a description.

        Args:
            meshes: All its meshes.
            first: Row of the first one.
            first_material: Row of its first material.
        """
        shapes: dict[int, list[int]] = {}
        for row, mesh in enumerate(meshes):
            if mesh.shape:
                shapes.setdefault(mesh.shape, []).append(row)
        for rows in shapes.values():
            size = _largest([meshes[row] for row in rows])
            rooms = [MeshRoom(size, first_material) for _ in rows[:FRAMES]]
            self.rooms += tuple(rooms)
            self._rooms_of.update(dict.fromkeys((first + row for row in rows), rooms))

    def clear(self, first_vertices: Sequence[int], first_triangle: int) -> None:
        """Make all rooms empty.

        Args:
            first_vertices: Row of the first vertex of each room.
            first_triangle: Row of the first triangle of the first room.
        """
        for room, first_vertex in zip(self.rooms, first_vertices, strict=True):
            room.row, room.first_vertex, room.first_triangle = -1, first_vertex, first_triangle
            first_triangle += len(room.size.triangles)

    def write(
        self, placement: Placement, meshes: Sequence[Mesh], arrays: ReusedArrays, bvh: Bvh
    ) -> Iterator[tuple[int, MeshRoom, Blas]]:
        """Write the meshes that a placement needs and no room holds to the device, and build their trees.

        Args:
            placement: Of a frame.
            meshes: All meshes of the scene.
            arrays: Where their vertices and triangles are.
            bvh: Where their trees are.

        Yields:
            The row of each mesh that was written, its room and its tree.
        """
        shown = np.unique(placement.mesh[placement.present.any(axis=0)]).tolist() if self else []
        needed = [row for row in shown if row in self._rooms_of]
        missing = []
        for row in needed:
            rooms = self._rooms_of[row]
            held = next((each for each in rooms if each.row == row), None)
            if held is None:
                missing.append(row)
            else:
                rooms.append(rooms.pop(rooms.index(held)))
        for row in missing:
            rooms, mesh = self._rooms_of[row], meshes[row]
            room = rooms.pop(0)
            rooms.append(room)
            room.row = row
            arrays.overwrite(mesh, room.first_material, room.first_vertex, room.first_triangle)
            shape = np.ascontiguousarray(mesh.positions), np.ascontiguousarray(mesh.triangles)
            yield row, room, bvh.add_mesh(*shape, room.first_triangle, room=room.tree)


def resident(meshes: Sequence[Mesh]) -> Sequence[Mesh]:
    """Return meshes with an empty one in place of each transient one; the same object if none is."""
    if not any(mesh.shape for mesh in meshes):
        return meshes
    return tuple(_zeros(mesh.name, 0, 0) if mesh.shape else mesh for mesh in meshes)


def resident_arrays(meshes: Sequence[Mesh]) -> tuple[list[NDArray[np.float32]], list[NDArray[np.int32]]]:
    """Return positions [n, 3] and triangles [m, 3] of meshes; none of transient ones."""
    meshes = resident(meshes)
    positions = [np.ascontiguousarray(mesh.positions, np.float32) for mesh in meshes]
    return positions, [np.ascontiguousarray(mesh.triangles, np.int32) for mesh in meshes]


def _largest(meshes: Iterable[Mesh]) -> Mesh:
    """Return a mesh of zeros that is as large as the largest of some meshes."""
    sizes = [(mesh.name, len(mesh.positions), len(mesh.triangles)) for mesh in meshes]
    return _zeros(sizes[0][0], max(each[1] for each in sizes), max(each[2] for each in sizes))


def _zeros(name: str, vertices: int, triangles: int) -> Mesh:
    corners = np.zeros((triangles, 3), np.int32)
    return Mesh(name, np.zeros((vertices, 3), np.float32), corners, np.zeros(triangles, np.int32))
