# SPDX-License-Identifier: Apache-2.0
"""Models of other formats as templates.

::

    import_template  import_template
    mesh_file        OBJ, glTF, PLY, STL through trimesh
    materials        imported materials as UsdPreviewSurface
    gltf             glTF extensions
    sweet_home_3d    Sweet Home 3D catalogs
"""
