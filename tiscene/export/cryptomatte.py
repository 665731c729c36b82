# SPDX-License-Identifier: Apache-2.0
"""Cryptomatte, specification 1.2.0 (Friedman and Jones, Psyop): one OpenEXR file a frame with mattes of what it shows.

`CryptoObject` has a matte for each object, called by its prim path, or where it was spawned by its name;
`CryptoAsset` one for all that are of one asset, called as that, or as the object where there is none;
`CryptoMaterial` one for each material, called by its prim path; `CryptoCategory` one for each semantic category.
Six ranks of each lie in the 32-bit float channels `CryptoObject00.R` (id) `.G` (coverage) `.B` (id) `.A` (coverage),
`CryptoObject01.R` and so on; the attributes `cryptomatte/...` hold the manifest. `rgb` or `hdr`, where the frame has
it, is the picture beside them (half floats R G B, scene-linear).

`decode` reads such a file, of whatever renderer.
"""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import ExportError, MissingFile
from tiscene.export import exr

if TYPE_CHECKING:
    from tiscene.frame.frame import Frame
    from tiscene.frame.object_table import ObjectRow

BUFFERS = ("coverage", "material_coverage")  # what mattes are made of
HASH, CONVERSION = "MurmurHash3_32", "uint32_to_float32"
_MASK = 0xFFFFFFFF


@dataclass(frozen=True, eq=False)
class Mattes:
    """One set of mattes. names: hash of each name that the manifest has, as a float's bits.

    ids: uint32 [h, w, ranks], the bits; 0 for nothing. weights: float32 [h, w, ranks].
    """

    names: Mapping[str, int]
    ids: NDArray[np.uint32]
    weights: NDArray[np.float32]

    def matte(self, name: str) -> NDArray[np.float32]:
        """How much of each pixel that name fills, float32 [h, w]. Raises ExportError if the manifest has it not."""
        if name not in self.names:
            raise ExportError(f"there is no matte {name!r}; there are {', '.join(map(repr, sorted(self.names)))}")
        result: NDArray[np.float32] = np.where(self.ids == self.names[name], self.weights, 0.0).sum(axis=-1)
        return result


def encode(frame: Frame) -> dict[str, bytes]:
    """The file of a frame. Raises BufferNotFound without one of BUFFERS."""
    import OpenEXR

    objects = {row.id: _object_name(row) for row in frame.objects}
    layers = (
        ("CryptoObject", frame.coverage, objects),
        ("CryptoAsset", frame.coverage, {row.id: row.asset or objects[row.id] for row in frame.objects}),
        ("CryptoMaterial", frame.material_coverage, {id: name for id, name in frame.materials.items() if name}),
        ("CryptoCategory", frame.coverage, {row.id: row.category for row in frame.objects if row.category}),
    )
    header: dict[str, Any] = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    channels: dict[str, NDArray[Any]] = {}
    beauty = next((name for name in ("hdr", "rgb") if name in frame.buffers), None)
    if beauty is not None:
        channels |= exr.channels(beauty, frame.buffers[beauty])
    for layer, coverage, names in layers:
        hashes = {name: hash_of(name) for name in names.values()}
        ids, weights = _ranked(coverage, {id: hashes[name] for id, name in names.items()})
        channels |= _layer(layer, ids, weights)
        header |= _attributes(layer, hashes)
    data = io.BytesIO()
    OpenEXR.File([OpenEXR.Part(header, channels, name="cryptomatte")]).write(data)
    return {f"{frame.index:06d}.exr": data.getvalue()}


def decode(path: str | Path) -> dict[str, Mattes]:
    """The sets of mattes in a file, by name. Raises MissingFile, ExportError for a file that has none."""
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


def hash_of(name: str) -> int:
    """The bits of the float that a name is called by: its MurmurHash3, the exponent kept from 0 and 255."""
    bits = murmur3(name.encode())
    exponent = bits >> 23 & 0xFF
    return bits ^ 1 << 23 if exponent in (0, 255) else bits


def murmur3(data: bytes, seed: int = 0) -> int:
    """MurmurHash3_x86_32 (Appleby), a public standard."""
    state = seed
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
    return (word << by | word >> 32 - by) & _MASK


def _object_name(row: ObjectRow) -> str:
    """Its prim path, also where that is a prim which moves, and so an object of the scenario with the prim's name."""
    moves = row.template.startswith("/") and row.template.rpartition("/")[2] == row.name
    return row.prim_path or (row.template if moves else row.name)


def _ranked(coverage: NDArray[np.float32], hashes: Mapping[int, int]) -> tuple[NDArray[np.uint32], NDArray[np.float32]]:
    """Hashes and weights [h, w, ranks] of a coverage buffer, those that share a hash together, the most first."""
    known = np.array([0, *hashes], np.int64)
    table = np.array([0, *hashes.values()], np.uint32)
    order = np.argsort(known)
    ids = coverage[..., 0].astype(np.int64)
    place = np.minimum(np.searchsorted(known[order], ids), len(known) - 1)
    found = order[place]
    bits = np.where(known[found] == ids, table[found], 0).astype(np.uint32)
    weights = np.where(bits > 0, coverage[..., 1], 0.0).astype(np.float32)
    for rank in range(1, bits.shape[-1]):
        for earlier in range(rank):
            same = (bits[..., rank] == bits[..., earlier]) & (bits[..., rank] > 0)
            weights[..., earlier] += np.where(same, weights[..., rank], 0.0)
            weights[..., rank][same] = 0.0
            bits[..., rank][same] = 0
    ranks = np.argsort(-weights, axis=-1, kind="stable")
    return np.take_along_axis(bits, ranks, axis=-1), np.take_along_axis(weights, ranks, axis=-1)


def _layer(name: str, ids: NDArray[np.uint32], weights: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
    """Channels by name: two ranks in the R G B A of each level."""
    channels = {}
    for rank in range(ids.shape[-1]):
        level, (id_channel, weight_channel) = f"{name}{rank // 2:02d}", ("RG", "BA")[rank % 2]
        channels[f"{level}.{id_channel}"] = np.ascontiguousarray(ids[..., rank]).view(np.float32)
        channels[f"{level}.{weight_channel}"] = np.ascontiguousarray(weights[..., rank])
    return channels


def _attributes(layer: str, hashes: Mapping[str, int]) -> dict[str, str]:
    key = f"cryptomatte/{murmur3(layer.encode()):08x}"[: len("cryptomatte/") + 7]
    manifest = {name: f"{bits:08x}" for name, bits in sorted(hashes.items())}
    return {
        f"{key}/name": layer,
        f"{key}/hash": HASH,
        f"{key}/conversion": CONVERSION,
        f"{key}/manifest": json.dumps(manifest, ensure_ascii=False, separators=(",", ":")),
    }
