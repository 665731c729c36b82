# SPDX-License-Identifier: Apache-2.0
"""Random scenarios drawn from ranges, for `Scenario.sample`, and factors of variation, for `Scenario.with_factor`.

::

    sampler              draw a scenario
    factors              factors of variation by name
    difficulty_search    scenarios of a measured difficulty
    factor_ranges        the ranges of factors
    illumination_factor  time of day, strength, color and direction of lights
    material_factor      base colors, roughness and textures
    furniture_factor     movable objects of the scene elsewhere
    clutter_factor       distractors that rest in view
    path_factors         places of objects anew: occlusion, rooms
    view_factor          pose and lens of the main camera
    scene_collisions     whether an object penetrates the scene
    object_paths         length of loops, balls along paths
    object_factors       speed, instances and categories of objects
    ranges               the ranges to draw from
    draws                random numbers by seed, object and purpose
    object_placer        find a position or a closed path for an object
    scene_files          scenes and templates that were read last
    free_places          find free places for objects that are spawned in a running stream
    point_pools          random free points: visible, hidden, out of view
    free_space           free balls, lines of sight and reachability in a scene
    static_rays          rays between points of a static scene
    template_extent      size of a template
"""
