# SPDX-License-Identifier: Apache-2.0
"""Label pass: one ray through each pixel center.

::

    label_pass      LabelPass
    label_kernels   its kernels
    first_hits      first hit, skipping alpha-rejected surfaces
    surface_labels  values of label buffers at a hit
    coverage        fractional coverage by objects and materials
    static_labels   cache for static objects before a static camera
"""
