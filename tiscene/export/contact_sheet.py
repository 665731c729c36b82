# SPDX-License-Identifier: Apache-2.0
"""One picture of many buffers, each under its name."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from tiscene.errors import ArgumentError
from tiscene.export.visualize import Limits, picture

if TYPE_CHECKING:
    from tiscene.frame.frame import Frame

PAPER, INK, FAINT_INK = (16, 17, 21), (236, 236, 230), (140, 144, 152)
GAP = 10  # px between tiles


def contact_sheet(
    frame: Frame,
    buffers: Sequence[str] | None = None,
    *,
    columns: int | None = None,
    tile_width: int = 320,
    limits: Mapping[str, Limits] | None = None,
) -> NDArray[np.uint8]:
    """The buffers of a frame side by side, uint8 [h, w, 3].

    buffers: which, in this order; None for all that the frame holds. columns: None for a sheet of about 16:10.
    tile_width: px, to which every buffer is scaled. limits: the ends of the colors for some buffers, for sheets that
    are to be compared or animated (`visualize.limits_of`); the others take this frame's own.
    """
    names = tuple(frame.buffers if buffers is None else buffers)
    if not names:
        raise ArgumentError("buffers=(): a contact sheet needs one at least")
    pictures = [picture(name, frame.buffers[name], (limits or {}).get(name)) for name in names]
    height, width, _ = pictures[0].image.shape
    tile_height = round(tile_width * height / width)
    text = max(11, tile_width // 22)
    label_height = text + 10
    if columns is None:
        columns = max(1, round(math.sqrt(len(names) * 1.6 * (tile_height + label_height) / tile_width)))
    columns = min(columns, len(names))
    rows = -(-len(names) // columns)

    sheet = Image.new(
        "RGB", (columns * (tile_width + GAP) + GAP, rows * (tile_height + label_height + GAP) + GAP), PAPER
    )
    draw = ImageDraw.Draw(sheet)
    bold, plain = ImageFont.load_default(text), ImageFont.load_default(max(10, text - 3))
    smooth = Image.Resampling.LANCZOS if tile_width < width else Image.Resampling.BICUBIC
    for place, (name, shown) in enumerate(zip(names, pictures, strict=True)):
        x = GAP + place % columns * (tile_width + GAP)
        y = GAP + place // columns * (tile_height + label_height + GAP)
        # Ids and masks keep their hard edges; a blend of two ids would be a third.
        hard = frame.buffers[name].dtype.kind in "bui" and name != "rgb"
        how = Image.Resampling.NEAREST if hard else smooth
        sheet.paste(Image.fromarray(shown.image).resize((tile_width, tile_height), how), (x, y))
        baseline = y + tile_height + 5 + text
        draw.text((x, baseline), name, INK, bold, anchor="ls")
        room = tile_width - draw.textlength(f"{name}  ", bold)
        if draw.textlength(shown.caption, plain) <= room:
            draw.text((x + tile_width, baseline), shown.caption, FAINT_INK, plain, anchor="rs")
    return np.asarray(sheet)
