# SPDX-License-Identifier: Apache-2.0
"""Read a stage into a SceneDescription.

::

    stage_reader     read_stage
    subprocess_reader  read in another process, with limits
    subprocess_worker  the program of that process
    traversal        walk the prims
    object_builder          objects with an identity
    extracted_prims  prims that move, extracted as templates
    point_instancer  UsdGeomPointInstancer
    mesh_table       unique meshes
    stage_camera     UsdGeomCamera
    template         object templates
    inspection       summary of a file
"""
