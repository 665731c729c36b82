# SPDX-License-Identifier: Apache-2.0
"""USD files to scene descriptions and back: the only package that imports pxr.

::

    core       stages, reports, units, transforms, semantics, time samples, schema
    read       walk a stage: objects, instances, templates, cameras
    geometry   meshes, subdivision, gprims, curves, skinning
    materials  materials, shader networks, textures, images
    lights     UsdLux
    scenario   scenarios and motion on a stage, both ways
    importers  glTF, OBJ and others to templates
"""
