# SPDX-License-Identifier: Apache-2.0
"""Write frames into a folder, with a manifest by which an interrupted export continues.

A format is a module of this package with `encode(frame) -> {file name: contents}` and a line in EXPORTERS. Views of
several cameras are written into one folder per camera.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tiscene
from tiscene.errors import ArgumentError, ExportError
from tiscene.export import cryptomatte, exr, frame_json, npz, png, sailenv_layout
from tiscene.export.manifest import NAME, Manifest, views_by_folder
from tiscene.files import write_atomically

if TYPE_CHECKING:
    from tiscene.frame.frame import Frame
    from tiscene.stream.stream import Stream

EXPORTERS: Mapping[str, Callable[[Frame], dict[str, bytes]]] = {
    "cryptomatte": cryptomatte.encode,
    "exr": exr.encode,
    "npz": npz.encode,
    "png": png.encode,
    "sailenv": sailenv_layout.encode,
}
# What a format has to say of all frames together: names of the files, and their contents.
SUMMARIES: Mapping[str, tuple[Sequence[str], Callable[[Stream, Manifest], dict[str, bytes]]]] = {
    "sailenv": (sailenv_layout.SUMMARY, sailenv_layout.summary)
}
# What a format cannot do without.
NEEDED: Mapping[str, Sequence[str]] = {"cryptomatte": cryptomatte.BUFFERS, "sailenv": sailenv_layout.BUFFERS}


def export(
    stream: Stream,
    folder: str | Path,
    *,
    format: str = "png",
    frames: Iterable[int] | None = None,
    objects: bool = False,
    overwrite: bool = False,
    progress: Callable[[int, Frame | None], None] | None = None,
) -> Manifest:
    """Write frames of a stream into a folder; return the manifest, which is saved there as `tiscene.json`.

    format: a key of EXPORTERS. frames: their indices, in any order; None for all of a finite stream.
    objects: write the table of objects of each frame too, into the `labels` file that has the camera.
    overwrite: remove what an earlier export with other settings left in the folder, instead of refusing.
    progress: called after each frame with its index and the frame, or None where the files were already there.

    A frame whose files are in the folder with the very bytes is not rendered again, so the same call goes on after an
    interruption. Raises ExportError if the folder holds frames that were made otherwise, or cannot be written.
    """
    if format not in EXPORTERS:
        raise ArgumentError(f"format={format!r}: must be one of {', '.join(EXPORTERS)}")
    missing = [name for name in NEEDED.get(format, ()) if name not in stream.buffers]
    if missing:
        all_of_them = (*stream.buffers, *missing)
        raise ArgumentError(f"format={format!r}: needs the buffer {missing[0]!r}; ask for buffers={all_of_them!r}")
    if frames is None:
        if stream.frames is None:
            raise ArgumentError("an endless stream needs frames=range(...) to be exported")
        frames = range(stream.frames)
    folder = Path(folder)
    if folder.exists() and not folder.is_dir():
        raise ExportError(f"cannot write into {str(folder)!r}: it is a file, not a folder")
    wanted = made_by(stream, format, objects)
    manifest = _continued(folder, wanted, overwrite)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _write_frames(stream, folder, frames, manifest, progress)
    except OSError as error:
        raise ExportError(f"cannot write into {str(folder)!r}: {error}") from error
    return manifest


def made_by(stream: Stream, format: str, objects: bool) -> dict[str, Any]:
    """Everything that decides the contents of the files, JSON-ready."""
    return {
        "tiscene": tiscene.__version__,
        "format": format,
        "buffers": list(stream.buffers),
        "objects": objects,
        "settings": stream.settings(),
        "scenario": stream.scenario.to_json(),
        "layers": stream.file_digests(),
    }


def _continued(folder: Path, wanted: dict[str, Any], overwrite: bool) -> Manifest:
    """The folder's manifest if it was made in the same way, else a new one."""
    present = Manifest.load(folder)
    if present is None:
        return Manifest(wanted)
    differences = present.differences(wanted)
    if not differences:
        return present
    if not overwrite:
        listing = "".join(f"\n  {line}" for line in differences)
        raise ExportError(
            f"{str(folder)!r} holds frames that were made otherwise:{listing}\n"
            "Choose another folder, or replace them with --overwrite (overwrite=True)."
        )
    _remove(folder, present)
    return Manifest(wanted)


def _remove(folder: Path, manifest: Manifest) -> None:
    """Delete the files that a manifest lists, and nothing else."""
    root = folder.resolve()
    for entry in manifest.frames.values():
        for name in entry["files"]:
            path = (folder / name).resolve()
            if path.is_relative_to(root):
                path.unlink(missing_ok=True)
    for name in SUMMARIES.get(manifest.made_by["format"], ((), None))[0]:
        for camera in manifest.folders:
            (folder / camera / name).unlink(missing_ok=True)
    (folder / NAME).unlink()


def _write_frames(
    stream: Stream,
    folder: Path,
    indices: Iterable[int],
    manifest: Manifest,
    progress: Callable[[int, Frame | None], None] | None,
) -> None:
    encode, objects = EXPORTERS[manifest.made_by["format"]], bool(manifest.made_by["objects"])
    saved_at, saving_took = time.monotonic(), 0.0
    try:
        for index in indices:
            frame = None
            if not manifest.holds(folder, index):
                frame = stream[index]
                files = {
                    f"{camera}{name}": data
                    for camera, view in views_by_folder(frame).items()
                    for name, data in (encode(view) | frame_json.encode(view, objects)).items()
                }
                for name, data in files.items():
                    write_atomically(folder / name, data)
                manifest.categories = dict(stream.categories)
                if "material_coverage" in stream.buffers:
                    manifest.materials = dict(frame.materials)
                manifest.record(frame, files)
            if progress is not None:
                progress(index, frame)
            # Often enough to lose little if killed, seldom enough that a long manifest costs less than 5 %.
            if time.monotonic() - saved_at > max(2.0, 20.0 * saving_took):
                began = time.monotonic()
                manifest.save(folder)
                saved_at = time.monotonic()
                saving_took = saved_at - began
    finally:
        manifest.save(folder)
        if manifest.made_by["format"] in SUMMARIES:
            for name, data in SUMMARIES[manifest.made_by["format"]][1](stream, manifest).items():
                for camera in manifest.folders:
                    write_atomically(folder / camera / name, data)
