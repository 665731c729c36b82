# SPDX-License-Identifier: Apache-2.0
"""Rendering of a device scene: labels, path tracing, light that frames share. Independent of USD.

`Renderer.render` is the entry point: a view and a placement in, buffers out.

::

    renderer         Renderer, which renders the buffers of a frame
    render_settings  RenderSettings and presets
    view             cameras of a frame, camera rays, projection
    warm_up          compile the kernels by rendering one pixel
    columns          vectors in three columns of a table
    texture_lookup   filtered texture lookups
    integrators      label pass, path tracer, incremental renderer, panoramas
    intersect        ray-scene intersection
    lights           sampling and intersecting lights
    bsdfs            surface scattering
    sampling         random numbers, warps, pixel filters
    film             adaptive sampling, denoising, upsampling, tone mapping
    annotations      per-object boxes, pixel counts and masks
"""
