# SPDX-License-Identifier: Apache-2.0
"""Scenarios on USD stages.

::

    read                scenario authored on a stage
    write               scenario as a layer over its scene
    motion_schema       trajectories as attributes of TisceneMotionAPI
    layer               layers over a scene: references, cameras, poses
    bake                a stream's motion as time samples
    light_time_samples  animated lights, both ways
"""
