# SPDX-License-Identifier: Apache-2.0
"""Frames to files: `export` writes frames of a stream into a folder, in one of several formats.

::

    exporter        export
    manifest        tiscene.json: provenance, and digests of frames, buffers and files
    manifest_difference  settings that keep an export from being continued
    png             one file per buffer
    exr             multi-part OpenEXR
    npz             NumPy archives
    cryptomatte     object and material mattes
    sailenv_layout  the layout of SAILenv's recordings
    frame_json      camera, events and objects of a frame
    contact_sheet   one image of many buffers
    animated_image  WebP, GIF and APNG
"""

from tiscene.export.exporter import EXPORTERS, REQUIRED_BUFFERS, SUMMARIES, export, provenance
from tiscene.export.manifest import Manifest

__all__ = ["EXPORTERS", "REQUIRED_BUFFERS", "SUMMARIES", "Manifest", "export", "provenance"]
