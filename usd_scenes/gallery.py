"""`python -m usd_scenes.gallery [NAME ...] [--spp N]`: takes the pictures of docs/gallery.md and writes it.

NAME: the beginning of a picture's name, such as "room_01" or "room_01_Main_night", or "table" for the table of labels
in docs/scenes.md; default everything. Slow: minutes for a picture on two cores.
"""

from __future__ import annotations

import argparse
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from PIL import Image

import tiscene as ts
from tiscene.commands.progress import progress
from tiscene.usd import read_stage
from usd_scenes.author.room import LIGHTING
from usd_scenes.author.templates import APPEARANCES

PACKAGE = Path(__file__).resolve().parent
DOCS = PACKAGE.parent / "docs"
IMAGES = DOCS / "images" / "gallery"
TABLE = re.compile(r"\| Scene \| Labels.*?\n(?!\|)", re.DOTALL)
WIDTH, HEIGHT = 960, 720
PLACES = {
    "room_01": ("Main", "SAILenv", "Chest"),
    "room_02": ("Main", "SAILenv", "Dining"),
    "room_03": ("Main", "Basin", "Toilet"),
}
ROOTS = {"room_01": "Room01", "room_02": "Room02", "room_03": "Room03", "solid_benchmark": "SolidBenchmark"}


@dataclass(frozen=True)
class Picture:
    """One photograph. choices: variant set to variant, on the scene's root."""

    scene: str
    camera: str
    choices: dict[str, str] = field(default_factory=dict)

    @property
    def name(self) -> str:
        return "_".join([self.scene, self.camera, *self.choices.values()])

    def take(self, spp: int) -> None:
        """Writes docs/images/gallery/NAME.jpg."""
        variants = {f"/{ROOTS[self.scene]}{{{key}}}": value for key, value in self.choices.items()}
        size = {"width": WIDTH, "height": HEIGHT}
        stream = ts.Stream(
            self.scene, **size, quality="photo", spp=spp, buffers=("rgb",), camera=self.camera, variants=variants
        )
        save(IMAGES / f"{self.name}.jpg", stream[0].rgb)


PICTURES = [
    *(
        Picture(scene, camera, {"lighting": lighting})
        for scene, cameras in PLACES.items()
        for camera in cameras
        for lighting in LIGHTING
    ),
    *(Picture("room_01", "SAILenv", {"appearance": appearance}) for appearance in APPEARANCES[1:]),
    Picture("solid_benchmark", "Main", {"lighting": "day"}),
]


TITLES = {"room_01": "a bedroom", "room_02": "a living room", "room_03": "a bathroom"}
INTRODUCTION = """# Gallery

Written by `python -m usd_scenes.gallery`: path traced at 960 × 720, denoised. This is what a colour camera sees;
nothing is retouched. The pictures here were taken with 8 to 24 paths a pixel, where `quality="photo"`
takes 256. All geometry, cloth and textures are made by the code in
`usd_scenes/author`.
"""
END = """
## Templates

![All templates](images/templates.jpg)

Their names, sizes and colours are on [a page of their own](templates.md).
"""


def page() -> str:
    """docs/gallery.md, with the pictures that there are."""
    blocks = [INTRODUCTION]
    for scene, title in TITLES.items():
        rows = [[Picture(scene, camera, {"lighting": each}) for each in LIGHTING] for camera in PLACES[scene]]
        blocks.append(f"\n## {scene}: {title}\n\n" + _table(LIGHTING, rows))
    first = Picture("room_01", "SAILenv", {"lighting": LIGHTING[0]})
    others = [Picture("room_01", "SAILenv", {"appearance": each}) for each in APPEARANCES[1:]]
    text = "\n## One view in three appearances\n\nThe same places, things and labels.\n\n"
    blocks.append(text + _table(APPEARANCES, [[first, *others]]))
    solids = Picture("solid_benchmark", "Main", {"lighting": LIGHTING[0]})
    blocks.append(f"\n## solid_benchmark: a plain room of solids\n\n{_shown(solids)}\n" + END)
    return "".join(blocks)


def _table(columns: Sequence[str], rows: Sequence[Sequence[Picture]]) -> str:
    lines = [columns, ["---"] * len(columns), *([_shown(picture) for picture in row] for row in rows)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _shown(picture: Picture) -> str:
    file = IMAGES / f"{picture.name}.jpg"
    caption = f"{picture.scene}, {picture.camera}, {', '.join(picture.choices.values())}"
    return f"![{caption}]({file.relative_to(DOCS)})" if file.exists() else "not taken yet"


def save(path: Path, rgb: np.ndarray) -> None:
    """uint8 [h, w, 3] as JPEG."""
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(rgb).save(path, quality=88, subsampling=0, optimize=True)


def labels(scene: str) -> Counter[str]:
    """How many things of each label are on a shipped scene's stage."""
    return Counter(thing.category for thing in read_stage(PACKAGE / scene / "scene.usda").objects if thing.category)


def table() -> str:
    """The labels of every room as a Markdown table."""
    lines = ["| Scene | Labels and how many things have them |", "|---|---|"]
    for scene in ROOTS:
        counts = sorted(labels(scene).items())
        lines.append(f"| `{scene}` | {', '.join(f'{name} {n}' if n > 1 else name for name, n in counts)} |")
    return "\n".join(lines) + "\n"


def write_table() -> None:
    page = DOCS / "scenes.md"
    page.write_text(TABLE.sub(lambda _: table(), page.read_text(encoding="utf-8")), encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m usd_scenes.gallery", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--spp", type=int, default=256, help="paths per pixel (default: %(default)s)")
    arguments = parser.parse_args()
    chosen = [p for p in PICTURES if not arguments.names or p.name.startswith(tuple(arguments.names))]
    if not arguments.names or "table" in arguments.names:
        write_table()
    elif not chosen:
        parser.error(f"no picture begins like that; there are: table, {', '.join(p.name for p in PICTURES)}")
    with progress("gallery", len(chosen)) as step:
        for picture in chosen:
            picture.take(arguments.spp)
            step()
    (DOCS / "gallery.md").write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
