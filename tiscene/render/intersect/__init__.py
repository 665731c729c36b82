# SPDX-License-Identifier: Apache-2.0
"""Ray-scene intersection.

::

    trace                closest hit and occlusion of arrays of rays
    bvh8                 8-wide traversal with SIMD vectors (CPU)
    bvh8_packets         sixteen coherent camera rays at once
    bvh8_any_hit         occlusion rays, several per thread
    bvh2                 scalar binary traversal (GPU)
    ray_queue            arrays of rays and hits
    surface_interaction  position, normal, uv and footprint at a hit
"""
