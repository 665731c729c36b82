# SPDX-License-Identifier: Apache-2.0
"""Files of a stage, their statuses and SHA-256 digests, to detect whether any of them has changed; writing layers."""

from __future__ import annotations

import functools
import hashlib
import os
import tempfile
from collections.abc import Callable, Hashable, Iterable
from pathlib import Path
from typing import Any, TypeVar, cast

from pxr import Ar, Sdf, Tf, Usd, UsdUtils

from tiscene import catalog
from tiscene.errors import export_errors
from tiscene.files import write_atomically
from tiscene.usd.core.package import split_package
from tiscene.usd.core.report import error_lines
from tiscene.usd.core.stage import quiet, resolver_context

_Function = TypeVar("_Function", bound=Callable[..., Any])
MAX_KNOWN = 256  # root files that are kept until one of their files changes


def layer_digests(path: str | Path) -> dict[str, str]:
    """Return the SHA-256 of every layer and texture that a USD file refers to in any variant, itself included.

    Returns:
        Hexadecimal digests by path relative to the file's folder, with forward slashes, so that they do not depend on
        where the folder is; by path in the catalog for its files, if the file itself is elsewhere. Missing files are
        left out. A package (.usdz) is one file. Files that have not changed since an earlier call are not read again.
    """
    return dict(_files_of(path).digests)


def scene_digests(
    scene: str, templates: Iterable[str], digests_of: Callable[[Path], dict[str, str]] = layer_digests
) -> dict[str, str]:
    """Return the digests of all files of a scene and of templates.

    Args:
        scene: name or file of a scene.
        templates: names or files of templates.
        digests_of: `layer_digests`, or a function that opens files of unknown origin elsewhere.

    Returns:
        `layer_digests` of each; the keys of a template's files begin with its name and a colon.
    """
    digests = digests_of(catalog.find_scene(scene))
    for template in sorted(templates):
        files = digests_of(catalog.find_template(template))
        digests |= {f"{template}: {name}": digest for name, digest in files.items()}
    return digests


def digest(digests: dict[str, str]) -> str:
    """Return one SHA-256 over the digests of files."""
    text = "\n".join(f"{name} {digests[name]}" for name in sorted(digests))
    return hashlib.sha256(text.encode()).hexdigest()


def layer_state(path: str | Path) -> Hashable:
    """Return a value that changes with every file of `layer_digests`, and where one that is missing comes to be.

    Reads the layers at the first call, and when one of the files has changed.
    """
    return _files_of(path).state


def cached_by_layers(maxsize: int) -> Callable[[_Function], _Function]:
    """Return a decorator for functions of a USD file and more: `functools.lru_cache`, until a file of it changes."""

    def decorate(function: _Function) -> _Function:
        cached = functools.lru_cache(maxsize)(lambda state, file, *arguments: function(file, *arguments))
        return cast(_Function, lambda file, *arguments: cached(layer_state(file), file, *arguments))

    return decorate


def catalog_path(file: Path) -> str | None:
    """Return the path of a file in the folders of scenes, such as `room_02/scene.usda`; None if it is not found by it.

    Args:
        file: its resolved path.
    """
    folders = [folder.resolve() for folder in catalog.search_path()]
    for folder in folders:
        if file.is_relative_to(folder):
            name = file.relative_to(folder)
            first = next((each / name for each in folders if (each / name).exists()), None)
            return name.as_posix() if first is not None and first.resolve() == file else None
    return None


class _Files:
    """The files that a root file refers to, which hold as long as their statuses do.

    Attributes:
        state: each file with its status; missing ones with None, wherever they would be found.
        is_complete: False: a missing texture has tiles, whose names are not known.
    """

    def __init__(self, root: Path) -> None:
        self._root = root
        context = resolver_context(root)
        with quiet(), Ar.ResolverContextBinder(context):
            found, missing = _dependencies(str(root))
        self._files = {split_package(file)[0] for file in found}
        folders = {*context.GetSearchPath(), *(os.path.dirname(file) for file in self._files)}
        places = {os.path.join(folder, split_package(file)[0]) for folder in folders for file in missing}
        self.state = frozenset((file, _status(file)) for file in self._files | places)
        self.is_complete = not any("<UDIM>" in file for file in missing)

    def have_changed(self) -> bool:
        """Return whether a file was written, replaced, added or removed."""
        return any(_status(file) != status for file, status in self.state)

    @functools.cached_property
    def digests(self) -> dict[str, str]:
        """See `layer_digests`."""
        present = sorted(Path(file) for file in self._files if os.path.isfile(file))
        in_catalog = {} if catalog_path(self._root) else {file: catalog_path(file) for file in present}
        relative = {file: Path(os.path.relpath(file, self._root.parent)).as_posix() for file in present}
        return {in_catalog.get(file) or relative[file]: _digest(file) for file in present}


_known: dict[tuple[Path, tuple[Path, ...]], _Files] = {}  # by root file and folders of scenes


def _files_of(path: str | Path) -> _Files:
    """Return the files of a root file, of an earlier call if none has changed."""
    root = Path(path).resolve()
    key = root, tuple(catalog.search_path())
    known = _known.get(key)
    if known is None or known.have_changed():
        known = _Files(root)
        _known.pop(key, None)
        if known.is_complete:
            while len(_known) >= MAX_KNOWN:
                del _known[next(iter(_known))]
            _known[key] = known
    return known


def _dependencies(root: str) -> tuple[set[str], set[str]]:
    """Return the layers and assets of a root file, itself included, and those that are missing."""
    try:
        layers, assets, missing = UsdUtils.ComputeAllDependencies(root)
    except (Tf.ErrorException, UnicodeDecodeError):  # for one layer that cannot be read
        return _readable_dependencies(root)
    return {root, *(layer.realPath for layer in layers), *assets}, set(missing)


def _readable_dependencies(root: str) -> tuple[set[str], set[str]]:
    """Return `_dependencies` of a file with a layer that USD cannot read: of all others, and that layer itself."""
    resolver, found, missing, layers = Ar.GetResolver(), {root}, set(), [root]
    while layers:
        layer = layers.pop()
        try:
            names = [name for kind in UsdUtils.ExtractExternalReferences(layer) for name in kind]
        except (Tf.ErrorException, UnicodeDecodeError):
            continue
        for name in names:
            asset = resolver.CreateIdentifier(name, Ar.ResolvedPath(layer))
            file = str(resolver.Resolve(asset))
            if not file:
                missing.add(asset)
            elif file not in found:
                found.add(file)
                layers += [file] if Usd.Stage.IsSupportedFile(file) else []
    return found, missing


def _status(path: str) -> tuple[int, ...] | None:
    """Return what changes when a file is written or replaced; None if there is none."""
    try:
        status = os.stat(path)
    except OSError:
        return None
    return status.st_mtime_ns, status.st_ctime_ns, status.st_size, status.st_ino, status.st_dev


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def has_file(stage: Usd.Stage, path: Path) -> bool:
    """Return whether a stage consists of a file, among others: what is written into it would refer to itself."""
    return path.resolve() in [Path(layer.realPath) for layer in stage.GetUsedLayers() if layer.realPath]


def write_layer(layer: Sdf.Layer, path: Path) -> None:
    """Write a layer as a file, whole or not at all.

    Raises:
        ExportError: the file cannot be written.
    """
    with export_errors(path), tempfile.TemporaryDirectory() as folder:
        whole = Path(folder) / f"layer{path.suffix}"
        try:
            layer.Export(str(whole))
        except Tf.ErrorException as error:
            raise OSError("; ".join(error_lines(error))) from None
        write_atomically(path, whole.read_bytes())
