# SPDX-License-Identifier: Apache-2.0
"""Render the pictures of docs/gallery.md and write the page: `python -m docs.tools.gallery [NAME ...] [--spp N]`.

NAME is the beginning of a picture's name, such as "room_01" or "room_01_Main_night", or "table" for the table of labels
in docs/scenes.md. By default everything is made. A picture takes minutes on two cores. An interrupted run continues:
pictures of the current scene with at least N samples per pixel and this width are not rendered again.
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
from usd_scenes.author.home_01 import ROOMS
from usd_scenes.author.room import LIGHTING
from usd_scenes.author.templates import APPEARANCES

DOCS = Path(__file__).resolve().parents[1]
PACKAGE = DOCS.parent / "usd_scenes"
IMAGES = DOCS / "images" / "gallery"
TABLE = re.compile(r"\| Scene \| Labels.*?\n(?!\|)", re.DOTALL)
WIDTH, HEIGHT = 960, 720
PLACES = {  # cameras by scene
    "room_01": ("Main", "SAILenv", "Chest"),
    "room_02": ("Main", "SAILenv", "Dining"),
    "room_03": ("Main", "Basin", "Toilet"),
    "room_04": ("Main", "Stove", "Table"),
    "room_05": ("Main", "Door", "Console"),
    "home_01": ("Main", "Hall", "Kitchen"),
}
# A picture's JPEG comment: samples per pixel, this text, digest of the scene.
COMMENT = " paths a pixel of "
# Name of each scene's root prim.
ROOTS = {
    **{f"room_{number:02}": f"Room{number:02}" for number in range(1, 6)},
    "home_01": "Home01",
    "solid_benchmark": "SolidBenchmark",
}


@dataclass(frozen=True)
class GalleryPicture:
    """One rendered picture of a scene.

    Attributes:
        scene: name of a shipped scene.
        camera: name of one of its cameras.
        choices: variant sets on the scene's root to their variants.
    """

    scene: str
    camera: str
    choices: dict[str, str] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Scene, camera and variants, joined by underscores."""
        return "_".join([self.scene, self.camera, *self.choices.values()])

    @property
    def file(self) -> Path:
        """The picture's JPEG file, which may not exist yet."""
        return IMAGES / f"{self.name}.jpg"

    @property
    def spp(self) -> int:
        """Samples per pixel of the existing file; 0 if there is none, or if the scene has changed since."""
        if not self.file.exists():
            return 0
        with Image.open(self.file) as picture:
            comment = picture.info.get("comment", b"").decode()
        spp, _, scene = comment.partition(COMMENT)
        return int(spp) if scene == digest(self.scene) else 0

    def is_made(self, spp: int, width: int) -> bool:
        """Return whether the file shows the current scene with at least this many samples per pixel and this width."""
        if self.spp < spp:
            return False
        with Image.open(self.file) as picture:
            return picture.width >= width

    def render(self, spp: int, width: int = WIDTH) -> None:
        """Render the picture, 4:3 and `width` px wide, and write its file."""
        variants = {f"/{ROOTS[self.scene]}{{{key}}}": value for key, value in self.choices.items()}
        size = {"width": width, "height": width * HEIGHT // WIDTH}
        stream = ts.Stream(
            self.scene, **size, quality="photo", spp=spp, buffers=("rgb",), camera=self.camera, variants=variants
        )
        save(self.file, stream[0].rgb, f"{spp}{COMMENT}{digest(self.scene)}")


VIEWS = {  # every camera by day, the first one in all lightings
    scene: [(camera, each) for camera in cameras for each in (LIGHTING if camera == cameras[0] else LIGHTING[:1])]
    for scene, cameras in PLACES.items()
}
PICTURES = [
    *(GalleryPicture(scene, camera, {"lighting": each}) for scene, views in VIEWS.items() for camera, each in views),
    *(GalleryPicture("room_01", "SAILenv", {"appearance": appearance}) for appearance in APPEARANCES[1:]),
    GalleryPicture("solid_benchmark", "Main", {"lighting": "day"}),
]


TITLES = {
    "room_01": "a bedroom",
    "room_02": "a living room",
    "room_03": "a bathroom",
    "room_04": "a kitchen",
    "room_05": "a hall",
    "home_01": "the five rooms as one home",
}
INTRODUCTION = """# Gallery

Path traced at SIZE, denoised and not retouched. SPP
Code in `usd_scenes/author` makes all geometry, cloth and textures. [Importing models](importing.md) shows imported
models in these rooms.
`python -m docs.tools.gallery` writes this page.
"""
END = """
## Templates

![Templates](images/templates.jpg)

![Templates of kitchen and hall](images/kitchen_templates.jpg)

[Templates](templates.md) lists their names, sizes and colors.
"""


def page() -> str:
    """Return the text of docs/gallery.md, with all existing pictures."""
    blocks = [INTRODUCTION.replace("SPP", _quality()).replace("SIZE", _sizes())]
    for scene, title in TITLES.items():
        pictures = [GalleryPicture(scene, camera, {"lighting": each}) for camera, each in VIEWS[scene]]
        in_lightings, elsewhere = pictures[: len(LIGHTING)], pictures[len(LIGHTING) :]
        blocks.append(f"\n## {scene}: {title}\n\n" + _table(LIGHTING, [in_lightings]))
        blocks.append("\n" + _table(PLACES[scene][1:], [elsewhere]))
    first = GalleryPicture("room_01", "SAILenv", {"lighting": LIGHTING[0]})
    others = [GalleryPicture("room_01", "SAILenv", {"appearance": each}) for each in APPEARANCES[1:]]
    text = "\n## One view in three appearances\n\nThe objects, their positions and their labels are the same.\n\n"
    blocks.append(text + _table(APPEARANCES, [[first, *others]]))
    solids = GalleryPicture("solid_benchmark", "Main", {"lighting": LIGHTING[0]})
    blocks.append(f"\n## solid_benchmark: a plain room of solids\n\n{_markdown(solids)}\n" + END)
    return "".join(blocks)


def _quality() -> str:
    """Return a sentence about the samples per pixel of all pictures."""
    counts = sorted({spp for picture in PICTURES if (spp := picture.spp)})
    if not counts:
        return "The pictures show an earlier state of the rooms."
    samples = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    older = "" if all(picture.spp for picture in PICTURES) else "; some show an earlier state of the rooms"
    return f'The pictures have {samples} samples per pixel{older}. `quality="photo"` takes 256.'


def _sizes() -> str:
    """Return the sizes of the existing pictures, largest first."""
    sizes = set()
    for picture in PICTURES:
        if picture.file.exists():
            with Image.open(picture.file) as image:
                sizes.add(image.size)
    return " and ".join(f"{width}×{height}" for width, height in sorted(sizes or {(WIDTH, HEIGHT)}, reverse=True))


def _table(columns: Sequence[str], rows: Sequence[Sequence[GalleryPicture]]) -> str:
    shown = [row for row in rows if any(picture.file.exists() for picture in row)]
    lines = [columns, ["---"] * len(columns), *([_markdown(picture) for picture in row] for row in shown)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _markdown(picture: GalleryPicture) -> str:
    caption = f"{picture.scene}, {picture.camera}, {', '.join(picture.choices.values())}"
    return f"![{caption}]({picture.file.relative_to(DOCS)})" if picture.file.exists() else ""


@cache
def digest(scene: str) -> str:
    """Return a digest of a scene's files and of the templates and textures that it refers to."""
    files: set[Path] = set()
    folders = [PACKAGE / scene, *(PACKAGE / room for room, *_ in ROOMS.values() if scene == "home_01")]
    for folder in folders:
        files |= {path for path in folder.iterdir() if path.is_file()}
        for name in re.findall(r"@\.\./([^@]+)@", (folder / "scene.usda").read_text(encoding="utf-8")):
            path = PACKAGE / name
            files |= set(path.parent.iterdir()) if path.suffix == ".usda" else {path}
    sums = "".join(hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(files))
    return hashlib.sha256(sums.encode()).hexdigest()[:16]


def labels(scene: str) -> Counter[str]:
    """Count the objects of each label on the stage of a shipped scene."""
    return Counter(each.category for each in read_stage(PACKAGE / scene / "scene.usda").objects if each.category)


def table() -> str:
    """Return the labels of every scene as a Markdown table."""
    lines = ["| Scene | Labels and numbers of objects |", "|---|---|"]
    for scene in ROOTS:
        counts = sorted(labels(scene).items())
        lines.append(f"| `{scene}` | {', '.join(f'{name} {n}' if n > 1 else name for name, n in counts)} |")
    return "\n".join(lines) + "\n"


def write_table() -> None:
    """Update the table of labels in docs/scenes.md."""
    page = DOCS / "scenes.md"
    page.write_text(TABLE.sub(lambda _: table(), page.read_text(encoding="utf-8")), encoding="utf-8")


def write_page() -> None:
    """Write docs/gallery.md."""
    (DOCS / "gallery.md").write_text(page(), encoding="utf-8")


def main() -> None:
    """Render missing pictures and write the page and the table."""
    parser = argparse.ArgumentParser(prog="python -m docs.tools.gallery", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--spp", type=int, default=256, help="samples per pixel (default: %(default)s)")
    parser.add_argument("--width", type=int, default=WIDTH, help="px (default: %(default)s)")
    arguments = parser.parse_args()
    chosen = [p for p in PICTURES if not arguments.names or p.name.startswith(tuple(arguments.names))]
    if not arguments.names or "table" in arguments.names:
        write_table()
    elif not chosen:
        known = ", ".join(picture.name for picture in PICTURES)
        parser.error(f"no picture's name begins with {' or '.join(arguments.names)}; known: table, {known}")
    missing = [picture for picture in chosen if not picture.is_made(arguments.spp, arguments.width)]
    note(f"{len(chosen) - len(missing)} of {len(chosen)} pictures exist with {arguments.spp} samples per pixel or more")
    for index, picture in enumerate(missing):
        start = time.perf_counter()
        picture.render(arguments.spp, arguments.width)
        note(f"{index + 1}/{len(missing)} {picture.name}: {time.perf_counter() - start:.0f} s")
        write_page()
    write_page()


if __name__ == "__main__":
    main()
