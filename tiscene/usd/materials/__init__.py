# SPDX-License-Identifier: Apache-2.0
"""UsdShade materials, displayColor and textures.

::

    material         the material table: bound materials and displayColor
    preview_surface  UsdPreviewSurface networks
    texture          the texture table: image files, UDIM tiles, color spaces
    texture_borders  check for textures without wrap mode
    image            decoding of image files
    png16            decoding of 16-bit PNG files
    color_profile    color space metadata of image files
"""
