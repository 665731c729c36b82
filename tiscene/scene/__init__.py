# SPDX-License-Identifier: Apache-2.0
"""Parsed scene data: on the host, and as device arrays.

::

    description           SceneDescription: meshes, objects, instances
    material_description  Material, Texture
    light_description     one class for each kind of light
    animation             deforming meshes and moving instances
    skinned_deformation   skinned meshes, computed on demand
    input_track           inputs of materials and lights over time
    assembly              objects of several meshes; bounding boxes
    room_volume           volumes of rooms, and which room a point is in
    camera                Camera: pose, lens, exposure
    lens_keyframes        lenses over time
    walking               axes along which a camera walks
    color                 sRGB transfer function
    placement             transforms of all instances around one frame
    device_scene          DeviceScene: what kernels read
    instance_upload       what kernels read of instances, in one upload; several frames
    reused_arrays         the large arrays, which scenes of one stage use one after another
    affine_maps           inverses; boxes around transformed boxes
    deforming_mesh        a deforming mesh on the device
    transient_meshes      topologies that are on the device while frames need them
    material_table        materials as arrays
    bvh                   bounding volume hierarchies
    lights                light tables and trees
    textures              texture atlas
"""
