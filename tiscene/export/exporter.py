# SPDX-License-Identifier: Apache-2.0
"""Write frames of a stream into a folder, with a manifest by which an interrupted export is continued.

The formats are in `tiscene.export.formats`. The views of several cameras go into one folder per camera. One process at
a time may write into a folder.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tiscene
from tiscene.errors import ArgumentError, ArgumentTypeError, ExportError, export_errors
from tiscene.export import frame_json
from tiscene.export.encoding_threads import EncodingThreads
from tiscene.export.folder_writer import FolderWriter
from tiscene.export.formats import find_format
from tiscene.export.manifest import NAME, Manifest
from tiscene.export.manifest_difference import cure, differences, listing
from tiscene.export.packing import remove_leftovers
from tiscene.files import lock_folder

if TYPE_CHECKING:
    from tiscene.frame.frame import Frame
    from tiscene.stream.stream import Stream


def export(
    stream: Stream,
    folder: str | Path,
    *,
    format: str = "png",
    frames: Iterable[int] | None = None,
    objects: str | None = None,
    overwrite: bool = False,
    pack: bool = True,
    name: str = "",
    progress: Callable[[int, Frame | None], None] | None = None,
) -> Manifest:
    """Write frames of a stream into a folder.

    A frame whose files are in the folder with the recorded bytes is not rendered again, so that the same call continues
    an interrupted export.

    Args:
        stream: The source of the frames.
        folder: The folder to write; created if it does not exist.
        format: A name in FORMATS (`tiscene render --help` lists them).
        frames: Frame indices in any order, negative ones from the end of a finite stream; None for all of its frames.
        objects: Which rows of `frame.objects` are written to the `labels` file of each frame: "moving" (objects of the
            scenario, and objects of the stage that have a velocity in that frame), "visible" (with at least one pixel
            in the view) or "all"; None writes none.
        overwrite: Delete the frames of an earlier export with other settings instead of refusing.
        pack: Whether files of many frames, such as tar shards, are written once their frames are there. False keeps the
            pieces of each frame, for `tiscene.export.merge`.
        name: What the export is called in a data set, such as "000012", with which keys of samples begin there; "": it
            is in none.
        progress: Called after each frame with its index and the frame; None in place of a frame that was there already.

    Returns:
        The manifest, which is saved as `tiscene.json`.

    Raises:
        ArgumentError: An argument is invalid, or the format requires a buffer that the stream does not have.
        MissingExtra: A library of the format is not installed.
        ExportError: The format cannot write one of the buffers or these frames, or the folder holds frames of other
            settings or files of others that would be replaced, is being written by another process, or cannot be
            written.
    """
    form = find_format(format)
    form.writer()  # before anything is rendered: its libraries may not be installed
    if objects is not None and objects not in frame_json.OBJECT_SELECTIONS:
        raise ArgumentError(f"objects={objects!r}: must be None or one of {', '.join(frame_json.OBJECT_SELECTIONS)}")
    if frames is None:
        if stream.frames is None:
            raise ArgumentError("frames=None: the stream is endless; pass the frames to export, such as range(100)")
        frames = range(stream.frames)
    else:
        frames = frame_indices(frames, stream.frames)
    form.check(stream.buffers, frames)
    folder = Path(folder)
    with writing_into(folder):
        manifest = open_manifest(folder, provenance(stream, format, objects, name), overwrite)
        _write_frames(stream, FolderWriter(folder, manifest), frames, progress, pack)
    return manifest


def frame_indices(frames: Iterable[int], count: int | None) -> Sequence[int]:
    """Return indices of frames of a stream of `count` frames (None: endless), each once; negative ones from its end.

    Raises:
        ArgumentError: They are no whole numbers, or the stream has no such frame.
    """
    if isinstance(frames, range) and (not frames or _are_of(frames, count)):
        return frames  # of any length
    try:
        indices = [operator.index(index) for index in frames]
    except TypeError as error:
        raise ArgumentTypeError(
            f"frames={frames!r}: must be frame indices, such as range(100) or [0, 5] ({error})"
        ) from error
    resolved = [index + count if index < 0 and count is not None else index for index in indices]
    for index, place in zip(indices, resolved, strict=True):
        if not _are_of((place,), count):
            there = "the stream is endless, and has none before 0" if count is None else f"there are 0 to {count - 1}"
            raise ArgumentError(f"frames: no frame {index}: {there}")
    return list(dict.fromkeys(resolved))


def _are_of(indices: Sequence[int], count: int | None) -> bool:
    """Return whether the first and the last of some indices are frames of a stream."""
    return all(index >= 0 and (count is None or index < count) for index in (indices[0], indices[-1]))


@contextmanager
def writing_into(folder: Path) -> Iterator[None]:
    """Create a folder, and hold its lock.

    Raises:
        ExportError: Another process writes into it, or a file cannot be written.
    """
    with export_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        with lock_folder(folder):
            yield


def provenance(stream: Stream, format: str, objects: str | None, name: str = "") -> dict[str, Any]:
    """Return everything that decides the contents of the files, as JSON values."""
    return {
        "tiscene": tiscene.__version__,
        "format": format,
        "buffers": list(stream.buffers),
        "objects": objects,
        "settings": stream.settings(),
        "scenario": stream.scenario.to_json(),
        "file_digests": stream.file_digests(),
    } | ({"name": name} if name else {})


def open_manifest(folder: Path, wanted: dict[str, Any], overwrite: bool) -> Manifest:
    """Return the manifest of a locked folder if it has the wanted provenance, else a new one.

    What a killed process has left is deleted; with `overwrite` also the frames of other provenance.

    Raises:
        ExportError: The folder has frames of other provenance, and `overwrite` is not given.
    """
    present = Manifest.load(folder) if overwrite else matching_manifest(folder, wanted)
    if present is None:
        return Manifest(wanted)
    if overwrite and differences(present.provenance, wanted):
        remove_export(folder, present)
        manifest = Manifest(wanted)
        manifest.save(folder)  # what a killed export has left, without an entry in its manifest, is replaced too
        return manifest
    remove_leftovers(folder, present)
    return present


def matching_manifest(folder: Path, wanted: dict[str, Any]) -> Manifest | None:
    """Return the manifest of a folder; None if it has none. The folder need not be locked.

    Raises:
        ExportError: It has frames of another provenance than the wanted one.
    """
    present = Manifest.load(folder)
    if present is not None and (found := differences(present.provenance, wanted)):
        raise ExportError(
            f"{str(folder)!r} holds frames that were made with other settings:{listing(found)}\n"
            f"{cure(found, present.provenance)}To replace them, pass overwrite=True (--overwrite). "
            "Otherwise choose another folder."
        )
    return present


def remove_export(folder: Path, manifest: Manifest) -> None:
    """Delete the files that a manifest lists and what a killed process has left, and nothing else."""
    root = folder.resolve()
    for entry in manifest.frames.values():
        for name in entry["files"]:
            path = (folder / name).resolve()
            if path.is_relative_to(root):
                path.unlink(missing_ok=True)
    for name in getattr(find_format(manifest.provenance["format"]).writer(), "SUMMARY", ()):
        for camera in manifest.folders:
            (folder / camera / name).unlink(missing_ok=True)
    remove_leftovers(folder, manifest)
    (folder / NAME).unlink()


def _write_frames(
    stream: Stream,
    writer: FolderWriter,
    indices: Sequence[int],
    progress: Callable[[int, Frame | None], None] | None,
    pack: bool,
) -> None:
    """Render and write the frames that are not in the folder yet, and save the manifest now and then."""
    again: set[int] = set()

    def finish(index: int, frame: Frame | None) -> None:
        writer.done(index)
        if progress is not None and index not in again:
            progress(index, frame)
        writer.save_now_and_then()

    try:
        with EncodingThreads(writer, finish) as threads:
            if pack:
                again.update(writer.plan(indices))
                for index in sorted(again):
                    threads.write(stream[index], stream)
            if not indices:
                writer.claim((), ())
            for index in indices:
                if writer.holds(index):
                    threads.skip(index)
                else:
                    threads.write(stream[index], stream)
    finally:
        writer.finish()
