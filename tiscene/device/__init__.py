# SPDX-License-Identifier: Apache-2.0
"""Taichi: start, arrays, and faster launches.

::

    runtime           start Taichi once per process
    restart           notice that the user's code restarted Taichi
    worker_affinity   bind each of Taichi's threads to a core
    prefix_sums       prefix sums whose result does not depend on threads
    vector_mode       compile kernels with SIMD vectors
    memory            host arrays to device arrays
    array_pool        memory of deleted arrays, used again
    part_arrays       arrays of parts, of which those that are there are not copied again
    kept_uploads      device arrays for values that are new in every frame
    kernel_types      types of kernel arguments
    argument_bundles  named tuples as kernel parameters
    taichi_patches    replacements for slow parts of Taichi's Python code
"""
