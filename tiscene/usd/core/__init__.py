# SPDX-License-Identifier: Apache-2.0
"""What all of `tiscene.usd` builds on.

::

    stage           open a stage
    report          collect problems and warnings
    limits          limits of time, memory and location
    layers          files of a stage and their digests
    package         paths into .usdz packages
    transform       matrices
    units           stage units and meters
    pose            positions and rotations as transform ops
    semantics       semantic labels and object identity
    time_samples    animated parts and instances
    keyframes       animated objects as keyframes and lifespans
    shader_network  connections between shaders
    schema          the codeless schema TisceneMotionAPI
"""
