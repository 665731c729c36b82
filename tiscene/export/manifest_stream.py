# SPDX-License-Identifier: Apache-2.0
"""Make the stream of an export again, from its manifest; also on another machine, where its files have other paths.

A scene or template that the scenario names by a path is found by its digest: at that path, else in the folder of the
export or beside it, in the folders that are given, or in the catalog.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from tiscene import catalog
from tiscene.errors import ArgumentError, ExportError, MissingFile, SceneNotFound, TemplateNotFound
from tiscene.export.manifest import Manifest, file_digest
from tiscene.render.render_settings import PRESETS, preset
from tiscene.scenario.relative_files import with_files
from tiscene.scenario.scenario import Scenario
from tiscene.stream.stream import Stream
from tiscene.usd.core.layers import scene_digests

_PLAIN = ("time_code", "taxonomy", "categories", "subdivision")  # settings that are arguments of Stream as they stand


def stream_of(manifest: Manifest, folders: Sequence[Path] = (), arch: str | None = None) -> Stream:
    """Return a stream that renders the frames of a manifest.

    Args:
        manifest: Of the export.
        folders: Where files are looked for that are not where the scenario says; all folders below too.
        arch: "cpu" or "cuda"; None: as of `Stream`.

    Raises:
        ExportError: A file of the scene is missing, or has another content than at the export.
    """
    settings, digests = manifest.provenance["settings"], manifest.provenance["file_digests"]
    content = relocated(manifest.provenance["scenario"], digests, folders)
    _check_stage(str(content["scene"]), digests)
    shutter = settings.get("shutter")
    return Stream(
        Scenario.from_json(content),
        width=settings["width"],
        height=settings["height"],
        fps=settings["fps"],
        seed=settings["seed"],
        buffers=manifest.provenance["buffers"],
        shutter=None if shutter is None else tuple(shutter),
        arch=arch,
        **{name: settings[name] for name in _PLAIN if name in settings},
        **render_arguments(settings),
    )


def render_arguments(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of Stream that give the render settings in a manifest.

    Raises:
        ExportError: No preset of this version has them.
    """
    incremental = settings["incremental"]
    for name in PRESETS:
        arguments: dict[str, Any] = {key: settings[key] for key in ("spp", "max_depth", "pixel_filter")}
        arguments |= {key: settings[key] for key in ("relative_error", "clamp") if settings[key] is not None}
        arguments |= {"denoise": settings["denoiser"] is not None, "incremental": incremental is not None}
        if incremental is not None:
            arguments["base_spp"] = incremental[0]
        cache_bytes = incremental[2] if incremental is not None else 1
        found = preset(name, **arguments).to_json(cache_bytes)
        if all(settings.get(key) == value for key, value in found.items()):
            return arguments | {"quality": name} | ({"cache_bytes": cache_bytes} if incremental is not None else {})
    raise ExportError(f"no quality of this version has the render settings of the export: {dict(settings)}")


def relocated(content: Mapping[str, Any], digests: Mapping[str, str], folders: Sequence[Path]) -> dict[str, Any]:
    """Return a scenario, as JSON values, with paths of files that exist here.

    Args:
        content: The scenario.
        digests: The digests of its files: by path relative to the scene's folder; those of templates begin with the
            template's name and ": ".
        folders: Where to look.

    Raises:
        ExportError: A file was not found; the message names it and its digest.
    """

    def scene(name: str) -> str:
        return _located(name, digests.get(Path(name).name), folders)

    def template(name: str) -> str:
        file = catalog.template_variants(name)[0]
        return name.replace(file, _located(file, digests.get(f"{name}: {Path(file).name}"), folders, template=True))

    result: dict[str, Any] = with_files(content, scene, template)
    return result


def _located(name: str, digest: str | None, folders: Sequence[Path], *, template: bool = False) -> str:
    """Return a scene or template by its name, or by a path at which the file with a digest is."""
    try:
        path = catalog.find_template(name) if template else catalog.find_scene(name)
    except (MissingFile, SceneNotFound, TemplateNotFound, ArgumentError):
        path = None
    if path is not None and (digest is None or file_digest(path) == digest):
        return name
    if digest is None:  # the name of a catalog, whose files are compared later
        kind = "template" if template else "scene"
        raise ExportError(f"no {kind} {name!r} here: set TISCENE_PATH to the folder that has it, or pass its folder")
    for candidate in _candidates(Path(name).name, folders):
        if file_digest(candidate) == digest:
            return str(candidate)
    changed = f"; {str(path)!r} has another content" if path is not None else ""
    raise ExportError(
        f"no file {Path(name).name!r} with the SHA-256 {digest[:12]}... that the export was made of{changed}: "
        "pass the folder that has it (--search DIR)"
    )


def _check_stage(scene: str, digests: Mapping[str, str]) -> None:
    """Raise ExportError, which names files that the stage refers to, if those of the export are not here."""
    present = set(scene_digests(scene, ()).values())
    lacking = [name for name, digest in digests.items() if ": " not in name and digest not in present]
    if lacking:
        others = f" and {len(lacking) - 3} more" if len(lacking) > 3 else ""
        raise ExportError(
            f"{scene!r} refers to files that are not here, or have another content than at the export: "
            f"{', '.join(lacking[:3])}{others}. Put them where they were relative to it, "
            "or set TISCENE_PATH to the folder of the scenes and templates"
        )


def _candidates(name: str, folders: Iterable[Path]) -> Iterator[Path]:
    """Yield files of a name in folders and below, beside these folders, and in the catalog."""
    folders = list(folders)
    for beside in (folder.resolve().parent / name for folder in folders):
        if beside.is_file():
            yield beside
    for folder in [*folders, *catalog.search_path()]:
        for root, below, names in os.walk(folder):
            below.sort()
            if name in names:
                yield Path(root, name)
