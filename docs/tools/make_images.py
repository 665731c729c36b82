# SPDX-License-Identifier: Apache-2.0
"""Render the pictures of the README and of docs/: `python docs/tools/make_images.py [NAME ...]`.

NAME: a key of PICTURES; by default all. Each takes minutes on two cores.
"""

import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import tiscene as ts
from tiscene.cli.terminal import progress
from tiscene.export.animated_image import write_animation
from tiscene.export.contact_sheet import contact_sheet
from tiscene.export.png import write_png

DOCS = Path(__file__).resolve().parents[1]
IMAGES = DOCS / "images"
FPS = 10.0


def photograph() -> None:
    """Render the living room for the README."""
    stream = ts.Stream("room_02", width=960, height=640, quality="photo", spp=128, buffers=("rgb",))
    with progress("room_02.png", 1):
        write_png(IMAGES / "room_02.png", stream[0].rgb)


def example(number: int, name: str, frames: int) -> None:
    """Render an animation of an example: color, instances and flow side by side.

    Args:
        number: index of the example in docs/examples.md.
        name: file name in docs/images.
        frames: number of frames.
    """
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


def shutter() -> None:
    """Render a moving chair with the shutter closed and open."""
    path = ts.CatmullWaypoints(
        [
            ts.Waypoint((-2.4, 1.2, -3.9)),
            ts.Waypoint((-0.9, 1.6, -3.6), (0, 120, 40)),
            ts.Waypoint((-0.4, 1.1, -4.2), (30, 240, 0)),
        ],
        total_time=1.6,
    )
    camera = ts.Camera.look_at((-1.7, 1.35, 0.4), (-1.55, 1.1, -3.8), vertical_fov=0.62, exposure=2.2)
    scenario = ts.Scenario("room_02", [ts.Object("c", "Chair 01", dynamic=path, collide=False)], camera=camera)
    settings: dict[str, Any] = {"width": 360, "height": 300, "spp": 64, "buffers": ("rgb",), "incremental": False}
    with progress("shutter.png", 2) as step:
        halves = []
        for times in ((0, 0), (0, 0.5)):
            halves.append(ts.Stream(scenario, shutter=times, **settings)[9].rgb)
            step()
    write_png(IMAGES / "shutter.png", np.concatenate(halves, axis=1))


def factors() -> None:
    """Render one moment of a scenario, and of five counterfactuals of it, in two rows."""
    base = ts.Scenario.sample("room_01", seed=1, objects=1, templates=("Chair 02",), scale=0.8, depth=(1.5, 2.5))
    variations: tuple[tuple[str, Any], ...] = (
        ("illumination", "evening"),
        ("illumination", "night"),
        ("materials", 0.5),
        ("furniture", {"shift": (0.2, 0.5), "turn": (10, 40), "variants": 1.0}),
        ("clutter", 5),
    )
    scenarios = [base, *(base.with_factor(name, value, seed=3) for name, value in variations)]
    pictures = []
    with progress("factors.png", len(scenarios)) as step:
        for scenario in scenarios:
            with ts.Stream(scenario, width=288, height=216, quality="standard", spp=32, buffers=("rgb",)) as stream:
                pictures.append(stream[20].rgb)
            step()
    rows = [np.concatenate(pictures[first : first + 3], axis=1) for first in (0, 3)]
    write_png(IMAGES / "factors.png", np.concatenate(rows))


PICTURES: dict[str, Callable[[], None]] = {
    "room_02.png": photograph,
    "cylinder.webp": lambda: example(0, "cylinder.webp", 50),
    "bouncing.webp": lambda: example(1, "bouncing.webp", 50),
    "shutter.png": shutter,
    "racket.webp": lambda: example(2, "racket.webp", 50),
    "factors.png": factors,
}

if __name__ == "__main__":
    for name in sys.argv[1:] or PICTURES:
        PICTURES[name]()
