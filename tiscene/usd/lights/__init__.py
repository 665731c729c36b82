# SPDX-License-Identifier: Apache-2.0
"""UsdLux lights.

::

    light    light prims in radiometric units
    animated_light  inputs and visibility with time samples
    light_linking  which lights light and shadow which prims
    shaping  ShapingAPI: cones, focus, IES profiles; unsupported controls
    ies      IES photometric files
"""
