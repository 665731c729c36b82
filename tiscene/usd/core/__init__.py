# SPDX-License-Identifier: Apache-2.0
"""Foundations of `tiscene.usd`: opening stages, reports, limits, units, transforms, semantics and time samples.

::

    stage           open a stage, select variants
    report          collect problems and omissions
    broken_prims    prims whose bounds cannot be computed
    limits          limits of size, time, memory and location
    prims           traversal, ancestors and instances of prims
    shown_prims     which prims are drawn at some time
    layers          files of a stage and their digests; layers to files
    package         paths into .usdz packages
    transform       matrices
    units           stage units and meters
    pose            positions and rotations as transform operations
    semantics       semantic labels and object identity
    content         keys of equal arrays and values
    color_space     conversion of colors to linear Rec. 709
    value_times     time samples, value blocks and splines of attributes
    time_samples    animation within objects as instance tracks
    keyframes       animation of whole objects as keyframes and lifespans
    shader_network  connections between shaders
    schema          the codeless schema of scenarios
"""
