# SPDX-License-Identifier: Apache-2.0
"""Two-level bounding volume hierarchy: one tree per mesh, one over instances.

::

    bvh             Bvh: build, place and refit the trees
    tree_arrays     TreeArrays: the arrays of nodes and triangles of all trees
    bvh_copy        BvhCopy: the trees of meshes that another scene begins with
    moved_trees     MovedTrees: trees that were built elsewhere
    template_trees  the trees of templates, built once in a process
    blas            Blas: the tree of one mesh
    build_kernels   binned surface-area heuristic
    binary_trees    the layout "bvh2": trees without a loop in one thread
    large_range_kernels  split large ranges by all threads together
    layout_kernels  binary trees to 8-wide nodes and leaf blocks
    refit_kernels   move a deforming mesh's tree
    workspace       arrays of a build in progress
    instance_tree   trees over instances, built on the host (GPU)
    rebraid         split large instances in the TLAS
    obstacle_tree   the same trees for collisions
"""
