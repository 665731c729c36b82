# SPDX-License-Identifier: Apache-2.0
"""Names to files: the scenes and object templates that can be asked for by name.

A folder of scenes looks like the package `usd_scenes`::

    <scene>/scene.usda                      the scene `<scene>`
    templates/<folder>/template.usda        the template whose name is the folder's: chair_01 is "Chair 01"

(or `.usd`, `.usdc`, `.usdz`). The folders that the environment variable TISCENE_PATH lists are searched first, then the
package; the first to know a name wins.
"""

from __future__ import annotations

import os
from pathlib import Path

import usd_scenes
from tiscene.errors import ArgumentError, MissingFile, SceneNotFound, TemplateNotFound

STAGE_SUFFIXES = (".usda", ".usdc", ".usd", ".usdz")
LAYER_SUFFIXES = (".usda", ".usdc", ".usd")  # those that can be written
SCENARIO_SUFFIXES = (".json",)


def search_path() -> list[Path]:
    """The folders of scenes, in the order in which they are searched. Those that do not exist are listed too."""
    listed = os.environ.get("TISCENE_PATH", "").split(os.pathsep)
    return [Path(os.path.expanduser(folder)) for folder in listed if folder] + [Path(usd_scenes.__path__[0])]


def scenes() -> dict[str, Path]:
    """Every scene by its name, sorted."""
    return _stages("*", "scene")


def templates() -> dict[str, Path]:
    """Every object template by its name ("Chair 01"), sorted."""
    files = _stages("templates/*", "template")
    return {template_name(folder): path for folder, path in files.items()}


def template_name(folder: str) -> str:
    """The name of the template that lives in a folder: "chair_01" is "Chair 01"."""
    return folder.replace("_", " ").title()


def find_scene(scene: str | os.PathLike[str]) -> Path:
    """The file of a scene, given by name or as the path of a USD stage or of a scenario (.json).

    Raises SceneNotFound for an unknown name, MissingFile for a path where no file is.
    """
    path = _as_path(scene, STAGE_SUFFIXES + SCENARIO_SUFFIXES)
    if path is not None:
        return path
    known = scenes()
    if scene not in known:
        raise SceneNotFound("scene", str(scene), known, hint=f"`tiscene list` lists all {len(known)}.{_unsearched()}")
    return known[str(scene)]


def find_template(template: str | os.PathLike[str], *, scene: str = "") -> Path:
    """The file of an object template, given by name or as the path of a USD file, with or without variants.

    scene: where it is to be spawned, only for the message.
    Raises TemplateNotFound for an unknown name, MissingFile for a path where no file is.
    """
    template = template_variants(os.fspath(template))[0]
    if is_prim_path(template) and not os.path.exists(template):
        raise MissingFile(f"no file {template!r}; a thing of the stage is there already, and `world.move` moves it")
    path = _as_path(template, STAGE_SUFFIXES)
    if path is not None:
        return path
    known = templates()
    if template not in known:
        where = f" in scene {scene!r}" if scene else ""
        command = f"tiscene show {scene}" if scene else "tiscene list"
        hint = f"`{command}` lists all {len(known)}.{_unsearched()}"
        raise TemplateNotFound("template", str(template), known, where=where, hint=hint)
    return known[str(template)]


def template_variants(template: str) -> tuple[str, dict[str, str]]:
    """A template and the variants that are chosen after it: "Chair 01{color=walnut}" is "Chair 01" in that color.

    As in a USD path, each set has braces of its own: "Cup 01{color=green}{appearance=untextured}".
    Raises ArgumentError for braces that hold anything else.
    """
    name, brace, rest = template.partition("{")
    if not brace:
        return template, {}
    chosen: dict[str, str] = {}
    for choice in rest.removesuffix("}").split("}{"):
        variant_set, equals, variant = choice.partition("=")
        if not (rest.endswith("}") and variant_set and equals and variant) or set(choice) & set("{}"):
            raise ArgumentError(f"template {template!r}: variants are chosen as in 'Chair 01{{color=walnut}}'")
        chosen[variant_set] = variant
    return name, chosen


def is_prim_path(template: str) -> bool:
    """Whether a template's name means a prim on the scene's own stage ("/World/Chair"), which then moves."""
    return template.startswith("/") and Path(template.partition("{")[0]).suffix.lower() not in STAGE_SUFFIXES


def _stages(pattern: str, stem: str) -> dict[str, Path]:
    """Folder name to the file `stem`.usd* inside, for the folders that match the pattern on the search path."""
    found: dict[str, Path] = {}
    for root in search_path():
        for folder in root.glob(pattern) if os.path.isdir(root) else ():
            files = [folder / f"{stem}{suffix}" for suffix in STAGE_SUFFIXES]
            present = [path for path in files if os.path.isfile(path)]
            if present:
                found.setdefault(folder.name, present[0])
    return dict(sorted(found.items()))


def _as_path(text: str | os.PathLike[str], suffixes: tuple[str, ...]) -> Path | None:
    """The file that a path names, which must be there; None if the text is a name."""
    path = Path(os.path.expanduser(text))
    is_name = isinstance(text, str) and path.suffix.lower() not in suffixes and len(path.parts) == 1
    if is_name:
        return None
    if not os.path.exists(path):
        raise MissingFile(f"no file {str(path)!r} (looked from {str(Path.cwd())!r})")
    if path.is_dir() or path.suffix.lower() not in suffixes:
        kind = "a folder" if path.is_dir() else f"a {path.suffix or 'nameless kind of'} file"
        raise ArgumentError(f"{str(path)!r} is {kind}; expected a file that ends in {', '.join(suffixes)}")
    return path


def _unsearched() -> str:
    """A sentence about folders of TISCENE_PATH that are not there, for they are often the mistake."""
    missing = [str(folder) for folder in search_path() if not os.path.isdir(folder)]
    return f" TISCENE_PATH names folders that do not exist: {', '.join(missing)}." if missing else ""
