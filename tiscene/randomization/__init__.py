# SPDX-License-Identifier: Apache-2.0
"""Random scenarios drawn from ranges, for `Scenario.sample`.

::

    sampler          draw a scenario
    ranges           the ranges to draw from
    draws            random numbers by seed, object and purpose
    object_placer    find a position or a closed path for an object
    point_pools      random free points: visible, hidden, out of view
    free_space       free balls, lines of sight and reachability in a scene
    template_extent  size of a template
"""
