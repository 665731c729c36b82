# SPDX-License-Identifier: Apache-2.0
"""Frames to files.

::

    exporter        export
    manifest        tiscene.json: contents of a folder, digests, settings
    png             one file per buffer
    exr             multi-part OpenEXR
    npz             NumPy archives
    cryptomatte     object and material mattes
    sailenv_layout  the layout of SAILenv's recordings
    frame_json      camera, events and objects of a frame
    visualize       buffers as pictures
    contact_sheet   one picture of many buffers
    animated_image  WebP, GIF and APNG
"""

from tiscene.export.exporter import EXPORTERS, NEEDED, SUMMARIES, export, made_by
from tiscene.export.manifest import Manifest

__all__ = ["EXPORTERS", "NEEDED", "SUMMARIES", "Manifest", "export", "made_by"]
