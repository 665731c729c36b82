# SPDX-License-Identifier: Apache-2.0
"""Integrators, which compute pixel values: labels, path tracing, incremental rendering.

::

    labels       one exact ray per pixel center
    path         path tracing with next-event estimation
    incremental  base image of the static scene, corrected where movers change its light
    panorama     the same for a camera that turns or walks, over panoramas of its surroundings
"""
