# SPDX-License-Identifier: Apache-2.0
"""Streams: one frame after another, by iteration or by index.

::

    stream       Stream
    frame_slice  the frames of `stream[a:b]`
    loading      read the stage while kernels compile
    incremental  decide which frames are rendered incrementally
    progress      default progress bar
    shutter      sample times while the shutter is open (motion blur)
"""
