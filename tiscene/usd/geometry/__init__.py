# SPDX-License-Identifier: Apache-2.0
"""UsdGeom shapes as triangle meshes.

::

    mesh           UsdGeomMesh
    primvar        primvars and normals
    triangulate    polygons to triangles
    subdivision    Catmull-Clark subdivision
    vertex_weld    one normal and uv per vertex
    gprim          cube, sphere, cylinder, cone, capsule, plane
    curves         curves and points
    deforming      meshes that change over time
    skinning       UsdSkel
    display_color  displayColor and displayOpacity
"""
