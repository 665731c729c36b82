# SPDX-License-Identifier: Apache-2.0
"""Trees of the templates that this process has used, as long as their descriptions exist."""

from __future__ import annotations

import weakref
from dataclasses import replace

from tiscene.scene.bvh.blas import Blas
from tiscene.scene.bvh.bvh import Bvh
from tiscene.scene.bvh.moved_trees import BLOCK_ROWS, NODE_ROWS, MovedTrees
from tiscene.scene.bvh.workspace import BVH8
from tiscene.scene.deforming_mesh import box_of
from tiscene.scene.description import SceneDescription
from tiscene.scene.transient_meshes import resident_arrays

_known: weakref.WeakKeyDictionary[SceneDescription, MovedTrees] = weakref.WeakKeyDictionary()


def add_meshes_of(description: SceneDescription, bvh: Bvh, first_triangle: int, *, keep: bool) -> list[Blas]:
    """Add the trees of a description's meshes; return the tree of each mesh: of transient ones, an empty one.

    Args:
        description: The stage or template.
        bvh: Where they are added.
        first_triangle: The scene's row of the first triangle.
        keep: Whether to keep a copy, as long as the description exists, so that they are built once in this process.
    """
    if description in _known and bvh.layout is BVH8:
        return bvh.add_moved(_known[description], first_triangle)
    nodes, leaf_blocks = bvh.used_rows
    added = bvh.add_meshes(*resident_arrays(description.meshes), first_triangle)
    trees = zip(description.meshes, added, strict=True)
    # A transient mesh has its box when it is not on the device, too.
    blas = [replace(tree, box=box_of(mesh.positions)) if mesh.shape else tree for mesh, tree in trees]
    if keep and bvh.layout is BVH8:
        first = nodes // NODE_ROWS, leaf_blocks // BLOCK_ROWS, first_triangle
        rows = (
            bvh.nodes.to_numpy()[nodes : bvh.used_rows[0]],
            bvh.leaf_blocks.to_numpy()[leaf_blocks : bvh.used_rows[1]],
        )
        _known[description] = MovedTrees.of(*rows, blas, first)
    return blas
