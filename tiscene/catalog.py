# SPDX-License-Identifier: Apache-2.0
"""Catalog of scenes, object templates and semantic categories by name.

A folder of scenes has the layout of the package `usd_scenes`::

    <scene>/scene.usda                      the scene `<scene>`
    templates/<folder>/template.usda        a template; its name is that of the folder: chair_01 is "Chair 01"

(`.usd`, `.usdc` and `.usdz` are found as well). The folders in the environment variable TISCENE_PATH are searched
first, then the package. The first folder that has a name defines it. Ids of categories are in the package alone
(`categories.json`).
"""

from __future__ import annotations

import functools
import importlib
import json
import os
import re
import time
import warnings
from dataclasses import dataclass
from pathlib import Path

import usd_scenes
from tiscene.errors import ArgumentError, MissingFile, SceneNotFound, StageWarning, TemplateNotFound

STAGE_SUFFIXES = (".usda", ".usdc", ".usd", ".usdz")
LAYER_SUFFIXES = (".usda", ".usdc", ".usd")  # USD files that can be written
SCENARIO_SUFFIXES = (".json",)

# The lowest id of categories that `categories` lacks. Lower ids are reserved for categories of later versions.
FIRST_UNREGISTERED_ID = 1000

# The reader of templates. Called by name, since `tiscene.usd` imports this module.
TEMPLATE_READER = ("tiscene.usd.read.template", "read_template")

_TEXT_HEADER_BYTES = 1 << 16  # how much of a .usda file is searched for a label
_SETTLED = 2_000_000_000  # ns: folders changed more recently may change again within the resolution of their times
_MAX_LISTINGS = 64  # folders whose listing is kept


@dataclass(frozen=True)
class SceneEntry:
    """A scene of the catalog.

    Attributes:
        name: The name that `Stream` and `Scenario` take.
        path: The USD file.
    """

    name: str
    path: Path


@dataclass(frozen=True)
class TemplateEntry:
    """An object template of the catalog.

    Attributes:
        name: The name that `Object` and `World.spawn` take.
        path: The USD file.
    """

    name: str
    path: Path

    @property
    def category(self) -> str:
        """The semantic category of objects made of this template, "" for none.

        Read from the file at first access: from the text of a .usda file whose default prim has a label of the taxonomy
        `class`, else through USD.

        Raises:
            StageError: The file cannot be read.
        """
        status = self.path.stat()
        return _category(self.path, status.st_mtime_ns, status.st_size)


def search_path() -> list[Path]:
    """Return the folders of scenes in search order, including those that do not exist."""
    listed = os.environ.get("TISCENE_PATH", "").split(os.pathsep)
    return [Path(os.path.expanduser(folder)) for folder in listed if folder] + [Path(usd_scenes.__path__[0])]


def scenes() -> dict[str, SceneEntry]:
    """Return the scenes that can be asked for by name, sorted by name. Opens no file."""
    return {name: SceneEntry(name, path) for name, path in _stages("", "scene").items()}


def templates() -> dict[str, TemplateEntry]:
    """Return the object templates that can be asked for by name ("Chair 01"), sorted by name. Opens no file."""
    return {name: TemplateEntry(name, path) for name, path in _template_files().items()}


def categories() -> dict[str, int]:
    """Return the ids of the semantic categories of all shipped scenes and templates, by name in the order of ids.

    An id is the same in every scene and in every version. Other categories get ids from FIRST_UNREGISTERED_ID on.
    """
    return dict(_registered_categories())


def template_name(folder: str) -> str:
    """Return the name of the template in a folder: "chair_01" is "Chair 01"."""
    return folder.replace("_", " ").title()


