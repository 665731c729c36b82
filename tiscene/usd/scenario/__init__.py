# SPDX-License-Identifier: Apache-2.0
"""Scenarios and motion on USD stages, read and written.

::

    read                read the scenario of a stage
    write               write a scenario as a layer over its scene
    motion_schema       trajectories as attributes of TisceneMotionAPI
    rigid_body_schema   rigid bodies by the schemas of UsdPhysics
    joint_schema        joints by the schemas of UsdPhysics
    filtered_pairs_schema  bodies that do not collide, by the schemas of UsdPhysics
    stage_cameras       the cameras of a stage and their exact values
    layer               layers over a scene: references, cameras, poses
    layer_files         scenes and templates that are files, found from the layer
    bake                a stream's motion as time samples
    light_time_samples  animated lights, read and written
"""
