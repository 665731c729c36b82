# SPDX-License-Identifier: Apache-2.0
"""UsdShade materials, displayColor and textures.

::

    material         the material table: bound materials and displayColor
    animated_material  materials with time samples
    surface_shader   which shader of a network draws surfaces
    preview_surface  shader networks, UsdPreviewSurface
    materialx_file        .mtlx files as XML, with those that they include
    materialx_document    .mtlx files as USD layers
    materialx_surface     standard_surface, open_pbr_surface, gltf_pbr as materials
    materialx_bsdf        BSDFs and EDFs of a surface as weighted lobes
    materialx_folding     weighted lobes as inputs of standard_surface
    materialx_models      names and defaults of their inputs
    materialx_inputs      inputs of a surface as numbers and textures
    materialx_lobes       inputs that UsdPreviewSurface lacks
    materialx_network     networks of MaterialX nodes
    materialx_nodes       categories and widths of nodes, by the ids of their definitions
    materialx_images      image nodes
    materialx_units       units of inputs
    materialx_operations  MaterialX's operations on values
    materialx_noise       noises of texture coordinates
    materialx_signal      values of a network: constants, texture lookups, computed images
    materialx_baker       values per texel, as texture lookups
    texture          the texture table: image files, UDIM tiles, color spaces
    texture_borders  check for textures without wrap mode
    image            decoding of image files
    png16            decoding of 16-bit PNG files
    color_profile    color space metadata of image files
"""
