# SPDX-License-Identifier: Apache-2.0
"""Light cache: light that arrives on surfaces of the static scene, for cameras that move.

::

    cells               what a cell is, its key, and looking cells up in the hash table
    wide_lobes          reflectance of a material for uniform light
    missing_cells       find the cells that a frame needs and the table lacks
    fill_kernels        paths that leave a cell's surface, and their mean
    light_cache         the table of one static scene, filled as needed
    frame_batch         paths of a frame that use the cache
    moving_camera_pass  radiance of a frame from the cache, corrected where movers change it
    mover_paths         which paths movers change, and adding the change

A cell's light is a function of the static scene, its lights, the seed and the cell's key. It does not matter which
frame needed it first.
"""
