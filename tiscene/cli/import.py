# SPDX-License-Identifier: Apache-2.0
"""`tiscene import`: make templates of model files, in a library on the search path."""

from __future__ import annotations

import argparse
import os
import re
import shlex
from pathlib import Path

import numpy as np

from tiscene import catalog
from tiscene.cli.terminal import progress
from tiscene.errors import ArgumentError, counted
from tiscene.usd.importers.import_template import USD_SUFFIXES, import_asset
from tiscene.usd.importers.sweet_home_3d import FurnitureCatalog
from tiscene.usd.read.template import read_template

_USUAL_SIZE = (0.005, 20.0)  # m, of the longest side of an object in a room


def run(args: argparse.Namespace) -> None:
    """Import a model, or all models of a furniture catalog."""
    library = Path(args.output or next(iter(catalog.search_path()[:-1]), "tiscene-assets"))
    if Path(args.file).suffix.lower() == ".sh3f":
        options = [f"--{key}" for key in ("name", "label", "unit", "up", "author", "license") if getattr(args, key)]
        options += ["--keep-origin"] * args.keep_origin
        if options:
            raise ArgumentError(f"{', '.join(options)}: a catalog defines this for each of its models; leave it out")
        _import_catalog(Path(args.file), library)
    else:
        _import_model(args, library)
    if library.resolve() not in [folder.resolve() for folder in catalog.search_path()]:
        print(f"To use them by name: export TISCENE_PATH={shlex.quote(str(library.resolve()))}")


def _import_model(args: argparse.Namespace, library: Path) -> None:
    name = args.name or _title(Path(args.file).stem)
    license = ""
    if args.license:
        try:
            license = Path(args.license).read_text("utf-8") if Path(args.license).is_file() else args.license
        except (OSError, UnicodeDecodeError) as error:
            raise ArgumentError(f"--license {args.license}: cannot be read as text ({error})") from error
    folder = _folder(library, name)
    if (folder / "template.usda").exists() and not args.overwrite:
        taken = catalog.template_name(folder.name)
        raise ArgumentError(f"{folder} has a template {taken!r} already: give another --name, or --overwrite it")
    path = import_asset(
        args.file,
        folder,
        name=name,
        label=args.label,
        unit=args.unit,
        up_axis=args.up,
        centered=not args.keep_origin,
        license=license,
        author=args.author,
    )
    _print_template(path, Path(args.file))


def _import_catalog(file: Path, library: Path) -> None:
    used: dict[str, int] = {}

    def folder_of(name: str) -> Path:
        used[name] = used.get(name, 0) + 1
        return _folder(library, f"{name} {used[name]:02d}")

    furniture = FurnitureCatalog(file)
    imported = 0
    with progress(f"importing {file.name}", len(furniture.entries)) as step:
        for _, path in furniture.import_into(lambda entry: folder_of(_title(entry.name))):
            imported += path is not None
            step()
    print(f"{imported} of {counted(len(furniture.entries), 'model')} of {file.name} in {library / 'templates'}")


def _print_template(path: Path, source: Path) -> None:
    """Print name, size and triangles of a template of a model file. Reading it also checks it."""
    description = read_template(path).description
    low, high = description.bounds()
    triangles = sum(len(mesh.triangles) for mesh in description.meshes)
    sides = " x ".join(f"{side:.3g}" for side in high - low)
    print(f"{catalog.template_name(path.parent.name)}: {sides} m, {counted(triangles, 'triangle')}")
    print(f"  {path}")
    longest = float(np.max(high - low))
    if not _USUAL_SIZE[0] <= longest <= _USUAL_SIZE[1]:
        unit = "its metersPerUnit" if source.suffix.lower() in USD_SUFFIXES else "--unit"
        print(f"  {longest:.3g} m is an unusual size for an object in a room: is {unit} correct? See --overwrite too")


def _folder(library: Path, name: str) -> Path:
    """Return the folder of a template in a library: "Chair 03" is in templates/chair_03."""
    folder = re.sub(r"\W+", "_", name.strip().lower()).strip("_")
    if not folder:
        raise ArgumentError(f"name={name!r}: must have a letter or a digit")
    return library / "templates" / folder


def _title(name: str) -> str:
    """Return a file name as words: "oak_chair-01" is "oak chair 01"."""
    return " ".join(re.sub(r"[\W_]+", " ", os.path.basename(name)).split())
