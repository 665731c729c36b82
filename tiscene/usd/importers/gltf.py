# SPDX-License-Identifier: Apache-2.0
"""glTF 2.0 files: JSON, buffers, accessors (sparse and normalized ones too), images, and what is not imported.

`GltfDocument` holds one file. `gltf_scene` reads its meshes, `gltf_materials` its materials and `gltf_animation` its
motion.
"""

from __future__ import annotations

import base64
import binascii
import importlib.util
import json
import urllib.parse
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tiscene.errors import StageError, counted
from tiscene.usd.importers.gltf_lobes import lost_parts
from tiscene.usd.materials.image import open_picture

SUFFIXES = (".gltf", ".glb")
# Extensions that are read.
_SUPPORTED = (
    "EXT_texture_webp",
    "KHR_draco_mesh_compression",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
)
_COMPRESSIONS = ("EXT_meshopt_compression", "KHR_draco_mesh_compression")
_DTYPES = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_JSON_CHUNK, _BINARY_CHUNK = 0x4E4F534A, 0x004E4942
_MAX_COUNT = 1 << 28  # elements of an accessor; a file that names more is damaged


def read_header(name: str, data: bytes) -> dict[str, Any]:
    """Return the JSON of a .gltf or .glb file.

    Raises:
        StageError: it has none, or the geometry is compressed by an extension that cannot be decoded.
    """
    chunks = _chunks(data) if data[:4] == b"glTF" else {_JSON_CHUNK: data}
    try:
        found = json.loads(chunks.get(_JSON_CHUNK, b""))
    except (ValueError, RecursionError) as error:
        raise StageError(name, [f"cannot be read: its JSON is damaged: {error}"]) from None
    if not isinstance(found, dict):
        raise StageError(name, ["cannot be read: it is not a glTF file"])
    required = found.get("extensionsRequired")
    for extension in _COMPRESSIONS:
        decodable = extension == "KHR_draco_mesh_compression" and importlib.util.find_spec("DracoPy") is not None
        if isinstance(required, list) and extension in required and not decodable:
            hint = " (or pip install DracoPy)" if "draco" in extension else ""
            raise StageError(name, [f"its geometry is compressed by {extension}: export it without{hint}"])
    return found


def unsupported_features(header: Mapping[str, Any]) -> list[str]:
    """Return the names of what is not imported: extensions and parts of them, cameras, animations after the first."""
    extensions = sorted({*header.get("extensionsUsed", ())} - {*_SUPPORTED})
    others = lost_parts(header.get("materials"))
    others += ["cameras"] if header.get("cameras") else []
    others += ["animations after the first"] if len(header.get("animations", ())) > 1 else []
    return [*extensions, *others]


def _chunks(data: bytes) -> dict[int, bytes]:
    """Return the chunks of a .glb file by type; the first of each type counts."""
    found: dict[int, bytes] = {}
    at = 12
    while at + 8 <= len(data):
        length, kind = (int.from_bytes(data[at + start : at + start + 4], "little") for start in (0, 4))
        found.setdefault(kind, data[at + 8 : at + 8 + length])
        at += 8 + length + -length % 4
    return found


