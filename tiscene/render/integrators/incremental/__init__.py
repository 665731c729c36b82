# SPDX-License-Identifier: Apache-2.0
"""Incremental rendering: a base image of the static scene, corrected where movers change its light.

Movers are the instances that move while the camera and the lights stand still. The base image is a control variate:
frame = base image + mean over cached paths of (path with movers - path without), with the same random numbers in both.
Most paths are touched by no mover and cost only an intersection test. `incremental_pass` describes the algorithm.

::

    incremental_pass  IncrementalPass: prepare a base, render frames over it
    base_image        radiance image of the static scene by light group
    base_image_cache  base images on disk
    base_lights       lights of a base image
    path_cache        cached paths of the static scene
    path_recording    kernels that record paths
    path_retracer     PathRetracer: trace again what movers invalidate
    selected_paths    cached paths of some pixels
    retrace_kernels   find and re-trace invalidated paths, compose the frame
    frame_scratch     device arrays of a frame
    mover_bounds      boxes around movers
    mover_culling     which rays come near movers
    mover_coverage    fraction of each pixel covered by movers
    changed_regions   rectangles to denoise at full resolution
    cost_estimate     estimate the cost of re-tracing from probe paths
    outlier_filter    suppress outliers before denoising
"""
