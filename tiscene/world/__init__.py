# SPDX-License-Identifier: Apache-2.0
"""World: the state of all objects, cameras and lights at each frame.

::

    world             World
    world_parts       WorldParts: what depends on the edits
    camera_edits      placing and turning cameras
    edit_lock         edits that wait for frames and edits of other threads
    object_edits      spawning, removing and moving objects; placing the walls of the frustum
    world_cameras     poses of the cameras at each frame
    world_state       WorldState: everything about one frame
    frame_evaluator   placements, live objects, lights and movers at one frame
    object_registry   ids, labels, meshes and boxes of all objects
    object_geometry   meshes, box and lights of a template at a scale
    overridden_stage  the stage with a scenario's overrides
    category_ids      ids of semantic categories
    stage_objects     edits of the stage's own objects
    stage_animation   instances that move by the stage's time samples
    material_animation  materials that vary by the stage's time samples
    trajectories      poses of objects, cameras and lights; collisions
    physics_trajectories  the same with rigid bodies
    physics           rigid bodies, simulated by MuJoCo
    object_movers     objects as bodies of dynamics
    collision_onset   first frame at which objects might collide
    lights            lights at each frame
    event_detector    events between two frames
    overlap_detector  what an object is placed inside of
    place_finder      where a spawned object may be put: the request for a free place
    room_finder      rooms of objects
    view_history      views of objects shown before
    frustum_test      which boxes a camera has in view
"""
