# SPDX-License-Identifier: Apache-2.0
"""Contact sheets of all templates, and of some in their colors and appearances.

`python -m docs.tools.template_sheet [NAME ...]` writes docs/images/templates.jpg, kitchen_templates.jpg and
template_variants.jpg, and the table in docs/templates.md. NAME: one of these files or table; by default all.
"""

from __future__ import annotations

import re
import sys
import tempfile
from collections.abc import Callable, Collection, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

import tiscene as ts
from tiscene.catalog import find_template, template_name
from tiscene.cli.terminal import progress
from usd_scenes.author import studio
from usd_scenes.author.kitchen_templates import KITCHEN_AND_HALL
from usd_scenes.author.templates import APPEARANCES, TEMPLATES, facts

DOCS = Path(__file__).resolve().parents[1]
TABLE = re.compile(r"(?<=<!-- templates -->\n).*?(?=<!-- /templates -->)", re.DOTALL)
VARIED = ("chair_01", "armchair_01", "book_01", "alarm_clock_01", "teddy_bear_01", "plant_01")
BACKGROUND, TEXT = (16, 17, 21), (236, 236, 230)
GAP = 4  # px between tiles
Picture = NDArray[np.uint8]


def photograph(
    template: str, size: int, *, yaw: float = 28.0, spp: int = 64, variants: Mapping[str, str] | None = None
) -> Picture:
    """Render a template in the studio.

    Args:
        template: name of its folder.
        size: width and height, px.
        yaw: degrees about y.
        spp: samples per pixel.
        variants: variant sets to variants; None for the first of each.

    Returns:
        uint8 [size, size, 3], sRGB.
    """
    with tempfile.TemporaryDirectory() as folder:
        stage = Path(folder) / "studio.usda"
        studio.write(find_template(template_name(template)), stage, yaw=yaw, variants=variants)
        stream = ts.Stream(str(stage), width=size, height=size, quality="photo", spp=spp, buffers=("rgb",))
        picture: Picture = stream[0].rgb
    return picture


def contact_sheet(folders: Collection[str], size: int = 232, columns: int = 8) -> Picture:
    """Render a contact sheet of templates.

    Args:
        folders: folders of the templates.
        size: width and height of a tile, px.
        columns: tiles per row.
    """
    tiles = []
    with progress("templates", len(folders)) as step:
        for folder in folders:
            tiles.append((template_name(folder), photograph(folder, size)))
            step()
    return sheet_of(tiles, columns)


def template_variants(size: int = 232) -> Picture:
    """Render a row per template of VARIED: its first three colors, then untextured and as primitives.

    Args:
        size: width and height of a tile, px.
    """
    tiles = []
    with progress("variants", 5 * len(VARIED)) as step:
        for folder in VARIED:
            choices = [("color", color) for color in list(TEMPLATES[folder].colors)[:3]]
            choices += [("appearance", appearance) for appearance in APPEARANCES[1:]]
            for name, choice in choices:
                caption = f"{template_name(folder)}: {choice}"
                tiles.append((caption, photograph(folder, size, variants={name: choice})))
                step()
    return sheet_of(tiles, 5)


def table() -> str:
    """Return the templates as a Markdown table."""
    lines = ["| Template | Label | Size, m | Parts | Colors |", "|---|---|---|---|---|"]
    for folder, template in TEMPLATES.items():
        name = template_name(folder)
        label, lengths, parts = facts(find_template(name))
        size = " × ".join(f"{length:.2g}" for length in lengths)
        lines.append(f"| {name} | {label} | {size} | {', '.join(parts)} | {', '.join(template.colors)} |")
    return "\n".join(lines) + "\n"


def write_table() -> None:
    """Update the table in docs/templates.md."""
    page = DOCS / "templates.md"
    text = page.read_text(encoding="utf-8")
    page.write_text(TABLE.sub(lambda _: table(), text), encoding="utf-8")


def sheet_of(tiles: list[tuple[str, Picture]], columns: int) -> Picture:
    """Return pictures of one size side by side, each with its caption below.

    Args:
        tiles: caption and picture, uint8 [size, size, 3].
        columns: tiles per row.
    """
    size, line = tiles[0][1].shape[0], 20
    rows = -(-len(tiles) // columns)
    sheet = Image.new("RGB", (columns * (size + GAP) + GAP, rows * (size + line + GAP) + GAP), BACKGROUND)
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(13)
    for index, (caption, picture) in enumerate(tiles):
        x, y = GAP + index % columns * (size + GAP), GAP + index // columns * (size + line + GAP)
        sheet.paste(Image.fromarray(picture), (x, y))
        draw.text((x + 4, y + size + 2), caption, TEXT, font)
    return np.asarray(sheet)


def save(path: Path, rgb: Picture, comment: str = "") -> None:
    """Write a JPEG file atomically.

    Args:
        path: file to write; missing folders are created.
        rgb: uint8 [h, w, 3], sRGB.
        comment: comment to store in the file.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    Image.fromarray(rgb).save(part, "JPEG", quality=88, subsampling=0, optimize=True, comment=comment)
    part.replace(path)


SHEETS: dict[str, Callable[[], Picture]] = {
    "templates.jpg": lambda: contact_sheet([each for each in TEMPLATES if each not in KITCHEN_AND_HALL]),
    "kitchen_templates.jpg": lambda: contact_sheet(KITCHEN_AND_HALL, columns=6),
    "template_variants.jpg": template_variants,
}

if __name__ == "__main__":
    for name in sys.argv[1:] or [*SHEETS, "table"]:
        if name == "table":
            write_table()
        else:
            save(DOCS / "images" / name, SHEETS[name]())
