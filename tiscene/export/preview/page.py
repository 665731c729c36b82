# SPDX-License-Identifier: Apache-2.0
"""write_preview: frames of a stream as one HTML page that needs no network."""

from __future__ import annotations

import json
import os
import re
import tempfile
from collections.abc import Callable
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tiscene.errors import ArgumentError, export_errors
from tiscene.export.preview.buffer_codec import ValueEncoder
from tiscene.export.preview.frame_choice import frame_indices, page_buffers, sampled_frames
from tiscene.export.preview.object_tracks import ObjectTracks
from tiscene.files import write_atomically
from tiscene.frame.frame import Frame

if TYPE_CHECKING:
    from tiscene.stream.stream import Stream

FOLDER = Path(__file__).parent
SUFFIXES = (".html", ".htm")
SCRIPTS = ("values.js", "plan.js", "charts.js", "player.js")


def write_preview(
    stream: Stream,
    path: str | os.PathLike[str],
    *,
    frames: range | None = None,
    progress: Callable[[int], None] | None = None,
) -> None:
    """Write a page that plays frames of a stream: pictures of all buffers, values under the cursor, objects, motion.

    The page is one file without references to others. It has about 100 kB for each frame of 256 x 192 with six buffers.

    Args:
        stream: the source of frames; its position stays.
        path: the page, a file that ends in .html or .htm.
        frames: indices of its frames; None: all of a finite stream, the first 100 of an endless one.
        progress: called with the index of each frame after it was rendered.

    Raises:
        ArgumentError: another suffix, or the stream does not have these frames.
        ExportError: the page cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES and not path.is_dir():
        raise ArgumentError(f"{str(path)!r}: a page is a file that ends in {' or '.join(SUFFIXES)}")
    frames = frame_indices(stream, frames)
    with export_errors(path):  # before minutes of rendering
        if path.is_dir():
            raise IsADirectoryError("it is a folder")
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    page = page_of(stream, frames, progress)
    with export_errors(path):
        write_atomically(path, page.encode())


def page_of(stream: Stream, frames: range, progress: Callable[[int], None] | None = None) -> str:
    """Return the page; arguments as of `write_preview`."""
    samples = sampled_frames(stream, frames)
    buffers = page_buffers(stream.buffers, samples)
    tracks = ObjectTracks()
    cameras: dict[str, dict[str, Any]] = {}
    encoders: dict[tuple[str, str], ValueEncoder] = {}
    last: Frame | None = None
    for index in frames:
        frame = samples.pop(index, None) or stream[index]
        tracks.add(frame)
        for name, view in frame.views.items():
            if name not in cameras:
                cameras[name] = {"name": name, "pictures": {}, "values": {}}
                encoders |= {(name, each.buffer.name): ValueEncoder(each) for each in buffers if each.has_values}
            for each in buffers:
                buffer = each.buffer.name
                cameras[name]["pictures"].setdefault(buffer, []).append(each.picture(view[buffer]))
                if encoder := encoders.get((name, buffer)):
                    cameras[name]["values"].setdefault(buffer, []).append(encoder.encode(view[buffer]))
        if progress is not None:
            progress(index)
        last = frame
    assert last is not None
    content = {
        "scene": stream.scenario.scene,
        "fps": stream.fps,
        "width": stream.width,
        "height": stream.height,
        "frames": list(frames),
        "buffers": [each.to_json(last[each.buffer.name]) for each in buffers],
        "categories": dict(stream.categories),
        "materials": dict(last.materials),
        "cameras": list(cameras.values()),
        **tracks.to_json(),
    }
    return _assembled(content)


def _assembled(content: dict[str, Any]) -> str:
    """Return the page with its style, scripts and content."""
    data = json.dumps(content, separators=(",", ":"), allow_nan=False)
    for character in "<>&\u2028\u2029":  # so that no text ends the script element
        data = data.replace(character, f"\\u{ord(character):04x}")
    parts = {
        "title": escape(f"{content['scene']}: tiscene preview"),
        "style": _text("player.css"),
        "content": data,
        "script": "\n".join(map(_text, SCRIPTS)),
    }
    # In one pass: names of objects may look like placeholders.
    return re.sub(r"\{\{(\w+)\}\}", lambda place: parts[place[1]], _text("player.html"))


def _text(name: str) -> str:
    return (FOLDER / name).read_text(encoding="utf-8")
