# SPDX-License-Identifier: Apache-2.0
"""Contact sheets: one image with all buffers of a frame, each above its name."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from tiscene.errors import ArgumentError
from tiscene.frame.visualize import Limits, picture

if TYPE_CHECKING:
    from tiscene.frame.frame import Frame

SHEET_COLOR, NAME_COLOR, CAPTION_COLOR = (16, 17, 21), (236, 236, 230), (140, 144, 152)
GAP = 10  # px between tiles


def contact_sheet(
    frame: Frame,
    buffers: Sequence[str] | None = None,
    *,
    columns: int | None = None,
    tile_width: int = 320,
    limits: Mapping[str, Limits] | None = None,
) -> NDArray[np.uint8]:
    """Draw the buffers of a frame side by side.

    Args:
        frame: The frame.
        buffers: Names of buffers in the order of the tiles; None for all of the frame.
        columns: The number of columns; None for a sheet of about 16:10.
        tile_width: The width to which each buffer is scaled, px.
        limits: Ends of the color scales of some buffers, so that sheets can be compared or animated (see
            `visualize.limits_of`). Other buffers have the limits of this frame.

    Returns:
        uint8 [h, w, 3].

    Raises:
        ArgumentError: `buffers` is empty.
    """
    names = tuple(frame.buffers if buffers is None else buffers)
    if not names:
        raise ArgumentError("buffers=(): a contact sheet needs at least one buffer")
    pictures = [picture(name, frame.buffers[name], (limits or {}).get(name)) for name in names]
    height, width, _ = pictures[0].image.shape
    tile_height = round(tile_width * height / width)
    text_height = max(11, tile_width // 22)
    label_height = text_height + 10
    if columns is None:
        columns = max(1, round(math.sqrt(len(names) * 1.6 * (tile_height + label_height) / tile_width)))
    columns = min(columns, len(names))
    rows = -(-len(names) // columns)

    sheet = Image.new(
        "RGB", (columns * (tile_width + GAP) + GAP, rows * (tile_height + label_height + GAP) + GAP), SHEET_COLOR
    )
    draw = ImageDraw.Draw(sheet)
    bold, plain = ImageFont.load_default(text_height), ImageFont.load_default(max(10, text_height - 3))
    smooth = Image.Resampling.LANCZOS if tile_width < width else Image.Resampling.BICUBIC
    for tile, (name, shown) in enumerate(zip(names, pictures, strict=True)):
        x = GAP + tile % columns * (tile_width + GAP)
        y = GAP + tile // columns * (tile_height + label_height + GAP)
        # Ids and masks are not interpolated: a mixture of two ids would be a third one.
        is_discrete = frame.buffers[name].dtype.kind in "bui" and name != "rgb"
        resampling = Image.Resampling.NEAREST if is_discrete else smooth
        sheet.paste(Image.fromarray(shown.image).resize((tile_width, tile_height), resampling), (x, y))
        baseline = y + tile_height + 5 + text_height
        draw.text((x, baseline), name, NAME_COLOR, bold, anchor="ls")
        available = tile_width - draw.textlength(f"{name}  ", bold)
        if draw.textlength(shown.caption, plain) <= available:
            draw.text((x + tile_width, baseline), shown.caption, CAPTION_COLOR, plain, anchor="rs")
    return np.asarray(sheet)
