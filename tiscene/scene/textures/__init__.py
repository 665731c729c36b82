# SPDX-License-Identifier: Apache-2.0
"""Textures as device arrays.

::

    atlas    all images of a scene in flat arrays
    mipmaps  images at half, quarter, ... resolution
"""
