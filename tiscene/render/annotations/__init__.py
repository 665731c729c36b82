# SPDX-License-Identifier: Apache-2.0
"""Per-object annotations: 2D and 3D boxes, pixel counts, amodal masks.

::

    object_measurements  measure the objects of a frame on demand
    measured_property    property that is computed while no other thread renders
    amodal_masks         pixels an object would cover without occluders
    measurement_kernels  kernels of both
"""
