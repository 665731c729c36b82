# SPDX-License-Identifier: Apache-2.0
"""Plots of the difficulty of frames: one panel for each measure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from tiscene.export.array_files import png
from tiscene.frame.difficulty import MEASURES, Difficulty

UNITS = {"motion": "px/frame", "novelty": "degrees"}
WIDTH, HEIGHT = 420, 150  # px, of a panel
LEFT, TOP, RIGHT, BOTTOM = 58, 28, 14, 24
PAPER, INK, GRID, CURVE = (255, 255, 255), (60, 60, 60), (226, 226, 226), (0, 114, 178)


def difficulty_plot(frames: Sequence[int], measured: Sequence[Difficulty], *, scale: int = 2) -> bytes:
    """Draw the measures that have values over the frames.

    Args:
        frames: frame indices, ascending.
        measured: the difficulty of each.
        scale: pixels per unit of the drawing.

    Returns:
        A PNG file.
    """
    names = [name for name in MEASURES if any(getattr(each, name) is not None for each in measured)]
    columns = 2
    rows = -(-len(names) // columns)
    image = Image.new("RGB", (columns * WIDTH * scale, max(rows, 1) * HEIGHT * scale), PAPER)
    draw = ImageDraw.Draw(image)
    for number, name in enumerate(names):
        corner = number % columns * WIDTH, number // columns * HEIGHT
        _panel(draw, corner, name, frames, [getattr(each, name) for each in measured], scale)
    return png(np.asarray(image))


def _panel(
    draw: ImageDraw.ImageDraw,
    corner: tuple[int, int],
    name: str,
    frames: Sequence[int],
    values: Sequence[float | None],
    scale: int,
) -> None:
    """Draw one measure; missing values interrupt its curve."""
    font = ImageFont.load_default(11 * scale)
    top = _round_up(max(value for value in values if value is not None))
    first, last = frames[0], max(frames[-1], frames[0] + 1)

    def at(frame: float, value: float) -> tuple[float, float]:
        x = corner[0] + LEFT + (WIDTH - LEFT - RIGHT) * (frame - first) / (last - first)
        y = corner[1] + TOP + (HEIGHT - TOP - BOTTOM) * (1.0 - value / top)
        return x * scale, y * scale

    unit = f", {UNITS[name]}" if name in UNITS else ""
    title = corner[0] + LEFT, corner[1] + 6
    draw.text((title[0] * scale, title[1] * scale), f"{name}{unit}", INK, font)
    for part in (0.0, 0.5, 1.0):
        start, end = at(first, part * top), at(last, part * top)
        draw.line([start, end], GRID, scale)
        draw.text((start[0] - 6 * scale, start[1]), f"{part * top:g}", INK, font, anchor="rm")
    for frame, anchor in ((first, "lt"), (last, "rt")):
        x, y = at(frame, 0.0)
        draw.text((x, y + 6 * scale), f"frame {frame}", INK, font, anchor=anchor)
    run: list[tuple[float, float]] = []
    for frame, value in (*zip(frames, values, strict=True), (last, None)):
        if value is not None:
            run.append(at(frame, value))
            continue
        if len(run) == 1:
            x, y = run[0]
            draw.ellipse((x - 2 * scale, y - 2 * scale, x + 2 * scale, y + 2 * scale), CURVE)
        elif run:
            draw.line(run, CURVE, 2 * scale, joint="curve")
        run = []


def _round_up(value: float) -> float:
    """Return the least of 1, 2 and 5 times a power of ten that is not below a value; 1 for 0."""
    if value <= 0.0:
        return 1.0
    size = 10.0 ** np.floor(np.log10(value))
    return float(next(size * each for each in (1, 2, 5, 10) if size * each >= value * (1.0 - 1e-12)))
