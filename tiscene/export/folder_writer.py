# SPDX-License-Identifier: Apache-2.0
"""FolderWriter: writes the frames of one export into its folder, in any format."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynamics.lru_cache import LRUCache
from tiscene.errors import ExportError
from tiscene.export import frame_json
from tiscene.export.array_files import Contents, resolved
from tiscene.export.formats import find_format
from tiscene.export.manifest import NAME, Manifest, frame_entry, views_by_folder
from tiscene.export.packing import (
    ExportRun,
    content_digest,
    has_pieces,
    pieces_file,
    place_group,
    remove_leftovers,
    write_group,
)
from tiscene.export.packing_thread import PackingThread
from tiscene.files import write_atomically

if TYPE_CHECKING:
    from tiscene.frame.frame import Frame
    from tiscene.stream.stream import Stream

MIN_SAVE_INTERVAL = 2.0  # s between two writes of the manifest
MAX_SAVE_SHARE = 0.05  # of the time, spent on writing the manifest
MAX_DIGESTS = 64  # files whose digests are kept while frames are checked


@dataclass(frozen=True)
class WrittenFrame:
    """What the manifest gets to know of a frame whose files are there.

    Attributes:
        entry: Its entry in `Manifest.frames`.
        categories: The names of the ids in `semantic`.
        materials: The names of the ids in `material_coverage`.
    """

    entry: dict[str, Any]
    categories: Mapping[int, str]
    materials: Mapping[int, str]


class FolderWriter:
    """Writes frames into a folder that this process has locked.

    Args:
        folder: The folder.
        manifest: Its manifest, which the writer updates and saves.
    """

    def __init__(self, folder: Path, manifest: Manifest) -> None:
        self.folder, self.manifest = folder, manifest
        self._objects = manifest.provenance["objects"]
        self._format = find_format(manifest.provenance["format"]).writer()
        self._packs = hasattr(self._format, "pack")
        self._digests: LRUCache[str, str | None] = LRUCache(MAX_DIGESTS)  # of files that were checked last
        self._groups: dict[int, list[int]] = {}  # frames of each file of many frames, ascending
        self._waiting: dict[int, set[int]] = {}  # those of them that are not in the folder yet
        self._thread: PackingThread | None = None
        self._first: int | None = None  # frame of the export; None: that of a shard, or not known
        self._saved_at, self._save_duration = time.monotonic(), 0.0
        self._is_new = not (folder / NAME).exists()

    def claim(self, names: Iterable[str], cameras: Iterable[str]) -> None:
        """Save the manifest of a folder without one, before its first file: a killed export is told from other files.

        Args:
            names: The files of the first frame that is written.
            cameras: The folders of the cameras.

        Raises:
            ExportError: The folder has a file that one of some frame may replace.
        """
        if not self._is_new:
            return
        packed = [*getattr(self._format, "PACKED", ()), *getattr(self._format, "SUMMARY", ())]
        present = [path for camera in cameras for name in packed for path in self.folder.glob(f"{camera}{name}")]
        for name in names:
            alike = re.compile(re.sub(r"\d+", r"\\d+", re.escape(name)))  # names of frames differ in their numbers
            found = self.folder.glob(re.sub(r"\d+", "*", name))
            present += [each for each in found if alike.fullmatch(each.relative_to(self.folder).as_posix())]
        if present:
            raise ExportError(
                f"{str(min(present))!r} is there and is not of this export, which writes files of such names: "
                "choose another folder, or move it away"
            )
        self.manifest.save(self.folder)
        self._is_new = False

    def plan(self, indices: Collection[int]) -> list[int]:
        """Prepare to write the frames of an export, and return further ones that must be rendered again.

        A file of many frames cannot be extended: where it gets more frames, all of its frames are needed again.

        Args:
            indices: The frames that will be written.

        Raises:
            ExportError: The format cannot write these frames beside those that are there.
        """
        if hasattr(self._format, "check_frames"):
            self._format.check_frames({*indices, *self.manifest.frames})
        if hasattr(self._format, "of_previous"):
            self._first = min({*indices, *self.manifest.frames}, default=None)
            others = set(self.manifest.frames) - set(indices)
            return sorted(index for index in others if self._lacks_file_of_previous(index))
        if not self._packs:
            return []
        requested, again = set(indices), []
        groups = {self._group(index) for index in requested}
        for index in requested | {index for index in self.manifest.frames if self._group(index) in groups}:
            self._waiting.setdefault(self._group(index), set()).add(index)
        for group, waiting in self._waiting.items():
            self._groups[group] = sorted(waiting)
            present = [index for index in self._groups[group] if index in self.manifest.frames]
            packed = [index for index in present if not has_pieces(self.manifest.frames[index])]
            if len(packed) < len(waiting) or not all(map(self.holds, packed)):
                for index in packed:
                    del self.manifest.frames[index]
            again += [index for index in present if index not in requested and not self.holds(index)]
        return again

    def holds(self, index: int) -> bool:
        """Return whether every file of a frame is in the folder with the recorded digest."""
        entry = self.manifest.frames.get(index)
        files = entry["files"] if entry else {}
        if not files or self._lacks_file_of_previous(index):
            return False
        return all(self._digest(name) == digest for name, digest in files.items())

    def left_out(self, index: int) -> tuple[str, ...]:
        """Return the names of files of a frame, in the folder of each camera, that belong to no frame of the export."""
        names: tuple[str, ...] = self._format.of_previous(index) if self._first == index else ()
        return names

    def _lacks_file_of_previous(self, index: int) -> bool:
        """Return whether a frame was the first one when it was written, and is not now."""
        if self._first is None or index == self._first:
            return False
        files = self.manifest.frames[index]["files"]
        return any(
            f"{camera}{name}" not in files
            for camera in self.manifest.folders
            for name in self._format.of_previous(index)
        )

    def writing(self, frame: Frame, stream: Stream) -> Callable[[], WrittenFrame]:
        """Return a function that writes the files of a frame, in any thread; `record` takes what it returns.

        What needs the renderer, such as the boxes of objects, is computed here.
        """
        contents: dict[str, Contents] = {}
        views = views_by_folder(frame)
        for camera, view in views.items():
            files = dict(self._format.encode(view)) if hasattr(self._format, "encode") else {}
            if self._packs:
                labels = frame_json.frame_labels(view, self._objects)
                files |= pieces_file(view.index, self._format.pieces(view, labels, stream))
            if not getattr(self._format, "HOLDS_LABELS", False):
                files |= frame_json.encode(view, self._objects)
            unused = self.left_out(view.index)
            contents |= {f"{camera}{name}": content for name, content in files.items() if name not in unused}
        self.claim(contents, views)
        categories = dict(stream.categories)
        materials = dict(frame.materials) if "material_coverage" in stream.buffers else {}

        def write() -> WrittenFrame:
            written = resolved(contents)
            for name, data in written.items():
                write_atomically(self.folder / name, data)
            return WrittenFrame(frame_entry(frame, written), categories, materials)

        return write

    def record(self, index: int, written: WrittenFrame) -> None:
        """List a frame in the manifest."""
        self.forget(written.entry["files"])
        self.manifest.categories = dict(written.categories)
        self.manifest.materials = dict(written.materials)
        self.manifest.frames[index] = written.entry

    def forget(self, files: Iterable[str]) -> None:
        """Forget the digests of files that have been written."""
        self._digests.drop(set(files).__contains__)

    def done(self, index: int) -> None:
        """Note that a frame is in the folder; pack its group if that was the last one that the group waited for."""
        group = self._group(index) if self._groups else -1
        if group not in self._groups:
            return
        self._waiting[group].discard(index)
        if has_pieces(self.manifest.frames[index]):
            self._pack(index, self._groups[group], self._waiting[group])

    def _pack(self, index: int, group: Sequence[int], waiting: Set[int]) -> None:
        """Begin to pack the group of a frame that has arrived, or go on; end if it waits for no further one."""
        if self._thread is None and waiting and getattr(self._format, "READS_ONCE", False):
            present = set(group) - waiting
            self._thread = PackingThread(self._format, self.folder, self.manifest, group, present)
        mine = self._thread if self._thread is not None and self._thread.indices is group else None
        if mine is not None:
            mine.add(index)
        if waiting:
            return
        if mine is not None:
            known = mine.finish()
            self._thread = None
        else:
            known = write_group(self._format, self.folder, ExportRun.of(self.manifest), self.manifest.folders, group)
        place_group(self._format, self.folder, self.manifest, group, known)
        self._digests.drop(lambda name: True)

    def save_now_and_then(self) -> None:
        """Save the manifest, if some time has passed."""
        if time.monotonic() - self._saved_at > max(MIN_SAVE_INTERVAL, self._save_duration / MAX_SAVE_SHARE):
            began = time.monotonic()
            self.manifest.save(self.folder)
            self._saved_at = time.monotonic()
            self._save_duration = self._saved_at - began

    def finish(self) -> None:
        """Save the manifest, and write the files about all frames."""
        if self._thread is not None:
            self._thread.stop()
            self._thread = None
        if self._is_new:
            return  # nothing has been written
        self.manifest.save(self.folder)
        remove_leftovers(self.folder, self.manifest)
        for name, data in self.summary().items():
            write_atomically(self.folder / name, data)

    def summary(self) -> dict[str, bytes]:
        """Return the files about all frames by name."""
        files = self._format.summary(ExportRun.of(self.manifest)) if hasattr(self._format, "summary") else {}
        return {f"{camera}{name}": data for camera in self.manifest.folders for name, data in files.items()}

    def _group(self, index: int) -> int:
        size = self._format.FRAMES_PER_FILE
        return 0 if size is None else index // int(size)

    def _digest(self, name: str) -> str | None:
        """Return the digest of a file. A file of many frames is read once, not once a frame."""
        return self._digests.get(name, lambda: content_digest(self._format, self.folder / name))
