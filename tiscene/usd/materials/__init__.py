# SPDX-License-Identifier: Apache-2.0
"""UsdShade materials and textures.

::

    material         materials and displayColor as table rows
    preview_surface  UsdPreviewSurface networks
    texture          the table of textures
    image            image files as arrays
    png16            16-bit PNG
"""
