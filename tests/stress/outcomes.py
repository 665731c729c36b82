# SPDX-License-Identifier: Apache-2.0
"""Results of hard use, and the table that shows them."""

from __future__ import annotations

from dataclasses import dataclass

HEADER = "| Row | Use | Figures | Held |\n|---|---|---|---|"


@dataclass(frozen=True)
class Outcome:
    """One hard use and how it ended.

    Attributes:
        use: What was done, with counts.
        figures: What was measured, or the first failures.
        held: Whether tiscene kept what docs/dev/hard-use.md promises.
    """

    use: str
    figures: str
    held: bool


def table_line(row: str, outcome: Outcome) -> str:
    """Return an outcome as a line of a Markdown table below HEADER."""
    cells = (row, outcome.use, outcome.figures, "yes" if outcome.held else "**no**")
    return "| " + " | ".join(" ".join(cell.split()).replace("|", "\\|") for cell in cells) + " |"


def count(full: float, scale: float, least: int = 1) -> int:
    """Return a scaled number of repetitions, at least `least`."""
    return max(least, round(full * scale))
