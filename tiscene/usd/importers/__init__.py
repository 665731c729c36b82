# SPDX-License-Identifier: Apache-2.0
"""Import of models in other formats as object templates.

::

    import_template  import_asset: one model file as a template
    mesh_file        OBJ, glTF, PLY, STL files as meshes, through trimesh
    materials        Phong and glTF materials as UsdPreviewSurface
    unity_model      OBJ files as Unity keeps them, with materials in JSON
    gltf             glTF extensions that trimesh does not read
    sweet_home_3d    furniture catalogs of Sweet Home 3D (.sh3f)
"""
