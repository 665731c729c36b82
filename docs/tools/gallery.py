# SPDX-License-Identifier: Apache-2.0
"""`python -m docs.tools.gallery [NAME ...] [--spp N]`: takes the pictures of docs/gallery.md and writes it.

NAME: the beginning of a picture's name, such as "room_01" or "room_01_Main_night", or "table" for the table of labels
in docs/scenes.md; default everything. Slow: minutes for a picture on two cores. May be interrupted: pictures that were
taken of the scene as it is, with as many paths or more, are not taken again.
"""

from __future__ import annotations

import argparse
import hashlib
import re
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from PIL import Image

import tiscene as ts
from docs.tools.template_sheet import save
from tiscene.cli.terminal import note
from tiscene.usd.read.stage_reader import read_stage
from usd_scenes.author.room import LIGHTING
from usd_scenes.author.templates import APPEARANCES

DOCS = Path(__file__).resolve().parents[1]
PACKAGE = DOCS.parent / "usd_scenes"
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
class GalleryPicture:
    """One photograph. choices: variant set to variant, on the scene's root."""

    scene: str
    camera: str
    choices: dict[str, str] = field(default_factory=dict)

    @property
    def name(self) -> str:
        return "_".join([self.scene, self.camera, *self.choices.values()])

    @property
    def file(self) -> Path:
        return IMAGES / f"{self.name}.jpg"

    @property
    def paths(self) -> int:
        """How many paths a pixel it was taken with; 0 if it was not, or not of the scene as it is now."""
        if not self.file.exists():
            return 0
        with Image.open(self.file) as picture:
            comment = picture.info.get("comment", b"").decode()
        paths, _, scene = comment.partition(" paths a pixel of ")
        return int(paths) if scene == digest(self.scene) else 0

    def take(self, spp: int) -> None:
        """Writes docs/images/gallery/NAME.jpg."""
        variants = {f"/{ROOTS[self.scene]}{{{key}}}": value for key, value in self.choices.items()}
        size = {"width": WIDTH, "height": HEIGHT}
        stream = ts.Stream(
            self.scene, **size, quality="photo", spp=spp, buffers=("rgb",), camera=self.camera, variants=variants
        )
        save(self.file, stream[0].rgb, f"{spp} paths a pixel of {digest(self.scene)}")


PICTURES = [
    *(
        GalleryPicture(scene, camera, {"lighting": lighting})
        for scene, cameras in PLACES.items()
        for camera in cameras
        for lighting in LIGHTING
    ),
    *(GalleryPicture("room_01", "SAILenv", {"appearance": appearance}) for appearance in APPEARANCES[1:]),
    GalleryPicture("solid_benchmark", "Main", {"lighting": "day"}),
]


TITLES = {"room_01": "a bedroom", "room_02": "a living room", "room_03": "a bathroom"}
INTRODUCTION = """# Gallery

Written by `python -m docs.tools.gallery`: path traced at 960 × 720, denoised. This is what a color camera sees;
nothing is retouched. PATHS All geometry, cloth and textures are made by the code in
`usd_scenes/author`. Models of other people in these rooms are on [a page of their own](imported.md).
"""
END = """
## Templates

![All templates](images/templates.jpg)

Their names, sizes and colors are on [a page of their own](templates.md).
"""


def page() -> str:
    """docs/gallery.md, with the pictures that there are."""
    blocks = [INTRODUCTION.replace("PATHS", _quality())]
    for scene, title in TITLES.items():
        rows = [[GalleryPicture(scene, camera, {"lighting": each}) for each in LIGHTING] for camera in PLACES[scene]]
        blocks.append(f"\n## {scene}: {title}\n\n" + _table(LIGHTING, rows))
    first = GalleryPicture("room_01", "SAILenv", {"lighting": LIGHTING[0]})
    others = [GalleryPicture("room_01", "SAILenv", {"appearance": each}) for each in APPEARANCES[1:]]
    text = "\n## One view in three appearances\n\nThe same places, things and labels.\n\n"
    blocks.append(text + _table(APPEARANCES, [[first, *others]]))
    solids = GalleryPicture("solid_benchmark", "Main", {"lighting": LIGHTING[0]})
    blocks.append(f"\n## solid_benchmark: a plain room of solids\n\n{_shown(solids)}\n" + END)
    return "".join(blocks)


def _quality() -> str:
    counts = sorted({paths for picture in PICTURES if (paths := picture.paths)})
    if not counts:
        return "The pictures are of earlier rooms."
    range_ = f"{counts[0]} paths" if len(counts) == 1 else f"{counts[0]} to {counts[-1]} paths"
    older = "" if all(picture.paths for picture in PICTURES) else ", some of them of an earlier state of the rooms"
    return f'The pictures here were taken with {range_} a pixel{older}; `quality="photo"` takes 256.'


def _table(columns: Sequence[str], rows: Sequence[Sequence[GalleryPicture]]) -> str:
    lines = [columns, ["---"] * len(columns), *([_shown(picture) for picture in row] for row in rows)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _shown(picture: GalleryPicture) -> str:
    caption = f"{picture.scene}, {picture.camera}, {', '.join(picture.choices.values())}"
    return f"![{caption}]({picture.file.relative_to(DOCS)})" if picture.file.exists() else "not taken yet"


@cache
def digest(scene: str) -> str:
    """Of a scene's own files and of the templates and textures that it names: the same as long as it looks the same."""
    folder = PACKAGE / scene
    files = {path for path in folder.iterdir() if path.is_file()}
    for name in re.findall(r"@\.\./([^@]+)@", (folder / "scene.usda").read_text(encoding="utf-8")):
        path = PACKAGE / name
        files |= set(path.parent.iterdir()) if path.suffix == ".usda" else {path}
    sums = "".join(hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(files))
    return hashlib.sha256(sums.encode()).hexdigest()[:16]


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


def write_page() -> None:
    (DOCS / "gallery.md").write_text(page(), encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m docs.tools.gallery", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--spp", type=int, default=256, help="paths per pixel (default: %(default)s)")
    arguments = parser.parse_args()
    chosen = [p for p in PICTURES if not arguments.names or p.name.startswith(tuple(arguments.names))]
    if not arguments.names or "table" in arguments.names:
        write_table()
    elif not chosen:
        parser.error(f"no picture begins like that; there are: table, {', '.join(p.name for p in PICTURES)}")
    missing = [picture for picture in chosen if picture.paths < arguments.spp]
    note(f"{len(chosen) - len(missing)} of {len(chosen)} pictures are there, with {arguments.spp} paths or more")
    for index, picture in enumerate(missing):
        start = time.perf_counter()
        picture.take(arguments.spp)
        note(f"{index + 1}/{len(missing)} {picture.name}: {time.perf_counter() - start:.0f} s")
        write_page()
    write_page()


if __name__ == "__main__":
    main()
