# SPDX-License-Identifier: Apache-2.0
"""USD stages to scene descriptions.

::

    stage_reader       read_stage
    traversal          traverse the prims of a stage
    traversal_context  what a prim inherits from its ancestors
    instancer_reader   point instancers as objects
    object_builder     objects, their instances and colliders
    mesh_table         meshes, shared by instances
    point_instancer    points of UsdGeomPointInstancer
    stage_camera       UsdGeomCamera
    stage_render_settings  camera, resolution and conform policy of RenderSettings
    room_volumes       volumes of rooms
    gravity            gravity, by the PhysicsScene
    extracted_prims    prims that a scenario moves, as templates
    template           templates from files and from /Templates
    kept_templates     templates that were read last
    inspection         metadata and statistics of a file
    subprocess_reader  read in a child process, with limits
    subprocess_worker  the child process
"""
