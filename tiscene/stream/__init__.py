# SPDX-License-Identifier: Apache-2.0
"""Streams: one frame after another, by iteration or by index.

::

    stream          Stream
    stream_interface  a Stream as the modules below see it
    frame_slice     the frames of `stream[a:b]`
    frame_batches   several frames rendered at once
    view_renderer   render views of a world; owns the device arrays
    shutter         sample times while the shutter is open (motion blur)
    fixed_settings  settings that cannot be changed
    stage_cache     stages that were read last
    bvh_cache       trees of those stages
    render_ahead    render the next frames in a worker process
    loaders         data sets of PyTorch, Grain and Hugging Face
    stream_output   methods for USD programs and notebooks
    motion_recording  what a world shows at some frames, for USD layers
    loading         read a stage while kernels compile
    saved_state     check of saved states
    progress        default progress bar
"""
