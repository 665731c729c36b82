"""UsdLux lights.

::

    light    lights in radiometric units
    shaping  ShapingAPI: cones, focus, IES profiles
    ies      IES photometric files
"""
