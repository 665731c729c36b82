# SPDX-License-Identifier: Apache-2.0
"""Stages that others reference: their units, axes and place, beyond the transform of the prim that references them.

::

    conversion        from the units and axes of one stage to those of another
    converted_values  values of a prim that its transform does not convert
    motion_values     those of tiscene's trajectories
    convert           author them over a referenced prim, also in its variants
    forwarded_variants  variant sets that select those of referenced prims
"""
