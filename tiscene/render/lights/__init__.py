# SPDX-License-Identifier: Apache-2.0
"""Sampling and intersecting lights.

::

    light_kernels     the kernels of each kind of light; register_light
    dispatch          sample, density, intersection and emission of any light
    light_sampler     choosing a light
    importance        estimated contribution of a light
    intersect         rays against lights; emission weighted by MIS
    light_sample      the result of sampling, and access to the light table
    image_sampling    sampling a light's texture
    emission_profile  UsdLux shaping: cone, focus, IES
    lane_ops          reductions over 8-wide vectors
    point, sphere, disk, rect, cylinder, distant, dome, portal, emissive_mesh  one kind each
"""
