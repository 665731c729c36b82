# SPDX-License-Identifier: Apache-2.0
"""Collect what a machine without a package index needs beside wheels: `python -m tests.gpu.kit SCENES FOLDER`.

FOLDER/code holds the packages, this program and the baked scenes; FOLDER/rooms the room of the part `streams`, with all
files that it refers to; FOLDER/denoiser a copy of pyoidn with the libraries for CPUs and CUDA only, half the size of
its wheel. docs/dev/gpu.md says how to use them.
"""

from __future__ import annotations

import argparse
import importlib.util
import shutil
from collections.abc import Sequence
from pathlib import Path

from tests.gpu.baked_scene import FOLDER_NAME, SUFFIX
from tests.gpu.stream_parts import ROOM, TEMPLATES
from tiscene.catalog import find_scene, find_template

ROOT = Path(__file__).parents[2]
PACKAGES = ("tiscene", "dynamics", "tests/gpu")
LIBRARIES = ("libOpenImageDenoise.so", "libOpenImageDenoise_core", "_device_cpu", "_device_cuda", "libtbb.so.12")


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the folders and print their sizes.

    Args:
        arguments: the command line; None for this process's.
    """
    parser = argparse.ArgumentParser(prog="python -m tests.gpu.kit", description="Collect what a GPU machine needs.")
    parser.add_argument("scenes", type=Path, help="folder of the baked scenes")
    parser.add_argument("folder", type=Path, help="folder to write; it must not exist")
    args = parser.parse_args(arguments)
    code, rooms, denoiser = (args.folder / name for name in ("code", "rooms", "denoiser"))
    for name in PACKAGES:
        shutil.copytree(ROOT / name, code / name, ignore=shutil.ignore_patterns("__pycache__", "test_*"))
    shutil.copy(ROOT / "tests" / "__init__.py", code / "tests")
    (code / FOLDER_NAME).mkdir()
    for file in args.scenes.glob(f"*{SUFFIX}"):
        shutil.copy(file, code / FOLDER_NAME)
    _copy_rooms(rooms)
    _copy_denoiser(denoiser)
    for folder in (code, rooms, denoiser):
        size = sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
        print(f"{folder}: {size / 2**20:.1f} MiB")


def _copy_rooms(folder: Path) -> None:
    """Copy the stage of the part `streams`, its templates, and all files that they refer to."""
    from pxr import UsdUtils

    scenes = find_scene(ROOM).parents[1]
    files = {scenes / "__init__.py", scenes / "categories.json"}
    for stage in (find_scene(ROOM), *map(find_template, TEMPLATES)):
        layers, assets, _ = UsdUtils.ComputeAllDependencies(str(stage))
        files |= {Path(name) for name in (*(layer.realPath for layer in layers), *assets)}
    for file in files:
        target = folder / "usd_scenes" / file.relative_to(scenes)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(file, target)


def _copy_denoiser(folder: Path) -> None:
    """Copy the installed pyoidn, with the libraries that are needed, each once."""
    found = importlib.util.find_spec("pyoidn")
    if found is None or found.origin is None:
        print("pyoidn is not installed: no denoiser")
        return
    source, target = Path(found.origin).parent, folder / "pyoidn"
    libraries = target / "oidn" / "lib"
    libraries.mkdir(parents=True)
    for file in source.glob("*.py"):
        shutil.copy(file, target)
    for name in LIBRARIES:
        exact = source / "oidn" / "lib" / name
        file = exact if exact.exists() else next((source / "oidn" / "lib").glob(f"*{name}*"))
        shutil.copy(file, libraries)


if __name__ == "__main__":
    main()
