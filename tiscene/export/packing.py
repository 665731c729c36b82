# SPDX-License-Identifier: Apache-2.0
"""Files of many frames, such as tar shards and videos, written in bounded memory and continued after any interruption.

While frames are rendered, what each adds to such a file is kept in `pieces/000012.bin` (per camera), which the manifest
lists as the frame's file. The format's `pack` reads the pieces of a group in the order of frames, and writes into a
temporary folder; some formats begin before all frames are there (see `packing_thread`). When the last frame of the
group is there, the files are moved to their places, the manifest is saved with them, and the pieces are deleted.
Packing depends on the pieces alone; so it may be repeated after a kill at any moment, and the pieces of several
machines may be packed on one.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tiscene.export.array_files import Contents, resolved
from tiscene.export.manifest import Manifest, file_digest

PIECES, PACKING = "pieces", ".packing"


@dataclass(frozen=True)
class ExportRun:
    """What formats know of an export as a whole.

    Attributes:
        provenance: That of the manifest: version, format, buffers, settings, scenario.
        categories: Names of the ids in `semantic`.
        frames: Indices of the frames in the folder, ascending.
    """

    provenance: Mapping[str, Any]
    categories: Mapping[int, str]
    frames: Sequence[int]

    @property
    def fps(self) -> float:
        """Frames per second."""
        return float(self.provenance["settings"]["fps"])

    @property
    def name(self) -> str:
        """What the export is called in a data set; "": it is in none."""
        return str(self.provenance.get("name", ""))

    @property
    def buffers(self) -> list[str]:
        """Names of the buffers."""
        return list(self.provenance["buffers"])

    @classmethod
    def of(cls, manifest: Manifest) -> ExportRun:
        """Return the run of a manifest."""
        return cls(manifest.provenance, manifest.categories, list(manifest.frames))


@dataclass(frozen=True)
class FramePieces:
    """What a frame adds to files of many frames.

    Attributes:
        index: Of the frame.
        folder: Of the export and the camera in a data set, which ends in "/"; "": of a single camera, in none.
        members: Contents by name, as the format's `pieces` returned them.
    """

    index: int
    folder: str
    members: Mapping[str, bytes]


@dataclass(frozen=True)
class GroupFrames:
    """The frames of a group; may be read several times, one frame in memory.

    Attributes:
        paths: The pieces of each frame, by ascending index.
        folder: That of the frames' `FramePieces`.
        wait: Called with the index of a frame before its pieces are read.
    """

    paths: Mapping[int, Path]
    folder: str
    wait: Callable[[int], None] | None = None

    @property
    def first(self) -> int:
        """The index of the first frame."""
        return next(iter(self.paths))

    def __iter__(self) -> Iterator[FramePieces]:
        for index, path in self.paths.items():
            if self.wait is not None:
                self.wait(index)
            yield FramePieces(index, self.folder, _separated(path.read_bytes()))


def pieces_file(index: int, members: Mapping[str, Contents]) -> dict[str, Contents]:
    """Return the file of a frame's pieces by its name."""
    return {f"{PIECES}/{index:06d}.bin": lambda: _joined(resolved(members))}


def _joined(members: Mapping[str, bytes]) -> bytes:
    """Return contents as one: a line of JSON with the size of each by its name, and then themselves.

    Zip files take ten times as long: a frame of labels has a megabyte, and each file is checked by its digest anyway.
    """
    sizes = json.dumps({name: len(data) for name, data in members.items()})
    return b"".join([sizes.encode(), b"\n", *members.values()])


def _separated(data: bytes) -> dict[str, bytes]:
    """Return contents by name from what `_joined` returned."""
    start = data.index(b"\n") + 1
    members = {}
    for name, size in json.loads(data[:start]).items():
        members[name] = data[start : start + size]
        start += size
    return members


def is_pieces(name: str) -> bool:
    """Return whether a file of a frame, relative to the export's folder, holds its pieces."""
    return Path(name).parent.name == PIECES


def has_pieces(entry: Mapping[str, Any]) -> bool:
    """Return whether a frame of the manifest waits to be packed."""
    return any(map(is_pieces, entry["files"]))


def content_digest(format: Any, path: Path) -> str | None:
    """Return the digest of a file, by the rule of the module of a format; None if it cannot be read."""
    special = getattr(format, "content_digest", None)
    return (special(path) if special is not None and path.is_file() else None) or file_digest(path)


def write_group(
    format: Any,
    folder: Path,
    run: ExportRun,
    cameras: Sequence[str],
    indices: Sequence[int],
    wait: Callable[[int], None] | None = None,
) -> dict[str, str]:
    """Write the files of a group of frames from their pieces into a temporary folder.

    Args:
        format: The module of the format.
        folder: Of the export.
        run: The export as a whole.
        cameras: The folders of the cameras.
        indices: The frames of the group, ascending.
        wait: Called with the index of a frame before its pieces are read; None: all are there.

    Returns:
        The content digests that the format knows, by the name of the file.
    """
    known: dict[str, str] = {}
    temporary = _temporary(folder, indices)
    shutil.rmtree(temporary, ignore_errors=True)
    for camera in cameras:
        target = temporary / camera
        target.mkdir(parents=True, exist_ok=True)
        name = f"{run.name}/{camera}" if run.name else camera
        digests = format.pack(GroupFrames(_pieces(folder, camera, indices), name, wait), run, target) or {}
        known |= {f"{camera}{name}": digest for name, digest in digests.items()}
    return known


def place_group(
    format: Any, folder: Path, manifest: Manifest, indices: Sequence[int], known: Mapping[str, str]
) -> None:
    """Move the files of a group to their places, save the manifest that lists them, and delete the pieces.

    Args:
        format: The module of the format.
        folder: Of the export.
        manifest: Of the export; every frame of the group has pieces in it.
        indices: The frames of the group, ascending.
        known: What `write_group` returned.
    """
    packed: dict[str, str] = {}
    temporary = _temporary(folder, indices)
    for path in sorted(path for path in temporary.rglob("*") if path.is_file()):
        name = path.relative_to(temporary).as_posix()
        packed[name] = known.get(name) or content_digest(format, path) or ""
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        os.replace(path, folder / name)
    shutil.rmtree(temporary)
    for index in indices:
        entry = manifest.frames[index]
        own = {name: digest for name, digest in entry["files"].items() if not is_pieces(name)}
        manifest.frames[index] = entry | {"files": own | packed}
    manifest.save(folder)
    for camera in manifest.folders:
        for path in _pieces(folder, camera, indices).values():
            path.unlink(missing_ok=True)


def _temporary(folder: Path, indices: Sequence[int]) -> Path:
    """Return the folder in which the files of a group are written."""
    return folder / PACKING / f"{indices[0]:06d}"


def _pieces(folder: Path, camera: str, indices: Sequence[int]) -> dict[int, Path]:
    """Return the files of the pieces of a camera, by the indices of the frames."""
    return {index: folder / f"{camera}{PIECES}/{index:06d}.bin" for index in indices}


def remove_leftovers(folder: Path, manifest: Manifest) -> None:
    """Delete what a killed process has left: half-packed files, and pieces that the manifest does not list."""
    shutil.rmtree(folder / PACKING, ignore_errors=True)
    for camera in manifest.folders:
        for path in (folder / camera / PIECES).glob("*.bin"):
            index = int(path.stem) if path.stem.isdecimal() else -1
            if index not in manifest.frames or not has_pieces(manifest.frames[index]):
                path.unlink()
        if (folder / camera / PIECES).is_dir() and not any((folder / camera / PIECES).iterdir()):
            (folder / camera / PIECES).rmdir()
