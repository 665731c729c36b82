# SPDX-License-Identifier: Apache-2.0
"""Device tables of lights and the trees to sample and intersect them.

::

    light_kinds         one entry per kind of light, and the registry of further kinds
    light_table         one row per light
    light_tree          nodes for importance sampling of many lights
    light_bvh           bounding boxes for intersecting lights
    image_distribution  importance sampling of light textures
    mesh_lights         emissive triangles of meshes
    emissive_meshes     the emissive meshes of a scene, while materials vary
    light_groups        static lights with per-group intensity factors
"""
