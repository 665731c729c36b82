# SPDX-License-Identifier: Apache-2.0
"""Integrators: how pixel values are computed.

::

    labels       one exact ray per pixel
    path         path tracing
    incremental  base image plus changes by movers
"""
