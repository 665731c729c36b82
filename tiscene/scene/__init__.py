"""What a stage said, as numpy, and as device arrays.

::

    description                            what the files said: meshes, materials, lights, instances
        animation, parts                   what of it changes by itself; boxes, and objects of several meshes
    placement                              where the instances are at a frame
    device_scene                           what kernels read
        device_array                       host arrays to the device's
        material_table, texture_atlas
            texture_copies
        light_table, light_images          lamps and skies
            light_nodes, light_boxes       what they are chosen by, and met by
            mesh_lights                    meshes that glow
            light_groups                   how brightness is told apart from place
        bvh                                the trees that rays walk
            bvh_build, bvh_write, bvh_workspace
            bvh_parts, bvh_refit           of large instances, and of meshes that deform
        deforming
    obstacles                              the same trees for collisions
"""
