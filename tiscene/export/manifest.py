# SPDX-License-Identifier: Apache-2.0
"""`tiscene.json`: what an export folder holds and how it was made, so that it can be verified and gone on with."""

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

    made_by: everything that decides the contents of the files (version, format, buffers, settings, scenario, layers).
    categories: what the ids of `semantic` mean. materials: those of `material_coverage`, where that was asked for.
    frames: for each index the digest of the frame, of each buffer (`buffer_digest`, whatever the file format) and of
    each file (SHA-256 of its bytes). Where several cameras took it, names of buffers and files begin with a folder for
    each.
    """

    made_by: dict[str, Any]
    categories: dict[int, str] = field(default_factory=dict)
    materials: dict[int, str] = field(default_factory=dict)
    frames: dict[int, dict[str, Any]] = field(default_factory=dict)

    @classmethod
    def load(cls, folder: Path) -> Manifest | None:
        """The manifest of a folder, None if it has none. Raises ExportError for a file that is not one."""
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
                f"{path} is not a manifest of tiscene ({error!r}); choose another folder, or delete that file"
            ) from error
        return cls(content, categories, materials, frames)

    def save(self, folder: Path) -> None:
        """Write it in one step: a reader sees the old manifest or the new one, never a part."""
        content = {
            **self.made_by,
            "categories": {str(key): self.categories[key] for key in sorted(self.categories)},
            "materials": {str(key): self.materials[key] for key in sorted(self.materials)},
            "frames": {str(index): self.frames[index] for index in sorted(self.frames)},
        }
        write_atomically(folder / NAME, (json.dumps(content, indent=1) + "\n").encode())

    def differences(self, made_by: dict[str, Any]) -> list[str]:
        """One line for each thing that was made otherwise: "settings.seed: 0 there, 1 now"."""
        return _differences("", self.made_by, json.loads(json.dumps(made_by)))

    def record(self, frame: Frame, files: dict[str, bytes]) -> None:
        """Note a frame whose files are written."""
        buffers = _buffer_digests(frame)
        self.frames[frame.index] = {
            "digest": _digest_of(buffers),
            "buffers": buffers,
            "files": {name: hashlib.sha256(data).hexdigest() for name, data in files.items()},
        }

    @property
    def folders(self) -> list[str]:
        """Those of the cameras, each with a "/" at its end; [""] where only one took the frames."""
        folders = {"".join(name.rpartition("/")[:2]) for entry in self.frames.values() for name in entry["buffers"]}
        return sorted(folders) or [""]

    def holds(self, folder: Path, index: int) -> bool:
        """Whether every file of a frame is in the folder, with the very bytes."""
        files = self.frames.get(index, {}).get("files", {})
        return bool(files) and all(_file_digest(folder / name) == digest for name, digest in files.items())


def buffer_digest(buffer: NDArray[Any]) -> str:
    """SHA-256 of dtype, shape and little-endian bytes of an array, as hexadecimal digits."""
    array = np.ascontiguousarray(buffer, dtype=buffer.dtype.newbyteorder("<"))
    header = f"{array.dtype.str} {array.shape}\n"
    return hashlib.sha256(header.encode() + array.tobytes()).hexdigest()


def frame_digest(frame: Frame) -> str:
    """SHA-256 over the names and digests of a frame's buffers, in the order of the names."""
    return _digest_of(_buffer_digests(frame))


def views_by_folder(frame: Frame) -> dict[str, Frame]:
    """What each camera saw, by the folder that its files are in, a "/" at its end; "" for a camera alone.

    A folder is called as the camera, with `_` for what names of files should not hold. Raises ExportError if two
    cameras would share one.
    """
    if not frame.others:
        return {"": frame}
    result: dict[str, Frame] = {}
    for name, view in frame.views.items():
        folder = re.sub(r"[^\w .-]|^[ .]|[ .]$", "_", name) + "/"
        if folder.lower() in map(str.lower, result):
            names = ", ".join(map(repr, frame.views))
            raise ExportError(f"of the cameras {names} two would write into the folder {folder!r}: rename one")
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


def _differences(where: str, there: Any, now: Any) -> list[str]:
    if isinstance(there, dict) and isinstance(now, dict):
        lines = []
        for key in sorted({*there, *now}):
            lines += _differences(f"{where}.{key}" if where else key, there.get(key), now.get(key))
        return lines
    return [] if there == now else [f"{where}: {_short(there)} there, {_short(now)} now"]


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
