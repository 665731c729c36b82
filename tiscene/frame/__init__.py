# SPDX-License-Identifier: Apache-2.0
"""Frames: the buffers, object table and events that a stream hands out.

::

    frame         Frame and FrameCamera
    difficulty    measures of how hard a frame is
    buffers       registry of per-pixel buffers: name, type, unit, background
    object_table  one row per live object, with boxes and visibility
    measurements  the measurements of objects that the table has
    events        spawn, despawn, contact, overlap, enter, leave
    visualize     buffers as images
    frame_display  pictures of a frame for files, windows and notebooks
"""
