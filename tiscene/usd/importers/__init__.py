# SPDX-License-Identifier: Apache-2.0
"""Import of models in other formats as object templates.

::

    import_template  import_asset: one model file as a template
    mesh_file        model files as meshes; OBJ, PLY and STL through trimesh
    polygons         polygons of OBJ and PLY files as triangles
    imported_mesh    triangles of one material, at rest and over time
    imported_mesh_writer  such meshes as UsdGeomMesh
    materials        materials as UsdPreviewSurface; Phong's
    gltf_scene       meshes of glTF files
    gltf_materials   their materials
    gltf_lobes       extensions of theirs that UsdPreviewSurface lacks
    gltf_animation   their motion
    unity_model      OBJ files as Unity keeps them, with materials in JSON
    gltf             glTF files: JSON, buffers, accessors, images
    sweet_home_3d    furniture catalogs of Sweet Home 3D (.sh3f)
"""
