# SPDX-License-Identifier: Apache-2.0
"""The label pass: one ray through each pixel center; exact, without sampling.

::

    label_pass      LabelPass, the host side
    label_frames    LabelFrames: cameras and motion of one frame, or of several
    label_images    LabelImages: the arrays that the kernels write
    label_kernels   kernels for rays, motion and occlusion
    first_hits      first hit, skipping alpha-rejected surfaces
    surface_labels  the kernel that writes label buffers at the hits
    coverage        fractional coverage by objects and materials
    point_pass      PointPass: points of surfaces, followed through frames
    static_labels   cache for static objects before a static camera
"""
