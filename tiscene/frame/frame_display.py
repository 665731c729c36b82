# SPDX-License-Identifier: Apache-2.0
"""FrameDisplay: the methods of Frame that make pictures, for files, windows and notebooks."""

from __future__ import annotations

import base64
import io
import os
import sys
import warnings
from collections.abc import Iterator, Mapping
from html import escape
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tiscene.errors import ArgumentError, counted, export_errors
from tiscene.files import write_atomically
from tiscene.frame.object_table import ObjectTable
from tiscene.frame.visualize import Picture, id_colors, picture, sailenv_flow_picture

IDS = ("semantic", "instance", "part")
FLOW_COLORS = ("middlebury", "sailenv")
LISTED_OBJECTS = 30  # rows of the table in a notebook
# Arguments of PIL.Image.save by suffix.
FILES: dict[str, dict[str, Any]] = {
    ".png": {"format": "png", "compress_level": 4},
    ".jpg": {"format": "jpeg", "quality": 92},
    ".jpeg": {"format": "jpeg", "quality": 92},
    ".webp": {"format": "webp", "lossless": True},
}


class DisplayedFrame(Protocol):
    """What displaying needs of a Frame."""

    @property
    def index(self) -> int: ...
    @property
    def time(self) -> float: ...
    @property
    def buffers(self) -> Mapping[str, NDArray[Any]]: ...
    @property
    def objects(self) -> ObjectTable: ...
    @property
    def views(self) -> Mapping[str, Any]: ...
    def __getitem__(self, name: str, /) -> NDArray[Any]: ...


class FrameDisplay:
    """Pictures of a frame."""

    def picture(
        self: DisplayedFrame, buffer: str | None = None, *, flow_colors: str = "middlebury"
    ) -> NDArray[np.uint8]:
        """Return a picture of a buffer: uint8 [height, width, 3].

        Args:
            buffer: its name; None: "rgb" if the frame has it, else its first buffer.
            flow_colors: colors of flow: "middlebury" (the color wheel of optical flow benchmarks) or "sailenv" (those
                of SAILenv's `draw_flow_map`).

        Raises:
            BufferNotFound: the frame has no such buffer.
            ArgumentError: unknown `flow_colors`.
        """
        return _picture(self, _shown(self, buffer), flow_colors).image

    def save(
        self: DisplayedFrame,
        path: str | os.PathLike[str],
        buffer: str | None = None,
        *,
        flow_colors: str = "middlebury",
    ) -> None:
        """Write a picture of a buffer for people to look at; `tiscene.export` writes exact data.

        A PNG of ids up to 255 is an indexed image: its pixels are the ids, its palette has their colors.

        Args:
            path: of the file, whose folder is made if it is missing; the suffix .png, .jpg or .webp decides the format.
            buffer: as of `picture`.
            flow_colors: as of `picture`.

        Raises:
            BufferNotFound: the frame has no such buffer.
            ArgumentError: another suffix, or unknown `flow_colors`.
            ExportError: the file cannot be written.
        """
        path = Path(path)
        if path.suffix.lower() not in FILES:
            raise ArgumentError(f"{str(path)!r}: the suffix must be one of {', '.join(FILES)}")
        name = _shown(self, buffer)
        image = Image.fromarray(_picture(self, name, flow_colors).image)
        if name in IDS and path.suffix.lower() == ".png" and self[name].min() >= 0 and self[name].max() <= 255:
            image = Image.fromarray(self[name].astype(np.uint8), "L")
            image.putpalette(id_colors(np.arange(256)).tobytes())
        data = io.BytesIO()
        image.save(data, **FILES[path.suffix.lower()])
        with export_errors(path):
            write_atomically(path, data.getvalue())

    def show(self: DisplayedFrame, buffer: str | None = None, *, flow_colors: str = "middlebury") -> None:
        """Show a picture of a buffer: below the cell in a notebook, else in the desktop's picture viewer.

        Without a display it warns.

        Args:
            buffer: as of `picture`.
            flow_colors: as of `picture`.
        """
        image = Image.fromarray(_picture(self, _shown(self, buffer), flow_colors).image)
        if _in_notebook():
            from IPython.display import display

            display(image)
        else:
            from PIL import ImageShow  # looks for viewers when it is imported

            title = f"frame {self.index}"
            if not (has_display() and ImageShow.show(image, title)):
                text = f"{title} is not shown: there is no display or picture viewer."
                advice = "`frame.save('frame.png')` writes a file, `tiscene preview` a page for browsers."
                warnings.warn(f"{text} {advice}", stacklevel=2)

    def _repr_png_(self: DisplayedFrame) -> bytes:
        return _png(_picture(self, _shown(self, None)).image)

    def _repr_html_(self: DisplayedFrame) -> str:
        """Return pictures of all buffers and a table of the visible objects, for notebooks."""
        parts = [f"<b>Frame {self.index}</b> at {self.time:.3f} s"]
        for camera, view in self.views.items():
            if len(self.views) > 1:
                parts.append(f"<div>{escape(camera)}</div>")
            parts.append('<div style="display:flex;flex-wrap:wrap;gap:8px;margin:4px 0">')
            parts += [_figure(name, _picture(view, name)) for name in view.buffers]
            parts.append("</div>")
        return "".join([*parts, *_object_rows(self.objects)])


