# SPDX-License-Identifier: Apache-2.0
"""Rigid bodies: objects that fall, are pushed and come to rest, simulated by MuJoCo (extra `physics`).

::

    rigid_body_simulation  frames of a simulation, with checkpoints
    mover_path             objects with given poses between two frames
    physics_model          bodies and surroundings as a MuJoCo model
    joint_tree             bodies that hang on others, and the joints that are left over
    joints_in_engine       coordinates of free and of joined bodies in the model
    stage_parts            meshes of a stage as convex parts
    parts_cache            convex parts on disk
    free_rotation          bodies that tumble
    convex_parts           surfaces as convex parts
    part_shapes            boxes, spheres, cylinders, capsules and hulls
"""
