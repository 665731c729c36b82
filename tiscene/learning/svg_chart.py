# SPDX-License-Identifier: Apache-2.0
"""Line charts as SVG, without any library."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

# Colors that people with color vision deficiencies can tell apart (Okabe and Ito, 2008), then gray.
COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#8c6d31", "#999999")
DASHES = ("", "6 3", "2 2")  # after all colors are used
WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 860, 270, 44, 24, 34, 34
LABEL = 100  # px, of the text of a mark

Points = Sequence[tuple[float, float]]


def line_chart(
    lines: Mapping[str, Points],
    *,
    end: int,
    marks: Mapping[int, str],
    colors: Mapping[str, tuple[str, str]],
    label: str,
    bands: Mapping[str, Sequence[tuple[float, float, float]]] | None = None,
) -> str:
    """Return a chart of fractions over frames.

    Args:
        lines: points (frame, fraction 0..1) by name.
        end: number of frames.
        marks: vertical lines by frame, with their texts.
        colors: color and dash pattern by name, as `line_styles` gives.
        label: text for people who cannot see the chart.
        bands: spread by name, (frame, lowest, highest fraction); None: none.
    """

    def x(frame: float) -> float:
        return LEFT + (WIDTH - LEFT - RIGHT) * frame / max(end, 1)

    def y(value: float) -> float:
        return TOP + (HEIGHT - TOP - BOTTOM) * (1.0 - value)

    parts = [f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(label)}">']
    for tenths in range(0, 11, 2):
        value = tenths / 10
        parts.append(f'<line class="grid" x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{y(value):.1f}" y2="{y(value):.1f}"/>')
        parts.append(f'<text x="{LEFT - 6}" y="{y(value) + 4:.1f}" text-anchor="end">{tenths * 10} %</text>')
    for frame in _ticks(end):
        parts.append(f'<text x="{x(frame):.1f}" y="{HEIGHT - 16}" text-anchor="middle">{frame}</text>')
    parts.append(f'<text x="{x(end / 2):.1f}" y="{HEIGHT - 2}" text-anchor="middle">frame</text>')
    last: float = -LABEL
    for frame, text in marks.items():
        raised = x(frame) - last < LABEL  # texts that would overlap stand in two rows
        last = -LABEL if raised else x(frame)
        parts.append(
            f'<line class="mark" x1="{x(frame):.1f}" x2="{x(frame):.1f}" y1="{TOP}" y2="{HEIGHT - BOTTOM}"/>'
            f'<text x="{x(frame) + 3:.1f}" y="{TOP - (18 if raised else 6)}">{escape(text)}</text>'
        )
    for name, rows in (bands or {}).items():
        border = [(frame, low) for frame, low, _ in rows] + [(frame, high) for frame, _, high in reversed(rows)]
        path = " ".join(f"{x(frame):.1f},{y(value):.1f}" for frame, value in border)
        parts.append(f'<polygon fill="{colors[name][0]}" fill-opacity="0.15" points="{path}"/>')
    for name, points in lines.items():
        color, dash = colors[name]
        path = " ".join(f"{x(frame):.1f},{y(value):.1f}" for frame, value in points)
        style = f' stroke-dasharray="{dash}"' if dash else ""
        parts.append(f'<polyline stroke="{color}"{style} points="{path}"><title>{escape(name)}</title></polyline>')
    return "\n".join([*parts, "</svg>"])


def line_styles(names: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Return a color and a dash pattern for each name."""
    count = len(COLORS)
    return {name: (COLORS[row % count], DASHES[row // count % len(DASHES)]) for row, name in enumerate(names)}


def _ticks(end: int) -> range:
    """Return round numbers from 0 to `end`, about eight."""
    size = 1
    while True:
        for step in (size, 2 * size, 5 * size):
            if end / step <= 8:
                return range(0, end + 1, step)
        size *= 10