def _shown(frame: DisplayedFrame, buffer: str | None) -> str:
    if buffer is None:
        return "rgb" if "rgb" in frame.buffers else next(iter(frame.buffers))
    frame[buffer]  # raises BufferNotFound
    return buffer


def _picture(frame: DisplayedFrame, name: str, flow_colors: str = "middlebury") -> Picture:
    if flow_colors not in FLOW_COLORS:
        raise ArgumentError(f"flow_colors={flow_colors!r}: must be one of {', '.join(FLOW_COLORS)}")
    if flow_colors == "sailenv" and name in ("forward_flow", "backward_flow"):
        return Picture(sailenv_flow_picture(frame[name], backward=name == "backward_flow"), "colors of SAILenv")
    return picture(name, frame[name])


def _png(pixels: NDArray[np.uint8]) -> bytes:
    data = io.BytesIO()
    Image.fromarray(pixels).save(data, **FILES[".png"])
    return data.getvalue()


def _figure(name: str, shown: Picture) -> str:
    source = base64.b64encode(_png(shown.image)).decode()
    return (
        f'<figure style="margin:0"><img src="data:image/png;base64,{source}" alt="{name}" '
        f'style="image-rendering:pixelated;max-width:320px"><figcaption><code>{name}</code> '
        f"<small>{escape(shown.caption)}</small></figcaption></figure>"
    )


def _object_rows(objects: ObjectTable) -> Iterator[str]:
    """Yield the parts of a table of the visible objects, largest first."""
    visible = sorted((row for row in objects if row.visible_pixels), key=lambda row: -row.visible_pixels)
    yield f"<details><summary>Visible: {len(visible)} of {counted(len(objects), 'object')}</summary><table>"
    yield "<tr><th>id</th><th>name</th><th>category</th><th>pixels</th><th>position, m</th></tr>"
    for row in visible[:LISTED_OBJECTS]:
        position = ", ".join(f"{value:.2f}" for value in row.position)
        cells = (row.id, row.name, row.category, row.visible_pixels, position)
        yield "<tr>" + "".join(f"<td>{escape(str(cell))}</td>" for cell in cells) + "</tr>"
    if len(visible) > LISTED_OBJECTS:
        yield f"<tr><td colspan=5>and {len(visible) - LISTED_OBJECTS} more: frame.objects has all</td></tr>"
    yield "</table></details>"


def has_display() -> bool:
    """Return whether windows can open; a picture viewer that cannot open one fails without an error."""
    return sys.platform in ("darwin", "win32") or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))


def _in_notebook() -> bool:
    """Return whether a kernel of Jupyter runs this code."""
    try:
        shell = get_ipython()  # type: ignore[name-defined]  # IPython adds it to the builtins
    except NameError:
        return False
    return hasattr(shell, "kernel")
