# SPDX-License-Identifier: Apache-2.0
"""Rendering: labels, path tracing, incremental rendering. Knows the device scene, not USD.

::

    renderer        Renderer and RenderSettings
    view            cameras of a frame
    warm_up         compile the kernels by rendering one pixel
    texture_lookup  filtered texture lookups
    integrators     label pass, path tracer, incremental renderer
    intersect       ray-scene intersection
    lights          sampling and intersecting lights
    bsdfs           surface scattering
    sampling        random numbers, warps, pixel filters
    film            adaptive sampling, denoising, upsampling, tone mapping
    annotations     per-object boxes, pixel counts and masks
"""