class GltfDocument:
    """One file with its buffers and images.

    Args:
        header: its JSON.
        data: the bytes of the file.
        load: returns the bytes of a file beside it by its relative path.

    Attributes:
        header: its JSON.
        missing: what is named in the file and cannot be read: images, for the caller to report.
    """

    def __init__(self, header: dict[str, Any], data: bytes, load: Callable[[str], bytes]) -> None:
        self.header = header
        self.missing: list[str] = []
        self._binary = _chunks(data).get(_BINARY_CHUNK, b"") if data[:4] == b"glTF" else b""
        self._load = load
        self._buffers: dict[int, bytes] = {}
        self._images: dict[int, Image.Image | None] = {}

    def listed(self, name: str) -> list[Any]:
        """Return a list of the file's JSON, () if it has none."""
        return list(self.header.get(name) or ())

    def accessor(self, index: int) -> NDArray[Any]:
        """Return an accessor's values [count, width]; normalized integers become float32 numbers."""
        entry = self.listed("accessors")[index]
        dtype, width, count = np.dtype(_DTYPES[entry["componentType"]]), _WIDTHS[entry["type"]], int(entry["count"])
        if not 0 <= count <= _MAX_COUNT:
            raise ValueError(f"accessor {index} has {counted(count, 'element')}")
        values = np.zeros((count, width), dtype)
        if entry.get("bufferView") is not None:
            values = self._elements(entry["bufferView"], entry.get("byteOffset", 0), dtype, width, count)
        sparse = entry.get("sparse")
        if sparse:
            values, changed = values.copy(), int(sparse["count"])
            at, new = sparse["indices"], sparse["values"]
            kind = np.dtype(_DTYPES[at["componentType"]])
            rows = self._elements(at["bufferView"], at.get("byteOffset", 0), kind, 1, changed)[:, 0]
            values[rows] = self._elements(new["bufferView"], new.get("byteOffset", 0), dtype, width, changed)
        if entry.get("normalized") and np.issubdtype(dtype, np.integer):
            largest = float(np.iinfo(dtype.name).max)
            return np.asarray(np.maximum(values.astype(np.float32) / np.float32(largest), -1.0))
        return values

    def _elements(self, view: int, offset: int, dtype: np.dtype[Any], width: int, count: int) -> NDArray[Any]:
        """Return elements of a buffer view, [count, width]."""
        data, stride = self.view(view)
        size = dtype.itemsize * width
        step = stride or size
        if count and offset + step * (count - 1) + size > len(data):
            raise ValueError(
                f"buffer view {view} of {counted(len(data), 'byte')} is too short for {counted(count, 'element')}"
            )
        if not count:
            return np.zeros((0, width), dtype)
        shape, strides = (count, width), (step, dtype.itemsize)
        raw = np.ndarray(shape, dtype.newbyteorder("<"), data, offset, strides)
        return raw.astype(dtype)

    def view(self, index: int) -> tuple[bytes, int]:
        """Return the bytes of a buffer view, and the distance of its elements (0: packed)."""
        entry = self.listed("bufferViews")[index]
        buffer = self._buffer(int(entry["buffer"]))
        start = int(entry.get("byteOffset", 0))
        return buffer[start : start + int(entry["byteLength"])], int(entry.get("byteStride", 0))

    def _buffer(self, index: int) -> bytes:
        if index not in self._buffers:
            uri = self.listed("buffers")[index].get("uri")
            self._buffers[index] = self._binary if uri is None else self._file(uri)
        return self._buffers[index]

    def _file(self, uri: str) -> bytes:
        """Return the bytes that a URI means: data in it, or a file beside the model."""
        if uri.startswith("data:"):
            try:
                return base64.b64decode(uri.partition(",")[2])
            except binascii.Error as error:
                raise ValueError(f"a data URI is damaged: {error}") from None
        return self._load(urllib.parse.unquote(uri))

    def image(self, texture: int) -> Image.Image | None:
        """Return the image of a texture; None, named in `missing`, if it cannot be read."""
        entry = self.listed("textures")[texture]
        source = entry.get("extensions", {}).get("EXT_texture_webp", {}).get("source", entry.get("source"))
        if source is None:
            self.missing.append(f"image of texture {texture}")
            return None
        if source not in self._images:
            self._images[source] = self._read_image(self.listed("images")[source], source)
        return self._images[source]

    def _read_image(self, entry: Mapping[str, Any], index: int) -> Image.Image | None:
        name = str(entry.get("uri") or entry.get("name") or f"image {index}")
        name = f"image {index}" if name.startswith("data:") else name
        try:
            data = self._file(entry["uri"]) if "uri" in entry else self.view(entry["bufferView"])[0]
            return open_picture(data)
        except (OSError, ValueError, KeyError):
            self.missing.append(name)
            return None