def find_scene(scene: str | os.PathLike[str]) -> Path:
    """Return the file of a scene.

    Args:
        scene: The name of a scene, or the path of a USD stage or of a scenario (.json).

    Raises:
        SceneNotFound: No scene has that name.
        MissingFile: No file is at that path.
        ArgumentError: The path is a folder or a file of another type.
    """
    path = _existing_file(scene, STAGE_SUFFIXES + SCENARIO_SUFFIXES)
    if path is not None:
        return path
    known = scenes()
    if scene not in known:
        hint = f"`tiscene list` lists all {len(known)}.{_missing_folders()}"
        raise SceneNotFound("scene", str(scene), known, hint=hint)
    return known[str(scene)].path


def find_template(template: str | os.PathLike[str], *, scene: str = "", hint: str = "") -> Path:
    """Return the file of an object template.

    Args:
        template: The name of a template or the path of a USD file, with or without variants (see `template_variants`).
        scene: The scene that the template is for; used in error messages only.
        hint: Closing sentence of an error message; "": where the names are listed.

    Raises:
        TemplateNotFound: No template has that name.
        MissingFile: No file is at that path.
        ArgumentError: The variants are malformed, or the path is a folder or a file of another type.
    """
    template = template_variants(os.fspath(template))[0]
    if is_prim_path(template) and not os.path.exists(template):
        raise MissingFile(
            f"no file {template!r}; if it is the path of a prim on the stage, that object exists already: "
            "move it with `world.move`"
        )
    path = _existing_file(template, STAGE_SUFFIXES)
    if path is not None:
        return path
    known = _template_files()
    if template not in known:
        where = f" in scene {scene!r}" if scene else ""
        command = f"tiscene show {scene}" if scene else "tiscene list"
        hint = hint or f"`{command}` lists all {len(known)}.{_missing_folders()}"
        raise TemplateNotFound("template", str(template), known, where=where, hint=hint)
    return known[str(template)]


def template_variants(template: str) -> tuple[str, dict[str, str]]:
    """Split a template into its name and the variants selected after it: "Chair 01{color=walnut}".

    As in a USD path, each variant set has its own braces: "Cup 01{color=green}{appearance=untextured}".

    Returns:
        The name or path, and the selected variant of each variant set.

    Raises:
        ArgumentError: The braces hold anything else.
    """
    name, brace, rest = template.partition("{")
    if not brace:
        return template, {}
    selected: dict[str, str] = {}
    for selection in rest.removesuffix("}").split("}{"):
        variant_set, equals, variant = selection.partition("=")
        if not (rest.endswith("}") and variant_set and equals and variant) or set(selection) & set("{}"):
            raise ArgumentError(f"template {template!r}: variants are selected as in 'Chair 01{{color=walnut}}'")
        selected[variant_set] = variant
    return name, selected


def is_prim_path(template: str) -> bool:
    """Return whether a template is a prim on the scene's own stage ("/World/Chair"), which then becomes dynamic."""
    return template.startswith("/") and Path(template.partition("{")[0]).suffix.lower() not in STAGE_SUFFIXES


def _template_files() -> dict[str, Path]:
    """Return the file of each template, by the name of the template."""
    return {template_name(folder): path for folder, path in _stages("templates", "template").items()}


def _stages(folder: str, stem: str) -> dict[str, Path]:
    """Return the file `stem`.usd* of each subfolder of a folder on the search path, by the name of the subfolder."""
    found: dict[str, Path] = {}
    for root in search_path():
        for name, path in _listing(os.path.join(root, folder) if folder else str(root), stem).items():
            found.setdefault(name, path)
    return dict(sorted(found.items()))


@dataclass(frozen=True)
class _Listing:
    """Files of the subfolders of a folder, which hold as long as the statuses of the folders do."""

    statuses: dict[str, tuple[int, ...]]
    files: dict[str, Path]


_listings: dict[tuple[str, str], _Listing] = {}  # by folder and stem


