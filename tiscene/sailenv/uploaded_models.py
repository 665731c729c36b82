# SPDX-License-Identifier: Apache-2.0
"""Models that agents upload: zip files with an OBJ file, its materials (MTL or JSON) and textures.

They are kept in a temporary folder until the environment is closed.

Uploads are not trusted. Nothing is written outside of the folder. A zip file is read completely, within limits on count
and size, before any of its members is written.
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

from tiscene.errors import ArgumentError, MissingFile, counted
from tiscene.usd.importers.unity_model import import_unity_model

MAX_BYTES = 128 << 20  # of an uploaded file
MAX_UNPACKED = 512 << 20  # bytes, of all members of a zip file
MAX_MEMBERS = 1000  # of a zip file
MAX_MODEL = 64 << 20  # bytes, of an OBJ file; other agents wait while it is read
MAX_FILES, MAX_STORED = 1024, 8 << 30  # files and bytes in one environment
UNPACKED, TEMPLATE = "+unpacked", "+template"  # folders beside the file; its name has no +
_CHUNK = 1 << 16


class UploadedModels:
    """The uploaded models of one environment, by the paths that were returned to the clients.

    Attributes:
        folder: The temporary folder of all models; None before the first upload.
    """

    def __init__(self) -> None:
        self.folder: Path | None = None
        self._delete: weakref.finalize[..., UploadedModels] | None = None
        self._files: dict[str, Path] = {}
        self._templates: dict[str, Path] = {}
        self._paths: dict[bytes, str] = {}  # by the digest of name and contents
        self._stored = 0  # bytes

    def store(self, name: str, data: bytes | bytearray) -> str:
        """Store an uploaded file.

        Args:
            name: The file name that the client has sent.
            data: The contents.

        Returns:
            The path by which the model is spawned; the same path for the same file.

        Raises:
            ArgumentError: The file is too large, is a zip file with unsafe members, or cannot be written.
        """
        if len(data) > MAX_BYTES:
            raise ArgumentError(f"{name!r} has {counted(len(data), 'byte')}; the limit is {MAX_BYTES}")
        key = hashlib.sha256(name.encode(errors="replace") + b"\0" + data).digest()
        if key not in self._paths:
            self._paths[key] = self._write(name, data)
        return self._paths[key]

    def _write(self, name: str, data: bytes | bytearray) -> str:
        """Write a file and the members of a zip file into a new folder; return the path of the file."""
        members = _read_members(name, data)
        size = len(data) + sum(map(len, members.values()))
        if len(self._files) >= MAX_FILES or self._stored + size > MAX_STORED:
            raise ArgumentError(f"{name!r}: the limits of an environment are {MAX_FILES} files and {MAX_STORED} bytes")
        if self.folder is None:
            self.folder = Path(tempfile.mkdtemp(prefix="tiscene-uploads-"))
            # Scripts often do not delete their agents: the folder is then deleted with this object.
            self._delete = weakref.finalize(self, shutil.rmtree, self.folder, ignore_errors=True)
        folder = Path(tempfile.mkdtemp(prefix=f"{len(self._files):04d}-", dir=self.folder))
        path = folder / _safe_file_name(name)
        try:
            path.write_bytes(data)
            for member, content in members.items():
                target = folder / UNPACKED / member
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_bytes(content)
        except OSError as error:
            shutil.rmtree(folder, ignore_errors=True)
            raise ArgumentError(f"{name!r} cannot be stored: {error}") from error
        self._stored += size
        self._files[str(path)] = folder
        return str(path)

    def template(self, path: str) -> str:
        """Return the template file of a stored model, which is imported at first use.

        Raises:
            MissingFile: No model was stored under that path.
            ArgumentError: The upload has no OBJ file, or too large a one.
            TisceneError: The model cannot be imported.
        """
        folder = self._files.get(path)
        if folder is None:
            raise MissingFile(f"{path!r} was not uploaded to this environment; send it with send_obj_zip first")
        if path not in self._templates:
            candidates = [file for file in folder.rglob("*") if file.suffix.lower() == ".obj" and file.is_file()]
            if not candidates:
                raise ArgumentError(f"{path!r} contains no .obj file")
            model = min(candidates, key=lambda file: (len(file.parts), str(file)))
            if model.stat().st_size > MAX_MODEL:
                raise ArgumentError(f"{model.name!r} has {model.stat().st_size} bytes; the limit is {MAX_MODEL}")
            name = model.stem.replace("_", " ")
            self._templates[path] = import_unity_model(model, folder / TEMPLATE, name=name, label=name.lower())
        return str(self._templates[path])

    def close(self) -> None:
        """Delete all models and their folder."""
        if self._delete is not None:
            self._delete()
        self.folder = self._delete = None
        self._stored = 0
        for table in (self._files, self._templates, self._paths):
            table.clear()


def _read_members(name: str, data: bytes | bytearray) -> dict[str, bytes]:
    """Return the members of a zip file by safe relative paths; an empty dict if it is no zip file."""
    if not zipfile.is_zipfile(io.BytesIO(data)):
        return {}
    members: dict[str, bytes] = {}
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            listed = archive.infolist()
            if len(listed) > MAX_MEMBERS:
                raise ArgumentError(f"{name!r} contains {counted(len(listed), 'file')}; the limit is {MAX_MEMBERS}")
            remaining = MAX_UNPACKED
            for member in listed:
                path = _safe_path(name, member)
                if member.is_dir():
                    continue
                members[path] = _read_member(name, archive, member, remaining)
                remaining -= len(members[path])
    except ArgumentError:
        raise
    except Exception as error:  # decompressors raise many types of exceptions for damaged data
        raise ArgumentError(f"{name!r} cannot be unpacked: {error}") from error
    return members


def _safe_path(name: str, member: zipfile.ZipInfo) -> str:
    """Return the relative path of a member. Raises ArgumentError if it is outside of the folder or a link."""
    path = PurePosixPath(member.filename.replace("\\", "/"))
    if path.is_absolute() or ".." in path.parts or ":" in member.filename or "\0" in member.filename:
        raise ArgumentError(f"{name!r} contains {member.filename!r}, which is outside of its folder")
    if stat.S_ISLNK(member.external_attr >> 16):
        raise ArgumentError(f"{name!r} contains the link {member.filename!r}; links are not allowed")
    return str(path)


def _read_member(name: str, archive: zipfile.ZipFile, member: zipfile.ZipInfo, limit: int) -> bytes:
    """Return the contents of a member. Raises ArgumentError beyond `limit` bytes; the declared size is not trusted."""
    content = bytearray()
    with archive.open(member) as opened:
        while chunk := opened.read(_CHUNK):
            content += chunk
            if len(content) > limit:
                raise ArgumentError(f"{name!r} unpacks to more than {MAX_UNPACKED} bytes")
    return bytes(content)


def _safe_file_name(name: str) -> str:
    """Return a file name without folders and special characters."""
    plain = "".join(c if c.isalnum() or c in "-_. " else "_" for c in name.replace("\\", "/").split("/")[-1])
    return plain.strip(". ")[:100] or "model.zip"
