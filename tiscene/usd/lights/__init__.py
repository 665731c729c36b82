# SPDX-License-Identifier: Apache-2.0
"""UsdLux lights.

::

    light    lights in radiometric units
    shaping  ShapingAPI: cones, focus, IES profiles
    ies      IES photometric files
"""
