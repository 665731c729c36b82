# SPDX-License-Identifier: Apache-2.0
"""Bidirectional scattering distribution functions.

::

    preview_surface_bsdf  UsdPreviewSurface: its lobes as one BSDF
    material_inputs       inputs at a surface point: constants and textures
    closure               shared terms of the lobes
    diffuse, specular, clearcoat, glass  one lobe each
    energy_tables         albedo tables for energy conservation
    extended_surface_bsdf  the BSDF of MaterialX and glTF materials, with further lobes
    lobe_inputs           inputs of those lobes
    anisotropic, anisotropic_diffuse, colored_glass, sheen, translucent  one lobe each
    sheen_tables          albedo table of sheen
"""
