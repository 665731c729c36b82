# SPDX-License-Identifier: Apache-2.0
"""Merge parts of an export into one, with the bytes of an export that was made in one go."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

from tiscene.errors import ExportError, counted
from tiscene.export.exporter import open_manifest, writing_into
from tiscene.export.folder_writer import FolderWriter
from tiscene.export.formats import find_format
from tiscene.export.manifest import Manifest, file_digest
from tiscene.export.manifest_difference import differences, listing
from tiscene.export.packing import has_pieces
from tiscene.export.shards import SHARDS, Shard
from tiscene.files import replacing


def merge(
    folder: str | Path,
    parts: Sequence[str | Path] = (),
    *,
    partial: bool = False,
    unlike: bool = False,
    overwrite: bool = False,
    progress: Callable[[int], None] | None = None,
) -> Manifest:
    """Merge parts of an export. Merging again, also after a kill, or with further parts, is safe.

    Files are linked where the file system permits it, else copied. The parts stay as they are.

    Args:
        folder: The folder of the merged export; may hold an earlier merge.
        parts: Folders of the parts; () for all in `shards` in that folder.
        partial: Merge although frames are missing.
        unlike: Merge parts of machines that may render other bytes.
        overwrite: Delete the frames of another export in the folder instead of refusing.
        progress: Called with the index of each merged frame.

    Returns:
        The manifest of the merged export: that of an export in one go.

    Raises:
        ExportError: There are no parts; they have other settings, were made by unlike machines, lack frames, are
            damaged, or have the same frame with different bytes. Nothing has been written then.
    """
    folder = Path(folder)
    places = part_folders(folder, parts)
    if not places:
        raise ExportError(
            f"{str(folder / SHARDS)!r} has no shards: render them with --shard I/N, or name their folders"
        )
    manifests = {place: _manifest(place) for place in places}
    owners = _owners(manifests)
    shards = {place: shard for place in places if (shard := Shard.load(place)) is not None}
    _check_complete(shards, owners, partial, unlike)
    _check_files(manifests, shards, owners)
    with writing_into(folder):
        return _merge(folder, manifests, owners, overwrite, progress)


def part_folders(folder: Path, parts: Sequence[str | Path]) -> list[Path]:
    """Return the folders of parts of an export: the given ones, else all in `shards` in its folder."""
    return [Path(part) for part in parts] or sorted(path for path in (folder / SHARDS).glob("*") if path.is_dir())


def _manifest(place: Path) -> Manifest:
    """Return the manifest of a part."""
    manifest = Manifest.load(place)
    if manifest is None:
        raise ExportError(f"{str(place)!r} is not a part of an export: it has no tiscene.json")
    if hasattr(find_format(manifest.provenance["format"]).writer(), "pack"):
        packed = [index for index, entry in manifest.frames.items() if not has_pieces(entry)]
        if packed:
            raise ExportError(f"{str(place)!r} holds files of many frames, which cannot be merged: render with --shard")
    return manifest


def _owners(manifests: dict[Path, Manifest]) -> dict[int, Path]:
    """Return the part of each frame. Parts must have the same settings, and shared frames the same bytes."""
    (first, reference), *others = manifests.items()
    for place, manifest in others:
        found = differences(reference.provenance, manifest.provenance)
        if found:
            raise ExportError(f"the parts {str(first)!r} and {str(place)!r} have other settings:{listing(found)}")
    owners: dict[int, Path] = {}
    for place, manifest in manifests.items():
        for index, entry in manifest.frames.items():
            other = owners.setdefault(index, place)
            if other != place and manifests[other].frames[index] != entry:
                raise ExportError(f"frame {index} differs between {str(other)!r} and {str(place)!r}")
    return owners


def _check_complete(shards: Mapping[Path, Shard], owners: dict[int, Path], partial: bool, unlike: bool) -> None:
    """Raise ExportError if frames are missing, or if the machines of the parts differ."""
    machines = {place: shard.machine for place, shard in shards.items()}
    kinds = {tuple(sorted(machine.items())): place for place, machine in machines.items()}
    if len(kinds) > 1 and not unlike:
        one, other = list(kinds.values())[:2]
        names = [name for name in machines[one] if machines[one][name] != machines[other].get(name)]
        raise ExportError(
            f"{str(one)!r} and {str(other)!r} were made by unlike machines ({', '.join(names)}), whose color may "
            "differ in the last bits: compare some frames with `tiscene verify`, then merge with --unlike"
        )
    wanted = {index for frames in {shard.all_frames for shard in shards.values()} for index in frames}
    missing = sorted(wanted - owners.keys())
    if missing and not partial:
        lacking = [
            f"{shard.number}/{shard.count}"
            for shard in sorted(shards.values(), key=lambda shard: shard.number)
            if not owners.keys() >= set(shard.own_frames)
        ]
        count = max(shard.count for shard in shards.values())
        absent = sorted(set(range(count)) - {shard.number for shard in shards.values()})
        lacking += [f"{number}/{count}" for number in absent]
        raise ExportError(
            f"{counted(len(missing), 'frame is', 'frames are')} missing, the first is {missing[0]}: render the "
            f"shards {', '.join(lacking)} (again), or merge what is there with --partial"
        )


def _check_files(manifests: Mapping[Path, Manifest], shards: Mapping[Path, Shard], owners: dict[int, Path]) -> None:
    """Raise ExportError, which names all parts to render again, unless all files have the recorded digests."""
    damaged: dict[Path, list[Path]] = {}
    for index, place in owners.items():
        for name, digest in manifests[place].frames[index]["files"].items():
            if file_digest(place / name) != digest:
                damaged.setdefault(place, []).append(place / name)
    if damaged:
        names = [
            f"{shards[place].number}/{shards[place].count}" if place in shards else repr(str(place))
            for place in damaged
        ]
        first = next(iter(damaged.values()))[0]
        raise ExportError(
            f"{counted(sum(map(len, damaged.values())), 'file is', 'files are')} missing or damaged, the first is "
            f"{str(first)!r}: render the shards {', '.join(names)} (again)"
        )


def _merge(
    folder: Path,
    manifests: dict[Path, Manifest],
    owners: dict[int, Path],
    overwrite: bool,
    progress: Callable[[int], None] | None,
) -> Manifest:
    """Link the files of all frames into the folder, and pack files of many frames."""
    reference = next(iter(manifests.values()))
    merged = open_manifest(folder, reference.provenance, overwrite)
    for manifest in manifests.values():
        merged.categories |= manifest.categories
        merged.materials |= manifest.materials
    writer = FolderWriter(folder, merged)
    frames = sorted(owners)
    lost = [index for index in writer.plan(frames) if index not in owners]
    if lost:
        raise ExportError(
            f"{str(folder)!r} was merged with frames that are in no part now, such as {lost[0]}: name all parts that "
            "it was merged of, or merge into another folder"
        )
    try:
        if not frames:
            writer.claim((), ())
        for index in frames:
            if not writer.holds(index):
                entry = manifests[owners[index]].frames[index]
                unused = writer.left_out(index)
                files = {name: digest for name, digest in entry["files"].items() if not name.endswith(unused)}
                writer.claim(files, reference.folders)
                _link_files(owners[index], folder, files)
                merged.frames[index] = entry | {"files": files}
                writer.forget(files)
            writer.done(index)
            writer.save_now_and_then()
            if progress is not None:
                progress(index)
    finally:
        writer.finish()
    return merged


def _link_files(part: Path, folder: Path, names: Iterable[str]) -> None:
    """Link or copy files of a part into the folder."""
    for name in names:
        with replacing(folder / name) as temporary:
            try:
                os.link(part / name, temporary)
            except OSError:  # another file system, or one without links
                shutil.copyfile(part / name, temporary)
