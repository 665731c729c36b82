# SPDX-License-Identifier: Apache-2.0
"""UsdLux lights.

::

    light    light prims in radiometric units
    animated_light  inputs and visibility with time samples
    shaping  ShapingAPI: cones, focus, IES profiles; unsupported controls
    ies      IES photometric files
"""
