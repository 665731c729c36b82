# SPDX-License-Identifier: Apache-2.0
"""Simple solids and rooms as triangles, and obstacles and movers made of them."""

from __future__ import annotations

import functools

import numpy as np

from dynamics.obstacles import Obstacles
from dynamics.rotation import matrix_from_quaternion
from dynamics.sphere_proxy import Shape, cover
from tiscene.device import runtime
from tiscene.scene.bvh.obstacle_tree import MeshTrees, ObstacleTree
from tiscene.scene.description import Instance, Mesh

# Test modules build shapes at import, before any fixture runs.
runtime.start(threads=2)


def box(size, center=(0.0, 0.0, 0.0)) -> np.ndarray:
    """Return the twelve triangles [12, 3, 3] of a box, counter-clockwise seen from outside."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    rows = [row for a, b, c, d in quads for row in ((a, b, c), (a, c, d))]
    return (corners * size + center)[np.array(rows)]


def quad(center, along, across) -> np.ndarray:
    """Return the two triangles of a rectangle; `along` and `across` are half its edges."""
    c, u, v = (np.asarray(each, np.float64) for each in (center, along, across))
    corners = np.array([c - u - v, c + u - v, c + u + v, c - u + v])
    return corners[np.array([(0, 1, 2), (0, 2, 3)])]


def obstacles(*parts: np.ndarray, matrices=None, layout=None):
    """Return a provider of obstacles, with one mesh and instance for each part.

    Args:
        *parts: Triangles [n, 3, 3].
        matrices: 4x4 matrix of each instance; None: identities.
        layout: Layout of the trees; None: the device's default.
    """
    meshes = [
        Mesh("part", part.reshape(-1, 3).astype(np.float32), np.arange(3 * len(part), dtype=np.int32).reshape(-1, 3),
             np.zeros(len(part), np.int32))
        for part in parts
    ]  # fmt: skip
    matrices = [np.eye(4)] * len(parts) if matrices is None else matrices

    @functools.cache
    def make() -> Obstacles:
        trees = MeshTrees.built(meshes, layout)
        tree = ObstacleTree(trees, [Instance(row, row, matrix) for row, matrix in enumerate(matrices)])
        return Obstacles.from_trees(trees.bvh, trees.is_bvh8, tree.roots, tree.matrices, tree.root)

    return lambda _frame=0: make()


def spheres_at(shape: Shape, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return centers [n, 3] and radii [n] of a body's proxy spheres in the world."""
    spheres = shape.spheres.astype(np.float64)
    return spheres[:, :3] @ matrix_from_quaternion(pose[3:]).T + pose[:3], spheres[:, 3]


def ball(radius: float) -> Shape:
    """Return the shape of a single sphere about the origin."""
    sphere = np.array([[0.0, 0.0, 0.0, radius]], np.float32)
    return Shape(sphere, sphere.copy(), np.array([0, 1], np.int32), radius)


def cube(size: float) -> Shape:
    """Return the proxy spheres of a cube."""
    return cover(box((size, size, size)), max_spheres=48)
