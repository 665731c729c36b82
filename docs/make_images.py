"""Makes the pictures of the README and of docs/: `python docs/make_images.py [NAME ...]`.

Slow on purpose: a photograph takes minutes on two cores, an animation as well.
"""

import re
import sys
from collections.abc import Callable
from pathlib import Path

import tiscene as ts
from tiscene.commands.progress import progress
from tiscene.export.animation import write_animation
from tiscene.export.contact_sheet import contact_sheet
from tiscene.export.png import write_png

DOCS = Path(__file__).parent
IMAGES = DOCS / "images"
FPS = 10.0


def photograph() -> None:
    """The living room, as the README shows it."""
    stream = ts.Stream("room_02", width=960, height=640, quality="photo", spp=128, buffers=("rgb",))
    with progress("room_02.png", 1):
        write_png(IMAGES / "room_02.png", stream[0].rgb)


def example(number: int, name: str, frames: int) -> None:
    """One of the examples, moving: what is seen, who is who and where it goes."""
    blocks = re.findall(r"```python\n(.*?)```", (DOCS / "examples.md").read_text(encoding="utf-8"), re.DOTALL)
    names: dict[str, ts.Scenario] = {}
    exec(blocks[number], names)
    buffers = ("rgb", "instance", "forward_flow")
    stream = ts.Stream(names["scenario"], width=256, height=192, fps=FPS, spp=8, buffers=buffers)
    pictures = []
    with progress(name, frames) as step:
        for frame in stream[:frames]:
            pictures.append(contact_sheet(frame, buffers, columns=3))
            step()
    write_animation(IMAGES / name, pictures, FPS)


PICTURES: dict[str, Callable[[], None]] = {
    "room_02.png": photograph,
    "cylinder.webp": lambda: example(0, "cylinder.webp", 50),
    "bouncing.webp": lambda: example(1, "bouncing.webp", 50),
    "racket.webp": lambda: example(2, "racket.webp", 50),
}

if __name__ == "__main__":
    for name in sys.argv[1:] or PICTURES:
        PICTURES[name]()
