# SPDX-License-Identifier: Apache-2.0
"""Furniture catalogs of Sweet Home 3D (.sh3f files) as object templates.

Such a file is a zip archive of models with a .properties file of names, categories, sizes and licenses. It has nothing
to do with `tiscene.catalog`, which finds scenes and templates by name.
"""

from __future__ import annotations

import itertools
import re
import warnings
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath

import numpy as np

from tiscene.errors import MissingFile, StageError, StageWarning, counted
from tiscene.usd.importers.import_template import LICENSE_FILES, Credit, write_template
from tiscene.usd.importers.mesh_file import LazyFiles, load_model

_PROPERTIES_FILE = "PluginFurnitureCatalog.properties"


@dataclass(frozen=True)
class FurnitureEntry:
    """One model of a furniture catalog.

    Attributes:
        name: displayed name.
        category: category in the catalog.
        model: path of the model file in the archive.
        size: width, height, depth, m.
        rotation: nine numbers, the rows of a 3x3 rotation of the model.
        movable: whether it is furniture rather than a part of the building.
        author: its author.
        license: text of its license.
    """

    name: str
    category: str
    model: str
    size: tuple[float, float, float]
    rotation: tuple[float, ...]
    movable: bool
    author: str
    license: str


class FurnitureCatalog:
    """An open .sh3f file.

    Args:
        path: the file.

    Attributes:
        path: the file.
        properties: the key-value pairs of its .properties file.
        entries: its models; invalid ones are left out with a StageWarning.

    Raises:
        MissingFile: there is no such file.
        StageError: it is not a furniture catalog.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        if not self.path.is_file():
            raise MissingFile(f"no file {str(path)!r}")
        try:
            self._zip = zipfile.ZipFile(self.path)
            text = self._zip.read(_PROPERTIES_FILE).decode("latin-1")
        except (zipfile.BadZipFile, KeyError, OSError) as error:
            raise StageError(str(path), [f"is not a furniture catalog (.sh3f): {error}"]) from error
        self.properties = parse_properties(text)
        self.entries = list(self._read_entries())

    def _read_entries(self) -> Iterator[FurnitureEntry]:
        """Yield the valid entries; warn about others."""
        licenses = [name for name in self._zip.namelist() if LICENSE_FILES.fullmatch(name)]
        texts = [
            self.properties.get("license", ""),
            *(self._zip.read(name).decode("utf-8", "replace") for name in licenses),
        ]
        license = "\n\n".join(text for text in texts if text)
        for number in itertools.takewhile(lambda each: f"name#{each}" in self.properties, itertools.count(1)):
            row = {key: self.properties.get(f"{key}#{number}", "") for key in _KEYS}
            try:
                width, height, depth = (float(row[key]) / 100.0 for key in ("width", "height", "depth"))
                rotation = tuple(float(word) for word in row["modelRotation"].split()) or tuple(np.eye(3).reshape(-1))
                if len(rotation) != 9 or min(width, height, depth) < 0.0:
                    found = counted(len(rotation), "number")
                    raise ValueError(f"modelRotation has {found}, expected 9, or a size is negative")
            except ValueError as error:
                text = f"{self.path} entry {number} ({row['name']}) is left out: {error}"
                warnings.warn(StageWarning(text), stacklevel=2)
                continue
            yield FurnitureEntry(
                row["name"],
                row["category"],
                row["model"].lstrip("/"),
                (width, height, depth),
                rotation,
                row["movable"] != "false",
                row["creator"],
                row["license"] or license,
            )

    def import_into(self, folder_of: Callable[[FurnitureEntry], Path]) -> Iterator[tuple[FurnitureEntry, Path | None]]:
        """Import every entry as a template.

        Args:
            folder_of: returns the folder for an entry's template.

        Yields:
            Each entry with its template file; None, with a StageWarning, where the import fails.
        """
        for entry in self.entries:
            try:
                yield entry, self._import(entry, folder_of(entry))
            except StageError as error:
                warnings.warn(StageWarning(f"{entry.name} is left out: {error}"), stacklevel=2)
                yield entry, None

    def _import(self, entry: FurnitureEntry, folder: Path) -> Path:
        """Import one entry. Raises StageError."""
        model = PurePosixPath(entry.model)
        above = f"{model.parent}/"
        names = [name for name in self._zip.namelist() if name.startswith(above) and name[-1] != "/"]
        files = LazyFiles({name.removeprefix(above): partial(self._zip.read, name) for name in names})
        if model.name not in files:
            raise StageError(str(self.path), [f"it has no model {entry.model!r}"])
        meshes = load_model(model.name, files)
        notes = [files[name].decode("utf-8", "replace") for name in files if LICENSE_FILES.fullmatch(name)]
        credit = Credit(f"{self.path.name}: {entry.model}", "\n\n".join([entry.license, *notes]), entry.author)
        return write_template(
            meshes,
            folder,
            entry.name,
            label_of(entry.name),
            np.reshape(entry.rotation, (3, 3)),
            credit,
            size=np.array(entry.size),
            movable=entry.movable,
        )


_KEYS = ("name", "category", "model", "width", "depth", "height", "movable", "modelRotation", "creator", "license")


def label_of(name: str) -> str:
    """Return a semantic label from a name: "Office chair 2" becomes "office chair"."""
    return " ".join(re.sub(r"[\d_()]+", " ", name).split()).lower()


def parse_properties(text: str) -> dict[str, str]:
    """Parse a Java .properties file: key = value, `\\` continues a line, `\\uXXXX` is a character."""
    result = {}
    for line in re.sub(r"\\\r?\n\s*", "", text).splitlines():
        stripped = line.strip()
        if stripped and stripped[0] not in "#!":
            key, _, value = stripped.partition("=")
            result[key.strip()] = re.sub(r"\\u([0-9a-fA-F]{4})", lambda m: chr(int(m[1], 16)), value.strip())
    return result
