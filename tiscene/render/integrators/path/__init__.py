# SPDX-License-Identifier: Apache-2.0
"""Unidirectional path tracing with next-event estimation and multiple importance sampling, as a wavefront of kernels.

For each batch of paths: `start_paths` generates camera rays; then, once per segment, `closest` intersects the rays,
`shade` processes one vertex of every live path and `compact` builds the queues of live paths and of shadow rays, which
`PathPass.cast_shadows` tests; at last `accumulate` adds the paths to the film. See Physically Based Rendering, 4th
edition, chapter 15.

::

    path_pass          PathPass, the host side of the loop above
    path_image         PathImage, what they render
    path_frames        PathFrames: several frames in one wavefront
    frame_stack        what tells the paths of these frames apart
    path_scene         scene arrays for the kernels
    path_state         arrays of a batch of paths
    wavefront_kernels  start paths, compact queues, accumulate the film
    shading            one vertex of every live path
    direct_light       what a light sample contributes to a vertex
    shadow_rays        shadow rays through partially opaque surfaces
    last_segment       the last segment where only lights emit
    radiance_cache     light in which paths may end
"""
