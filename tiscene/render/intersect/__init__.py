# SPDX-License-Identifier: Apache-2.0
"""Ray-scene intersection.

::

    trace                closest hit and occlusion of arrays of rays
    bvh8                 closest hits in an 8-wide tree, with SIMD vectors (CPU)
    bvh8_packets         packets of sixteen coherent camera rays (CPU)
    bvh8_any_hit         interleaved occlusion rays (CPU)
    bvh2                 scalar traversal of a binary tree (GPU)
    ray_queue            arrays of rays and hits; tracing order
    surface_interaction  position, normal, uv and footprint at a hit
"""
