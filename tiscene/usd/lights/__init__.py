# SPDX-License-Identifier: Apache-2.0
"""UsdLux lights.

::

    light    light prims in radiometric units
    shaping  ShapingAPI: cones, focus, IES profiles; unsupported controls
    ies      IES photometric files
"""
