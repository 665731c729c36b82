# SPDX-License-Identifier: Apache-2.0
"""Catalogs of furniture for Sweet Home 3D (.sh3f): a zip of OBJ models and a list of names, categories and sizes."""

from __future__ import annotations

import re
import warnings
import zipfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from tiscene.errors import MissingFile, StageError, StageWarning
from tiscene.usd.importers.import_template import LICENCE_FILES, Credit, write_template
from tiscene.usd.importers.mesh_file import load_model

_CATALOGUE = "PluginFurnitureCatalog.properties"


@dataclass(frozen=True)
class Entry:
    """One model of a catalog. size: width, height, depth, m."""

    name: str
    category: str
    model: str
    size: tuple[float, float, float]
    rotation: tuple[float, ...]
    movable: bool
    author: str
    license: str


class Catalog:
    """An open .sh3f file."""

    def __init__(self, path: str | Path) -> None:
        """Raises MissingFile and StageError."""
        self.path = Path(path)
        if not self.path.is_file():
            raise MissingFile(f"no file {str(path)!r}")
        try:
            self._zip = zipfile.ZipFile(self.path)
            text = self._zip.read(_CATALOGUE).decode("latin-1")
        except (zipfile.BadZipFile, KeyError, OSError) as error:
            raise StageError(str(path), [f"is no catalog of furniture: {error}"]) from error
        self.properties = parse_properties(text)
        self.entries = list(self._entries())

    def _entries(self) -> Iterator[Entry]:
        licenses = [name for name in self._zip.namelist() if LICENCE_FILES.fullmatch(name)]
        texts = [
            self.properties.get("license", ""),
            *(self._zip.read(name).decode("utf-8", "replace") for name in licenses),
        ]
        license = "\n\n".join(text for text in texts if text)
        number = 0
        while f"name#{(number := number + 1)}" in self.properties:
            row = {key: self.properties.get(f"{key}#{number}", "") for key in _KEYS}
            try:
                width, height, depth = (float(row[key]) / 100.0 for key in ("width", "height", "depth"))
                rotation = tuple(float(word) for word in row["modelRotation"].split()) or tuple(np.eye(3).reshape(-1))
                if len(rotation) != 9 or min(width, height, depth) < 0.0:
                    raise ValueError(f"modelRotation of {len(rotation)} numbers")
            except ValueError as error:
                text = f"{self.path} entry {number} ({row['name']}) is left out: {error}"
                warnings.warn(StageWarning(text), stacklevel=2)
                continue
            yield Entry(
                row["name"],
                row["category"],
                row["model"].lstrip("/"),
                (width, height, depth),
                rotation,
                row["movable"] != "false",
                row["creator"],
                row["license"] or license,
            )

    def import_into(self, folder_of: Callable[[Entry], Path]) -> Iterator[tuple[Entry, Path | None]]:
        """Make a template of every entry in the folder that `folder_of` gives. None, and a warning, where one fails."""
        for entry in self.entries:
            try:
                yield entry, self._import(entry, folder_of(entry))
            except StageError as error:
                warnings.warn(StageWarning(f"{entry.name} is left out: {error}"), stacklevel=2)
                yield entry, None

    def _import(self, entry: Entry, folder: Path) -> Path:
        model = PurePosixPath(entry.model)
        files = _Zipped(self._zip, f"{model.parent}/")
        if model.name not in files:
            raise StageError(str(self.path), [f"there is no model {entry.model!r} in it"])
        pieces = load_model(model.name, files)
        notes = [files[name].decode("utf-8", "replace") for name in files if LICENCE_FILES.fullmatch(name)]
        credit = Credit(f"{self.path.name}: {entry.model}", "\n\n".join([entry.license, *notes]), entry.author)
        return write_template(
            pieces,
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
    """ "Office chair 2" as "office chair"."""
    return " ".join(re.sub(r"[\d_()]+", " ", name).split()).lower()


def parse_properties(text: str) -> dict[str, str]:
    """A Java .properties file: key = value, `\\` continues a line, `\\uXXXX` is a character."""
    result = {}
    for line in re.sub(r"\\\r?\n\s*", "", text).splitlines():
        stripped = line.strip()
        if stripped and stripped[0] not in "#!":
            key, _, value = stripped.partition("=")
            result[key.strip()] = re.sub(r"\\u([0-9a-fA-F]{4})", lambda m: chr(int(m[1], 16)), value.strip())
    return result


class _Zipped(Mapping[str, bytes]):
    """The files below a folder of a zip, read when they are asked for."""

    def __init__(self, archive: zipfile.ZipFile, folder: str) -> None:
        self._archive = archive
        self._folder = folder
        self._names = [
            name[len(folder) :] for name in archive.namelist() if name.startswith(folder) and name[-1] != "/"
        ]

    def __getitem__(self, name: str) -> bytes:
        if name not in self._names:
            raise KeyError(name)
        return self._archive.read(self._folder + name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)
