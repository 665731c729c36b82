# SPDX-License-Identifier: Apache-2.0
"""Path tracing with next-event estimation, as a wavefront of kernels.

::

    path_pass          PathPass
    path_state         arrays of a batch of paths
    wavefront_kernels  start, compact, accumulate
    shading            one vertex of every live path
    shadow_rays        shadow rays through partially opaque surfaces
    last_segment       the last segment where only lights emit
"""
