# SPDX-License-Identifier: Apache-2.0
"""A look at a stream: one HTML page that plays frames, with the exact values under the cursor.

::

    page            write_preview: from a stream to the page
    buffer_codec    pictures and values of buffers, as the page stores them
    object_tracks   objects over time: positions, visibility, difficulty
    frame_choice    buffers and frames of a page

The page is `player.html` with `player.css`, and the scripts `values.js`, `plan.js`, `charts.js` and `player.js`.
"""

from tiscene.export.preview.page import write_preview

__all__ = ["write_preview"]
