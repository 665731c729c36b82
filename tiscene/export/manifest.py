# SPDX-License-Identifier: Apache-2.0
"""The manifest `tiscene.json` of an export folder: how its frames were made, and digests of frames, buffers and files.

With it an interrupted export is continued, and a replay is verified. Digests are SHA-256, as hexadecimal digits.
"""

from __future__ import annotations

import hashlib
import json
import re
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


@dataclass
class Manifest:
    """The contents of `tiscene.json`.

    Where several cameras took the frames, the names of buffers and files begin with a folder for each camera.

    Attributes:
        provenance: Everything that decides the contents of the files: version, format, buffers, objects, settings,
            scenario, file_digests (of the scene and its templates).
        categories: The names of the ids in `semantic`.
        materials: The names of the ids in `material_coverage`; empty without that buffer.
        frames: For each frame index the `digest` of the frame, of each of its `buffers` (`buffer_digest`, the same in
            every format) and of each of its `files` (the bytes).
    """

    provenance: dict[str, Any]
    categories: dict[int, str] = field(default_factory=dict)
    materials: dict[int, str] = field(default_factory=dict)
    frames: dict[int, dict[str, Any]] = field(default_factory=dict)

    @classmethod
    def load(cls, folder: Path) -> Manifest | None:
        """Read the manifest of a folder; return None if it has none.

        Raises:
            ExportError: The file is not a manifest.
        """
        path = folder / NAME
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            frames = {int(index): dict(entry) for index, entry in content.pop("frames").items()}
            for entry in frames.values():
                entry["files"].items()
            categories, materials = (
                {int(key): str(name) for key, name in names.items()}
                for names in (content.pop("categories"), content.pop("materials", {}))
            )
        except (FileNotFoundError, NotADirectoryError):
            return None
        except (OSError, ValueError, KeyError, AttributeError, TypeError) as error:
            raise ExportError(
                f"{path} is not a manifest of tiscene ({error!r}): choose another folder, or delete that file"
            ) from error
        return cls(content, categories, materials, frames)

    def save(self, folder: Path) -> None:
        """Write the file atomically: a reader sees the old manifest or the new one."""
        content = {
            **self.provenance,
            "categories": {str(key): self.categories[key] for key in sorted(self.categories)},
            "materials": {str(key): self.materials[key] for key in sorted(self.materials)},
            "frames": {str(index): self.frames[index] for index in sorted(self.frames)},
        }
        write_atomically(folder / NAME, (json.dumps(content, indent=1) + "\n").encode())

    def record(self, frame: Frame, files: dict[str, bytes]) -> None:
        """Add a frame whose files have been written.

        Args:
            frame: The frame.
            files: The contents of its files, by path relative to the folder.
        """
        buffers = _buffer_digests(frame)
        self.frames[frame.index] = {
            "digest": _digest_of(buffers),
            "buffers": buffers,
            "files": {name: hashlib.sha256(data).hexdigest() for name, data in files.items()},
        }

    @property
    def folders(self) -> list[str]:
        """The folders of the cameras, each with a "/" at its end; [""] for a single camera."""
        folders = {"".join(name.rpartition("/")[:2]) for entry in self.frames.values() for name in entry["buffers"]}
        return sorted(folders) or [""]

    def holds(self, folder: Path, index: int) -> bool:
        """Return whether every file of a frame is in the folder with the recorded digest."""
        files = self.frames.get(index, {}).get("files", {})
        return bool(files) and all(_file_digest(folder / name) == digest for name, digest in files.items())


def buffer_digest(buffer: NDArray[Any]) -> str:
    """Return the digest of the dtype, shape and little-endian bytes of an array."""
    array = np.ascontiguousarray(buffer, dtype=buffer.dtype.newbyteorder("<"))
    header = f"{array.dtype.str} {array.shape}\n"
    return hashlib.sha256(header.encode() + array.tobytes()).hexdigest()


def frame_digest(frame: Frame) -> str:
    """Return the digest of the names and digests of a frame's buffers, sorted by name."""
    return _digest_of(_buffer_digests(frame))


def views_by_folder(frame: Frame) -> dict[str, Frame]:
    """Return the view of each camera by the folder of its files, which ends in "/"; {"": frame} for a single camera.

    A folder has the camera's name, with `_` for characters that are unsafe in file names.

    Raises:
        ExportError: Two cameras would share a folder.
    """
    if len(frame.views) == 1:
        return {"": frame}
    result: dict[str, Frame] = {}
    for name, view in frame.views.items():
        folder = re.sub(r"[^\w .-]|^[ .]|[ .]$", "_", name) + "/"
        if folder.lower() in map(str.lower, result):
            names = ", ".join(map(repr, frame.views))
            raise ExportError(f"two of the cameras {names} would write into the folder {folder!r}: rename one")
        result[folder] = view
    return result


def _buffer_digests(frame: Frame) -> dict[str, str]:
    return {
        f"{folder}{name}": buffer_digest(buffer)
        for folder, view in views_by_folder(frame).items()
        for name, buffer in view.buffers.items()
    }


def _digest_of(buffers: dict[str, str]) -> str:
    lines = [f"{name} {digest}\n" for name, digest in sorted(buffers.items())]
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def _file_digest(path: Path) -> str | None:
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return None
