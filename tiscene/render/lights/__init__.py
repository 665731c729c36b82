# SPDX-License-Identifier: Apache-2.0
"""Sampling and intersecting lights.

::

    dispatch          all kinds of light as one
    light_sampler     choose a light
    importance        estimated contribution of a light
    intersect         intersect rays with lights
    light_sample      the result of sampling, and rows of the light table
    image_sampling    sample a light's texture
    emission_profile  UsdLux shaping: cone, focus, IES
    lane_ops          reductions over 8-wide vectors
    point, sphere, disk, rect, cylinder, distant, dome, portal, emissive_mesh  one kind each
"""
