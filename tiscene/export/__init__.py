# SPDX-License-Identifier: Apache-2.0
"""Frames to files: `export` writes frames of a stream into a folder, in one of several formats.

::

    exporter        export
    formats         FORMATS: the registry of formats
    manifest        tiscene.json: provenance, and digests of frames, buffers and files
    manifest_difference  settings that keep an export from being continued
    folder_writer   frames of one export into its folder
    encoding_threads  frames written while the next ones are rendered
    packing         files of many frames from the pieces of each
    packing_thread  such files written while later frames are rendered
    shards, merging  exports in parts, and one export of them
    verification    files as recorded, frames that render as recorded
    manifest_stream  the stream of an export, from its manifest
    array_files     arrays and archives as bytes
    sparse_exr      OpenEXR files of channels that are mostly constant
    frame_json      camera, events and objects of a frame
    png, exr, exr_single, npz, cryptomatte, kitti_flow, blenderproc, sailenv_layout  formats with files for each frame
    coco, webdataset_shards, parquet, video, point_tracks, mcap_log, lerobot, rerun_recording  with files of many frames
    sailenv_recorder  recordings of SAILenv's scripts
    focus_of_attention  where a recording's attention is
    contact_sheet   one image of many buffers
    difficulty_plot  measures of difficulty over frames
    animated_image  WebP, GIF and APNG
    preview         a stream as one HTML page
    generation      data sets of many random scenarios, from a recipe
    distributed     one export by several processes or machines

Names are imported at first use, so that the command line can list the formats at once.
"""

from __future__ import annotations

from dynamics.lazy_names import lazy_names

_MODULES = {
    "tiscene.export.exporter": ("export", "provenance"),
    "tiscene.export.formats": ("FORMATS", "Format", "register_format"),
    "tiscene.export.manifest": ("Manifest",),
    "tiscene.export.merging": ("merge",),
    "tiscene.export.verification": ("verify",),
}
__getattr__, __dir__, __all__ = lazy_names(__name__, _MODULES)
