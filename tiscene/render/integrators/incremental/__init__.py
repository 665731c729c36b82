# SPDX-License-Identifier: Apache-2.0
"""Incremental rendering: a base image of the static scene, corrected where movers change it.

::

    incremental_pass  IncrementalPass
    base_image        radiance image of the static scene by light group
    base_image_cache  base images on disk
    base_lights       lights of a base image
    path_cache        kept paths of the static scene
    path_recording    kernels that record paths
    selected_paths    kept paths of some pixels
    retrace_kernels   find and re-trace invalidated paths
    mover_culling     which rays come near movers
    mover_coverage    fraction of each pixel covered by movers
    changed_regions   rectangles to denoise at full resolution
    cost_estimate     estimate the cost of re-tracing from probe paths
    outlier_filter    suppress outliers before denoising
"""
