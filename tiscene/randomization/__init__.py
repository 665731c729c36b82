# SPDX-License-Identifier: Apache-2.0
"""Random scenarios drawn from ranges, for `Scenario.sample`.

::

    sampler     draw a scenario
    ranges      the ranges to draw from
    free_space  find room for objects in a camera's view
"""
