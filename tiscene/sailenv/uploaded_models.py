# SPDX-License-Identifier: Apache-2.0
"""Models that agents send: zip files with an OBJ inside, kept in a folder of their own until the world ends.

What they hold is not trusted: nothing is written outside of the folder, and nothing of a zip before all of it is read,
within bounds.
"""

from __future__ import annotations

import hashlib
import io
import shutil
import stat
import tempfile
import weakref
import zipfile
from pathlib import Path, PurePosixPath

from tiscene.errors import ArgumentError, MissingFile
from tiscene.usd.importers.import_template import import_asset

MAX_BYTES = 128 << 20  # of one file as it is sent
MAX_UNPACKED = 512 << 20  # of all that one zip holds
MAX_MEMBERS = 1000
MAX_MODEL = 64 << 20  # of an OBJ file, which all others wait for while it is read
MAX_FILES, MAX_STORED = 1024, 8 << 30  # of one world; bytes
_CHUNK = 1 << 16


class Uploads:
    """The models of one world, by the path that the sender was told."""

    def __init__(self) -> None:
        self._folder: Path | None = None
        self._delete: weakref.finalize[..., Uploads] | None = None
        self._files: dict[str, Path] = {}
        self._templates: dict[str, Path] = {}
        self._paths: dict[bytes, str] = {}  # by the digest of what was sent
        self._stored = 0  # bytes

    def store(self, name: str, data: bytes) -> str:
        """Keep a file; the path to spawn it by, that of before if it was sent already.

        Raises ArgumentError for what is too large, cannot be kept, or is a trap.
        """
        if len(data) > MAX_BYTES:
            raise ArgumentError(f"{name!r} has {len(data)} bytes; at most {MAX_BYTES} are taken")
        key = hashlib.sha256(name.encode(errors="replace") + b"\0" + data).digest()
        if key not in self._paths:
            self._paths[key] = self._keep(name, data)
        return self._paths[key]

    def _keep(self, name: str, data: bytes) -> str:
        members = _members(name, data)
        size = len(data) + sum(map(len, members.values()))
        if len(self._files) >= MAX_FILES or self._stored + size > MAX_STORED:
            raise ArgumentError(f"{name!r}: at most {MAX_FILES} files and {MAX_STORED} bytes are kept in a world")
        if self._folder is None:
            self._folder = Path(tempfile.mkdtemp(prefix="tiscene-uploads-"))
            # Scripts forget to delete their agents: then this goes with its world.
            self._delete = weakref.finalize(self, shutil.rmtree, self._folder, ignore_errors=True)
        folder = Path(tempfile.mkdtemp(prefix=f"{len(self._files):04d}-", dir=self._folder))
        path = folder / _plain_name(name)
        try:
            path.write_bytes(data)
            for inside, content in members.items():
                target = folder / "unpacked" / inside
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_bytes(content)
        except OSError as error:
            shutil.rmtree(folder, ignore_errors=True)
            raise ArgumentError(f"{name!r} cannot be kept: {error}") from error
        self._stored += size
        self._files[str(path)] = folder
        return str(path)

    def template(self, path: str) -> str:
        """The template's file of what was stored. Raises MissingFile, ArgumentError, or says what is wrong with it."""
        folder = self._files.get(path)
        if folder is None:
            raise MissingFile(f"{path!r} was not sent to this world")
        if path not in self._templates:
            candidates = [file for file in folder.rglob("*") if file.suffix.lower() == ".obj" and file.is_file()]
            if not candidates:
                raise ArgumentError(f"{path!r} holds no .obj file")
            model = min(candidates, key=lambda file: (len(file.parts), str(file)))
            if model.stat().st_size > MAX_MODEL:
                raise ArgumentError(f"{model.name!r} has {model.stat().st_size} bytes; at most {MAX_MODEL} are read")
            name = model.stem.replace("_", " ")
            self._templates[path] = import_asset(
                model, folder / "template", name=name, label=name.lower(), unit=1.0, up_axis="Y", centered=False
            )
        return str(self._templates[path])

    def close(self) -> None:
        """Delete everything."""
        if self._delete is not None:
            self._delete()
        self._folder = self._delete = None
        self._stored = 0
        for kept in (self._files, self._templates, self._paths):
            kept.clear()


def _members(name: str, data: bytes) -> dict[str, bytes]:
    """What a zip holds, by safe relative names; nothing for what is no zip."""
    if not zipfile.is_zipfile(io.BytesIO(data)):
        return {}
    members: dict[str, bytes] = {}
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            listed = archive.infolist()
            if len(listed) > MAX_MEMBERS:
                raise ArgumentError(f"{name!r} holds {len(listed)} files; at most {MAX_MEMBERS} are unpacked")
            room = MAX_UNPACKED
            for member in listed:
                inside = _safe(name, member)
                if member.is_dir():
                    continue
                members[inside] = _read(name, archive, member, room)
                room -= len(members[inside])
    except ArgumentError:
        raise
    except Exception as error:  # its decompressors fail in many ways on damaged data
        raise ArgumentError(f"{name!r} cannot be unpacked: {error}") from error
    return members


def _safe(name: str, member: zipfile.ZipInfo) -> str:
    """The relative path of a member. Raises ArgumentError if it leads outside, or is a link."""
    path = PurePosixPath(member.filename.replace("\\", "/"))
    if path.is_absolute() or ".." in path.parts or ":" in member.filename or "\0" in member.filename:
        raise ArgumentError(f"{name!r} holds {member.filename!r}, which leads outside of its folder")
    if stat.S_ISLNK(member.external_attr >> 16):
        raise ArgumentError(f"{name!r} holds the link {member.filename!r}")
    return str(path)


def _read(name: str, archive: zipfile.ZipFile, member: zipfile.ZipInfo, room: int) -> bytes:
    """A member's contents, as long as there is room: what the zip says of its size is not believed."""
    content = bytearray()
    with archive.open(member) as opened:
        while chunk := opened.read(_CHUNK):
            content += chunk
            if len(content) > room:
                raise ArgumentError(f"{name!r} holds more than {MAX_UNPACKED} bytes unpacked")
    return bytes(content)


def _plain_name(name: str) -> str:
    """A file name without folders or anything odd."""
    plain = "".join(c if c.isalnum() or c in "-_. " else "_" for c in name.replace("\\", "/").split("/")[-1])
    return plain.strip(". ")[:100] or "model.zip"