def _listing(folder: str, stem: str) -> dict[str, Path]:
    """Return the file `stem`.usd* of each subfolder that has one. Folders that have not changed are not read again."""
    key = folder, stem
    known = _listings.get(key)
    if known is not None and all(_status(each) == status for each, status in known.statuses.items()):
        return known.files
    statuses = {folder: _status(folder)}  # before the folder is read
    files: dict[str, Path] = {}
    for name in os.listdir(folder) if os.path.isdir(folder) else ():
        subfolder = os.path.join(folder, name)
        if os.path.isdir(subfolder):
            statuses[subfolder] = _status(subfolder)
            present = [path for suffix in STAGE_SUFFIXES if (path := Path(subfolder, stem + suffix)).is_file()]
            if present:
                files[name] = present[0]
    _listings.pop(key, None)
    if max(status[0] for status in statuses.values()) < time.time_ns() - _SETTLED:
        while len(_listings) >= _MAX_LISTINGS:
            del _listings[next(iter(_listings))]
        _listings[key] = _Listing(statuses, files)
    return files


def _status(folder: str) -> tuple[int, ...]:
    """Return what changes when a file is added to a folder or removed; zeros if there is no such folder."""
    try:
        status = os.stat(folder)
    except OSError:
        return 0, 0, 0
    return status.st_mtime_ns, status.st_ino, status.st_dev


@functools.cache
def _registered_categories() -> dict[str, int]:
    ids: dict[str, int] = json.loads(Path(usd_scenes.__path__[0], "categories.json").read_text(encoding="utf-8"))
    return ids


@functools.lru_cache(maxsize=4096)
def _category(path: Path, modified: int, size: int) -> str:
    """Return the category of a template file; cached until its modification time or size changes."""
    label = _class_label(path)
    if label is not None:
        return label
    module, function = TEMPLATE_READER
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StageWarning)  # given again when the template is spawned
        category: str = getattr(importlib.import_module(module), function)(path).category
    return category


def _class_label(path: Path) -> str | None:
    """Return the label in the taxonomy `class` that a .usda file gives its default prim; None if only USD can tell.

    No other layer or taxonomy overrides that label, so that the text is enough to know the category.
    """
    with path.open("rb") as file:
        text = file.read(_TEXT_HEADER_BYTES).decode("utf-8", errors="replace")
    default = re.search(r'^\s*defaultPrim = "(\w+)"', text, re.MULTILINE)
    start = default and re.search(rf'^def (?:\w+ )?"{default[1]}"', text, re.MULTILINE)
    if not text.startswith("#usda") or not start:
        return None
    # Metadata and properties of the prim end where its first child or variant set begins.
    own = re.split(r"^\s+(?:def|over|class|variantSet)\b", text[start.end() :], maxsplit=1, flags=re.MULTILINE)[0]
    label = re.search(r'^\s*token\[\] semantics:labels:class = \["([^"\\]+)"', own, re.MULTILINE)
    return label[1] if label and '"SemanticsLabelsAPI:class"' in own else None


def _existing_file(text: str | os.PathLike[str], suffixes: tuple[str, ...]) -> Path | None:
    """Return the file at a path, or None if the text is a name and no path."""
    path = Path(os.path.expanduser(text))
    is_name = text == "" or (isinstance(text, str) and path.suffix.lower() not in suffixes and len(path.parts) == 1)
    if is_name:
        return None
    if not os.path.exists(path):
        raise MissingFile(f"no file {str(path)!r} (working directory: {str(Path.cwd())!r})")
    if path.is_dir() or path.suffix.lower() not in suffixes:
        kind = "a folder" if path.is_dir() else f"a {path.suffix} file" if path.suffix else "a file without a suffix"
        raise ArgumentError(f"{str(path)!r} is {kind}; expected a file with the suffix {', '.join(suffixes)}")
    return path


def _missing_folders() -> str:
    """Return a sentence about folders of TISCENE_PATH that do not exist, "" for none: a frequent cause of errors."""
    missing = [str(folder) for folder in search_path() if not os.path.isdir(folder)]
    return f" TISCENE_PATH names folders that do not exist: {', '.join(missing)}." if missing else ""
