# SPDX-License-Identifier: Apache-2.0
"""World: the state of all objects, cameras and lights at each frame.

::

    world            World
    world_state      WorldState: everything about one frame
    object_registry  ids, labels, meshes and boxes of all objects
    category_ids     ids of semantic categories
    stage_objects    edits of the stage's own objects
    stage_animation  instances that move by the stage's time samples
    trajectories     poses of objects, cameras and lights; collisions
    lights           lights at each frame
    event_detector   events between two frames
    frustum_test     which boxes a camera has in view
"""
