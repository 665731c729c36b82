# SPDX-License-Identifier: Apache-2.0
"""Verify an export: files are as recorded, and frames that are rendered again have the recorded buffers."""

from __future__ import annotations

import contextlib
import hashlib
import os
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import tiscene
from tiscene.errors import ArgumentError, ExportError, counted
from tiscene.export.folder_writer import FolderWriter
from tiscene.export.generation.data_set_index import DATA_SET
from tiscene.export.manifest import Manifest, buffer_digests, file_digest
from tiscene.export.manifest_difference import differences, listing
from tiscene.export.manifest_stream import stream_of
from tiscene.files import FolderLockedError, lock_folder

MAX_LISTED = 8  # frames in a message


@dataclass(frozen=True)
class Verification:
    """What verifying an export has found.

    Attributes:
        frames: Number of frames in the manifest.
        rendered: Number of frames that were rendered again.
        damaged: Frames with a file that is missing or has other bytes.
        different: By frame that renders otherwise, the names of the buffers.
        files: Files about all frames that are missing or have other bytes.
    """

    frames: int
    rendered: int
    damaged: tuple[int, ...]
    different: dict[int, tuple[str, ...]]
    files: tuple[str, ...] = ()

    @property
    def is_good(self) -> bool:
        """Whether everything is as recorded."""
        return not self.damaged and not self.different and not self.files

    def problems(self) -> list[str]:
        """Return what is wrong, as sentences."""
        found = []
        if self.damaged:
            found.append(
                f"files of {counted(len(self.damaged), 'frame')} are missing or damaged: {_listed(self.damaged)}"
            )
        if self.files:
            found.append(f"files about all frames are missing or damaged: {', '.join(self.files)}")
        if self.different:
            names = sorted({name for buffers in self.different.values() for name in buffers})
            frames = (
                f"{len(self.different)} of {counted(self.rendered, 'frame')} rendered otherwise ({', '.join(names)})"
            )
            found.append(f"{frames}: {_listed(self.different)}")
        return found


def verify(
    folder: str | Path,
    *,
    sample: int | None = None,
    frames: Collection[int] | None = None,
    search: Sequence[str | Path] = (),
    arch: str | None = None,
    progress: Callable[[int, bool], None] | None = None,
) -> Verification:
    """Compare an export with its manifest. `verify_data_set` does so with all scenarios of a data set.

    Args:
        folder: The folder of the export.
        sample: How many frames are rendered again, evenly from the first to the last; 0: none, files alone are
            compared; None: all.
        frames: Indices of the frames that are rendered again, as far as the export has them; None: as `sample` says.
        search: Folders, beside the export's own, in which files of the scene are looked for by their digest.
        arch: "cpu" or "cuda"; None: as of `Stream`.
        progress: Called with the index of a frame, and whether it was rendered; else its files were compared.

    Raises:
        ExportError: There is no export, another process writes into it, its stage is not here, or this version of
            tiscene or the files of the scene are not those that made it.
    """
    if sample is not None and sample < 0:
        raise ArgumentError(f"sample={sample}: must be 0 or more")
    folder = Path(folder)
    manifest = Manifest.load(folder)
    if manifest is None:
        hint = "; a data set is verified by `verify_data_set`" if (folder / DATA_SET).is_file() else ""
        raise ExportError(f"{str(folder)!r} is not an export: it has no tiscene.json{hint}")
    indices, damaged, files = list(manifest.frames), [], []
    try:
        # Nothing writes into a folder that is read-only, as those of archives are.
        with lock_folder(folder) if os.access(folder, os.W_OK) else contextlib.nullcontext():
            writer = FolderWriter(folder, manifest)
            for index in indices:
                if not writer.holds(index):
                    damaged.append(index)
                if progress is not None:
                    progress(index, False)
            if manifest.provenance["tiscene"] == tiscene.__version__:  # another one may write them otherwise
                summary = {name: hashlib.sha256(data).hexdigest() for name, data in writer.summary().items()}
                files = [name for name, digest in summary.items() if file_digest(folder / name) != digest]
    except FolderLockedError as error:
        raise ExportError(f"cannot verify {str(folder)!r}: {error}") from error
    chosen = evenly(indices, sample) if frames is None else [index for index in indices if index in frames]
    different = {}
    if chosen:
        with stream_of(manifest, [*map(Path, search), folder], arch) as stream:
            found = differences(manifest.provenance["settings"], stream.settings(), "settings")
            found = [each for each in found if each.key != "settings.files"]
            recorded, present = (
                sorted(each.values()) for each in (manifest.provenance["file_digests"], stream.file_digests())
            )
            if found or recorded != present:
                changed = listing(found or ["a file of the scene or of a template has another content"])
                raise ExportError(f"{str(folder)!r} cannot be rendered again:{changed}")
            for index in chosen:
                digests, recorded_buffers = buffer_digests(stream[index]), manifest.frames[index]["buffers"]
                names = tuple(name for name, digest in recorded_buffers.items() if digests.get(name) != digest)
                if names:
                    different[index] = names
                if progress is not None:
                    progress(index, True)
    return Verification(len(indices), len(chosen), tuple(damaged), different, tuple(files))


def evenly(indices: Sequence[int], count: int | None) -> list[int]:
    """Return some of the indices, evenly spaced, the first and the last among them; None: all."""
    if count is None or count >= len(indices):
        return list(indices)
    return [indices[round(place * (len(indices) - 1) / max(1, count - 1))] for place in range(count)]


def _listed(frames: Iterable[int]) -> str:
    indices = list(frames)
    return ", ".join(map(str, indices[:MAX_LISTED])) + (", ..." if len(indices) > MAX_LISTED else "")
