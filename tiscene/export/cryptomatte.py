# SPDX-License-Identifier: Apache-2.0
"""Cryptomatte files, specification 1.2.0 (Friedman and Jones, Psyop): one OpenEXR file per frame with object mattes.

Sets of mattes: `CryptoObject`, one for each object, named by its prim path, or by its name if it was spawned;
`CryptoAsset`, one for all objects of an asset, named after the asset, or after the object without one;
`CryptoMaterial`, one for each material, named by its prim path; `CryptoCategory`, one for each semantic category.

Each set has six ranks in the 32-bit float channels `CryptoObject00.R` (id), `.G` (coverage), `.B` (id), `.A`
(coverage), `CryptoObject01.R` and so on, and its manifest in the attributes `cryptomatte/...`. If the frame has `hdr`
or `rgb`, it is included as the image (half floats R G B, scene-linear).

`decode` reads such files of any renderer.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import ExportError, MissingFile
from tiscene.export import exr
from tiscene.export.array_files import Contents
from tiscene.export.sparse_exr import scan_lines

if TYPE_CHECKING:
    from tiscene.frame.frame import Frame
    from tiscene.frame.object_table import ObjectRow

HASH, CONVERSION = "MurmurHash3_32", "uint32_to_float32"
_MASK = 0xFFFFFFFF


@dataclass(frozen=True, eq=False)
class Mattes:
    """One set of mattes.

    Attributes:
        names: The hash of each name in the manifest, as the bits of a float.
        ids: Hashes, uint32 [h, w, ranks]; 0 for none.
        weights: Coverage of each rank, float32 [h, w, ranks].
    """

    names: Mapping[str, int]
    ids: NDArray[np.uint32]
    weights: NDArray[np.float32]

    def matte(self, name: str) -> NDArray[np.float32]:
        """Return the coverage of each pixel by a name, float32 [h, w]. Raises ExportError for an unknown name."""
        if name not in self.names:
            raise ExportError(f"there is no matte {name!r}; there are {', '.join(map(repr, sorted(self.names)))}")
        result: NDArray[np.float32] = np.where(self.ids == self.names[name], self.weights, 0.0).sum(axis=-1)
        return result


def check(buffers: Collection[str]) -> None:
    """Raise ExportError for a second picture: a file has one."""
    if {"hdr", "rgb"} <= {*buffers}:
        raise ExportError("format 'cryptomatte' writes the buffer 'hdr' or 'rgb' as its picture: leave out one of them")


def encode(frame: Frame) -> dict[str, Contents]:
    """Return the file of a frame by its name. Raises BufferNotFound without one of its buffers."""
    objects = {row.id: _object_name(row) for row in frame.objects}
    layers = (
        ("CryptoObject", frame.coverage, objects),
        ("CryptoAsset", frame.coverage, {row.id: row.asset or objects[row.id] for row in frame.objects}),
        ("CryptoMaterial", frame.material_coverage, {id: name for id, name in frame.materials.items() if name}),
        ("CryptoCategory", frame.coverage, {row.id: row.category for row in frame.objects if row.category}),
    )
    beauty = {name: frame.buffers[name] for name in ("hdr", "rgb") if name in frame.buffers}
    return {f"{frame.index:06d}.exr": partial(_file, layers, beauty)}


def _file(
    layers: Iterable[tuple[str, NDArray[np.float32], Mapping[int, str]]], beauty: Mapping[str, NDArray[Any]]
) -> bytes:
    """Return a file.

    Args:
        layers: Of each set of mattes its name, a coverage buffer, and the names of the ids.
        beauty: The first of these buffers is the image; empty for none.
    """
    attributes: dict[str, str] = {"name": "cryptomatte"}
    channels: dict[str, NDArray[Any]] = {}
    for name, buffer in list(beauty.items())[:1]:
        channels |= exr.channels(name, buffer)
    for layer, coverage, names in layers:
        ids, weights = _ranked(coverage, {id: hash_of(name) for id, name in names.items()})
        channels |= _layer(layer, ids, weights, coverage.shape[2])
        attributes |= _attributes(layer, tuple(sorted(set(names.values()))))
    return scan_lines(channels, attributes)


def decode(path: str | Path) -> dict[str, Mattes]:
    """Read the sets of mattes of a file, by name.

    Raises:
        MissingFile: There is no such file.
        ExportError: The file has no Cryptomatte.
    """
    import OpenEXR

    if not Path(path).is_file():
        raise MissingFile(f"no file {str(path)!r}")
    with OpenEXR.File(str(path), separate_channels=True) as file:
        header, channels = file.header(), file.channels()
        keys = [key.split("/")[1] for key in header if key.startswith("cryptomatte/") and key.endswith("/name")]
        if not keys:
            raise ExportError(f"{str(path)!r} has no attribute cryptomatte/.../name: it has no Cryptomatte")
        result = {}
        for key in keys:
            layer = header[f"cryptomatte/{key}/name"]
            levels = sorted({name.rpartition(".")[0] for name in channels if name[: len(layer)] == layer} - {layer})
            planes = [channels[f"{level}.{channel}"].pixels for level in levels for channel in "RGBA"]
            manifest = json.loads(header.get(f"cryptomatte/{key}/manifest", "{}"))
            result[layer] = Mattes(
                {name: int(digits, 16) for name, digits in manifest.items()},
                np.stack(planes[::2], axis=-1).astype(np.float32).view(np.uint32),
                np.stack(planes[1::2], axis=-1).astype(np.float32),
            )
        return result


@lru_cache(maxsize=65536)
def hash_of(name: str) -> int:
    """Return the id of a name as the bits of a float: its MurmurHash3, changed where the exponent would be 0 or 255."""
    bits = murmur3(name.encode())
    exponent = bits >> 23 & 0xFF
    return bits ^ 1 << 23 if exponent in (0, 255) else bits


def murmur3(data: bytes) -> int:
    """Return MurmurHash3_x86_32 (Appleby) of some bytes, with the seed 0."""
    state = 0
    for start in range(0, len(data), 4):
        block = data[start : start + 4]
        word = int.from_bytes(block, "little") * 0xCC9E2D51 & _MASK
        state ^= _rotated(word, 15) * 0x1B873593 & _MASK
        if len(block) == 4:
            state = _rotated(state, 13) * 5 + 0xE6546B64 & _MASK
    state ^= len(data)
    state = (state ^ state >> 16) * 0x85EBCA6B & _MASK
    state = (state ^ state >> 13) * 0xC2B2AE35 & _MASK
    return state ^ state >> 16


def _rotated(word: int, by: int) -> int:
    """Rotate 32 bits to the left."""
    return (word << by | word >> 32 - by) & _MASK


def _object_name(row: ObjectRow) -> str:
    """Return the prim path of an object; its name if it was spawned.

    A dynamic prim is an object of the scenario whose template is its prim path and whose name is that of the prim.
    """
    is_dynamic_prim = row.template.startswith("/") and row.template.rpartition("/")[2] == row.name
    return row.prim_path or (row.template if is_dynamic_prim else row.name)


def _ranked(coverage: NDArray[np.float32], hashes: Mapping[int, int]) -> tuple[NDArray[np.uint32], NDArray[np.float32]]:
    """Convert a coverage buffer to hashes and weights, each [ranks, h, w] of the ranks that some pixel has.

    Ids with the same hash are merged; ranks are sorted by descending weight. Most pixels have one id: only the others
    are looked at in full.

    Args:
        coverage: Pairs of id and weight by descending weight, [h, w, ranks, 2].
        hashes: The hash of each id.
    """
    height, width, ranks, _ = coverage.shape
    table = np.zeros(max(hashes, default=0) + 2, np.uint32)  # its last row is that of unknown ids
    table[list(hashes)] = list(hashes.values())
    pairs = coverage.reshape(-1, ranks, 2)
    several = np.flatnonzero(pairs[:, 1, 1] > 0.0) if ranks > 1 else np.zeros(0, np.int64)
    mixed = pairs[several]
    used = 1 + max((rank for rank in range(1, ranks) if mixed[:, rank, 1].any()), default=0)
    bits, weights = np.zeros((used, len(pairs)), np.uint32), np.zeros((used, len(pairs)), np.float32)
    bits[0], weights[0] = _named(pairs[:, 0], table)
    bits[:, several], weights[:, several] = (each.T for each in _merged(*_named(mixed[:, :used], table)))
    return bits.reshape(used, height, width), weights.reshape(used, height, width)


def _named(pairs: NDArray[np.float32], table: NDArray[np.uint32]) -> tuple[NDArray[np.uint32], NDArray[np.float32]]:
    """Return the hashes of pairs of id and weight [..., 2], from a table by id, and their weights; 0 without a name."""
    bits = table[np.minimum(pairs[..., 0].astype(np.int64), len(table) - 1)]
    return bits, np.where(bits > 0, pairs[..., 1], np.float32(0.0))


def _merged(bits: NDArray[np.uint32], weights: NDArray[np.float32]) -> tuple[NDArray[np.uint32], NDArray[np.float32]]:
    """Return hashes and weights [n, ranks] with equal hashes of a pixel added up, by descending weight."""
    for rank in range(1, bits.shape[1]):
        for earlier in range(rank):
            same = (bits[:, rank] == bits[:, earlier]) & (bits[:, rank] > 0)
            weights[:, earlier] += np.where(same, weights[:, rank], 0.0)
            weights[same, rank] = 0.0
            bits[same, rank] = 0
    order = np.argsort(-weights, axis=1, kind="stable")
    return np.take_along_axis(bits, order, axis=1), np.take_along_axis(weights, order, axis=1)


def _layer(
    name: str, ids: NDArray[np.uint32], weights: NDArray[np.float32], ranks: int
) -> dict[str, NDArray[np.float32]]:
    """Return the channels of a set by name, two ranks in the R G B A of each level; 0 in ranks that are not given."""
    empty = np.zeros(ids.shape[1:], np.float32)
    channels = {}
    for rank in range(ranks):
        level, (id_channel, weight_channel) = f"{name}{rank // 2:02d}", ("RG", "BA")[rank % 2]
        channels[f"{level}.{id_channel}"] = ids[rank].view(np.float32) if rank < len(ids) else empty
        channels[f"{level}.{weight_channel}"] = weights[rank] if rank < len(ids) else empty
    return channels


@lru_cache(maxsize=64)
def _attributes(layer: str, names: tuple[str, ...]) -> dict[str, str]:
    """Return the header attributes of a set, which are the same in most frames."""
    key = f"cryptomatte/{murmur3(layer.encode()):08x}"[: len("cryptomatte/") + 7]
    manifest = {name: f"{hash_of(name):08x}" for name in names}
    return {
        f"{key}/name": layer,
        f"{key}/hash": HASH,
        f"{key}/conversion": CONVERSION,
        f"{key}/manifest": json.dumps(manifest, ensure_ascii=False, separators=(",", ":")),
    }
