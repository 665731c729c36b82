# SPDX-License-Identifier: Apache-2.0
"""`python -m usd_scenes.author [NAME ...] [--output FOLDER]`: write textures, templates and scenes.

Labels that are new get an id in `categories.json`.

NAME: a scene (room_02), a template's folder (chair_01), "textures" or one texture (oak); default everything.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from usd_scenes.author import (
    category_registry,
    home_01,
    object_view,
    room_01,
    room_02,
    room_03,
    room_04,
    room_05,
    solid_benchmark,
    templates,
)
from usd_scenes.author.textures.library import MAKERS

PACKAGE = Path(__file__).resolve().parents[1]
SCENES = {
    "object_view": object_view.build,
    "room_01": room_01.build,
    "room_02": room_02.build,
    "room_03": room_03.build,
    "room_04": room_04.build,
    "room_05": room_05.build,
    "home_01": home_01.build,
    "solid_benchmark": solid_benchmark.build,
}


def jobs(output: Path) -> dict[str, Callable[[], None]]:
    """Return the functions that write each texture, template and scene below `output`, in order of dependency."""
    result: dict[str, Callable[[], None]] = {}
    for name, make in MAKERS.items():
        result[name] = lambda make=make: make(output / "textures")  # type: ignore[misc]
    for folder in templates.TEMPLATES:
        result[folder] = lambda folder=folder: templates.write(folder, output)  # type: ignore[misc]
    for name, build in SCENES.items():
        result[name] = lambda build=build: build().write(output)  # type: ignore[misc]
    return result


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m usd_scenes.author", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--output", type=Path, default=PACKAGE, help="default: the usd_scenes package itself")
    arguments = parser.parse_args()
    known = jobs(arguments.output)
    names = [n for name in arguments.names for n in (MAKERS if name == "textures" else [name])] or list(known)
    unknown = sorted(set(names) - set(known))
    if unknown:
        parser.error(f"unknown: {', '.join(unknown)}; there are: textures, {', '.join(known)}")
    for name in names:
        known[name]()
    category_registry.update(arguments.output)


if __name__ == "__main__":
    main()
