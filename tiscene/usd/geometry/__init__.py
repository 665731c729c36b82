# SPDX-License-Identifier: Apache-2.0
"""UsdGeom gprims as triangle meshes (`vertex_weld.WeldedMesh`).

::

    mesh           UsdGeomMesh: topology, holes, orientation
    primvar        primvars and normals, validated
    point_primvars  values that the points of instancers give to prototypes
    triangulate    polygons to triangles
    subdivision_budget  levels of refinement within a triangle budget
    subdivision    subdivision surfaces
    subdivision_maps  its rules as sparse matrices
    catmull_clark  control cages, refinement and limit rules
    vertex_weld    welded meshes: one normal and uv per vertex
    recentering    points far from the origin of their prim, relative to their own center
    gprim          cube, sphere, cylinder, cone, capsule, plane
    tet_mesh       surfaces of meshes of tetrahedra
    curve_evaluation  points, widths and colors along curves
    swept_curves   tubes and ribbons along polylines
    curves         curves as tubes or ribbons, points as spheres
    draw_modes     models drawn as textured cards
    deforming      shapes with time samples
    topology_spans  times at which a shape has one topology
    skinning       UsdSkel: what moves the points of skinned meshes
    skinned_mesh   skinned meshes at the time read, and how vertices follow their points
    display_color  displayColor and displayOpacity
"""
