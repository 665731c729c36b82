# SPDX-License-Identifier: Apache-2.0
"""Scenarios: what happens in a scene, as plain frozen values.

::

    scenario          Scenario
    objects           Object and Frustum
    joints            joints between rigid bodies
    filtered_pairs    pairs that do not collide
    edits             Spawn, Despawn, Move and the edit log
    lifespan_index    objects that are alive at a frame
    overrides         changes of the stage that hold for all frames
    scenario_fields   classes and checks of a scenario's fields
    light_motion      motion and brightness of lights over time
    relative_files    relative paths in JSON files
    serialization     values to JSON and back
    providers         functions of higher packages, imported at first use
"""
