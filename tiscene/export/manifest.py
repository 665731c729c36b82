# SPDX-License-Identifier: Apache-2.0
"""The manifest `tiscene.json` of an export folder: how its frames were made, and digests of frames, buffers and files.

With it an interrupted export is continued, and a replay is verified. Digests are SHA-256, as hexadecimal digits.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import re
from collections.abc import Iterator, Mapping, MutableMapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import ExportError
from tiscene.files import write_atomically

if TYPE_CHECKING:
    from tiscene.frame.frame import Frame

NAME = "tiscene.json"
_TAKEN = ("pieces", "shards")  # folders of unfinished files of many frames, and of parts
_REQUIRED = ("tiscene", "format", "buffers", "objects", "settings", "scenario", "file_digests")  # of `provenance`


class FrameEntries(MutableMapping[int, dict[str, Any]]):
    """The entries of frames by index, kept as JSON text: a kilobyte a frame, and the file is written at once."""

    def __init__(self) -> None:
        self._texts: dict[int, bytes] = {}

    def __getitem__(self, index: int) -> dict[str, Any]:
        entry: dict[str, Any] = json.loads(self._texts[index])
        return entry

    def __setitem__(self, index: int, entry: dict[str, Any]) -> None:
        self._texts[index] = json.dumps(entry, indent=1).replace("\n", "\n  ").encode()

    def __delitem__(self, index: int) -> None:
        del self._texts[index]

    def __iter__(self) -> Iterator[int]:
        return iter(sorted(self._texts))

    def __len__(self) -> int:
        return len(self._texts)

    def __contains__(self, index: object) -> bool:
        return index in self._texts

    def texts(self) -> Iterator[bytes]:
        """Yield all entries as the parts of a JSON object."""
        yield b"{"
        for place, index in enumerate(self):
            yield b'%b\n  "%d": ' % (b"," if place else b"", index)
            yield self._texts[index]
        yield b"\n }" if self._texts else b"}"


def listed_frames(*folders: Path) -> list[int]:
    """Return the frames that the manifests of folders list, as far as they are saved, without parsing their JSON."""
    found: list[int] = []
    for folder in folders:
        with contextlib.suppress(OSError):
            found += map(int, re.findall(rb'\n  "(\d+)": {', (folder / NAME).read_bytes()))
    return found


@dataclass
class Manifest:
    """The contents of `tiscene.json`.

    Where several cameras took the frames, the names of buffers and files begin with a folder for each camera.

    Attributes:
        provenance: Everything that decides the contents of the files: version, format, buffers, objects, settings,
            scenario, file_digests (of the scene and its templates); `name`, if it is in a data set.
        categories: The names of the ids in `semantic`.
        materials: The names of the ids in `material_coverage`; empty without that buffer.
        frames: For each frame index the `digest` of the frame, of each of its `buffers` (`buffer_digest`, the same in
            every format) and of each of its `files` (the bytes).
    """

    provenance: dict[str, Any]
    categories: dict[int, str] = field(default_factory=dict)
    materials: dict[int, str] = field(default_factory=dict)
    frames: FrameEntries = field(default_factory=FrameEntries)

    @classmethod
    def load(cls, folder: Path) -> Manifest | None:
        """Read the manifest of a folder; return None if it has none.

        Raises:
            ExportError: The file is not a manifest.
        """
        path = folder / NAME
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            frames = FrameEntries()
            for index, entry in content.pop("frames").items():
                for part in ("buffers", "files"):
                    entry[part].items()
                frames[int(index)] = entry
            categories, materials = (
                {int(key): str(name) for key, name in names.items()}
                for names in (content.pop("categories"), content.pop("materials", {}))
            )
            for name in _REQUIRED:
                content[name]
        except (FileNotFoundError, NotADirectoryError):
            return None
        except OSError as error:
            raise ExportError(f"{path} cannot be read: {error.strerror}") from error
        except (ValueError, KeyError, AttributeError, TypeError) as error:
            raise ExportError(
                f"{path} is damaged, or is not a manifest of tiscene: choose another folder, or delete that one"
            ) from error
        return cls(content, categories, materials, frames)

    def save(self, folder: Path) -> None:
        """Write the file atomically: a reader sees the old manifest or the new one."""
        content = {
            **self.provenance,
            "categories": {str(key): self.categories[key] for key in sorted(self.categories)},
            "materials": {str(key): self.materials[key] for key in sorted(self.materials)},
        }
        head = json.dumps(content, indent=1).encode().removesuffix(b"\n}")
        write_atomically(folder / NAME, b"".join([head, b',\n "frames": ', *self.frames.texts(), b"\n}\n"]))

    @property
    def folders(self) -> list[str]:
        """The folders of the cameras, each with a "/" at its end; [""] for a single camera."""
        first = next(iter(self.frames), None)  # all frames have the same cameras
        names = self.frames[first]["buffers"] if first is not None else ()
        return sorted({"".join(name.rpartition("/")[:2]) for name in names}) or [""]


def frame_entry(frame: Frame, files: Mapping[str, bytes]) -> dict[str, Any]:
    """Return the entry of a frame in `Manifest.frames`.

    Args:
        frame: The frame.
        files: The contents of its files, by path relative to the folder.
    """
    buffers = buffer_digests(frame)
    lines = [f"{name} {digest}\n" for name, digest in sorted(buffers.items())]
    return {
        "digest": hashlib.sha256("".join(lines).encode()).hexdigest(),
        "buffers": buffers,
        "files": {name: hashlib.sha256(data).hexdigest() for name, data in files.items()},
    }


def buffer_digest(buffer: NDArray[Any]) -> str:
    """Return the digest of the dtype, shape and little-endian bytes of an array."""
    array = np.ascontiguousarray(buffer, dtype=buffer.dtype.newbyteorder("<"))
    digest = hashlib.sha256(f"{array.dtype.str} {array.shape}\n".encode())
    digest.update(array.data)
    return digest.hexdigest()


def views_by_folder(frame: Frame) -> dict[str, Frame]:
    """Return the view of each camera by the folder of its files, which ends in "/"; {"": frame} for a single camera.

    A folder has the camera's name, with `_` for characters that are unsafe in file names, for an empty name, and behind
    a name in _TAKEN.

    Raises:
        ExportError: Two cameras would share a folder.
    """
    if len(frame.views) == 1:
        return {"": frame}
    result: dict[str, Frame] = {}
    for name, view in frame.views.items():
        folder = re.sub(r"[^\w .-]|^[ .]|[ .]$", "_", name) or "_"
        folder += "_/" if folder.lower() in _TAKEN else "/"
        if folder.lower() in map(str.lower, result):
            names = ", ".join(map(repr, frame.views))
            raise ExportError(f"two of the cameras {names} would write into the folder {folder!r}: rename one")
        result[folder] = view
    return result


def buffer_digests(frame: Frame) -> dict[str, str]:
    """Return the digest of each buffer of a frame; names begin with the camera's folder if there are several."""
    return {
        f"{folder}{name}": buffer_digest(buffer)
        for folder, view in views_by_folder(frame).items()
        for name, buffer in view.buffers.items()
    }


def file_digest(path: Path) -> str | None:
    """Return the SHA-256 of a file; None if it cannot be read."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return None
