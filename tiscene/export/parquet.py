# SPDX-License-Identifier: Apache-2.0
"""Parquet: a Hugging Face data set, `datasets.load_dataset("out")`, one row per frame.

Columns are `index`, `time` (s), `labels` (JSON: camera, events, objects), and one per buffer: `rgb` is an `Image()`
(PNG), all others are `Array2D` or larger with the buffer's own type and values. `README.md` is the data set's card.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from itertools import chain, islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import counted
from tiscene.export.array_files import Contents, from_npy, npy, png
from tiscene.export.frame_json import labels_bytes
from tiscene.frame.buffers import BUFFERS

if TYPE_CHECKING:
    from tiscene.export.packing import ExportRun, FramePieces
    from tiscene.frame.frame import Frame
    from tiscene.stream.stream import Stream

FRAMES_PER_FILE = 250
PACKED = ("data/train-*.parquet",)
READS_ONCE = True
ROW_GROUP_BYTES = 64 << 20  # Hugging Face's viewer refuses row groups above 300 MB, and advises 100 MB
HOLDS_LABELS = True
SUMMARY = ("README.md",)


def pieces(frame: Frame, labels: dict[str, Any], stream: Stream) -> dict[str, Contents]:
    """Return the cells of a frame's row."""
    cells: dict[str, Contents] = {"labels": labels_bytes(labels)}
    return cells | {name: partial(png if name == "rgb" else npy, buffer) for name, buffer in frame.buffers.items()}


def pack(frames: Iterable[FramePieces], run: ExportRun, folder: Path) -> None:
    """Write one Parquet file, a row group at a time."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    rows = iter(frames)
    first = next(rows)
    arrays = {name: from_npy(data) for name, data in first.members.items() if name not in ("labels", "rgb")}
    schema = _schema(run, arrays)
    path = folder / "data" / f"train-{first.index // FRAMES_PER_FILE:06d}.parquet"
    path.parent.mkdir(parents=True)
    rows_per_group = max(1, ROW_GROUP_BYTES // max(1, sum(map(len, first.members.values()))))
    options: dict[str, Any] = {"compression": "zstd", "compression_level": 1, "data_page_size": 8 << 20}
    options |= {"use_dictionary": False, "write_statistics": ["index", "time"]}
    with pq.ParquetWriter(path, schema, **options) as writer:
        for group in _batches(chain([first], rows), rows_per_group):
            columns = [_column(field, group, run) for field in schema]
            writer.write_table(pa.Table.from_arrays(columns, schema=schema), row_group_size=len(group))


def summary(run: ExportRun) -> dict[str, bytes]:
    """Return the data set's card."""
    names = "\n".join(f"- `{name}`: {BUFFERS[name].doc}" for name in run.buffers)
    card = f"""{card_head({"train": PACKED[0]})}
# {counted(len(run.frames), "frame")} of {run.provenance["scenario"].get("scene", "a scene")}

Rendered by tiscene {run.provenance["tiscene"]}. Each row is a frame. Columns:

- `index`, `time` (s), `labels` (JSON: camera, events, objects)
{names}

`tiscene.json` has the scenario, the settings, the names of the categories, and digests of all frames.
"""
    return {"README.md": card.encode()}


def card_head(files: Mapping[str, str], features: str = "") -> str:
    """Return the head of a card of Hugging Face.

    Args:
        files: Patterns of the files of each split.
        features: The YAML of `dataset_info`; "": the files have it.
    """
    splits = "".join(f"  - split: {split}\n    path: {pattern}\n" for split, pattern in files.items())
    configs = f"configs:\n- config_name: default\n  data_files:\n{splits}"
    return f"---\n{configs}{features}tags:\n- synthetic\n- tiscene\n---\n"


def _schema(run: ExportRun, arrays: dict[str, NDArray[Any]]) -> Any:
    """Return the schema, with the features of Hugging Face's `datasets` in its metadata."""
    import pyarrow as pa

    fields = [pa.field("index", pa.int64()), pa.field("time", pa.float64()), pa.field("labels", pa.string())]
    features: dict[str, Any] = {
        "index": {"dtype": "int64", "_type": "Value"},
        "time": {"dtype": "float64", "_type": "Value"},
        "labels": {"dtype": "string", "_type": "Value"},
    }
    for name in run.buffers:
        if name == "rgb":
            fields.append(pa.field(name, pa.struct({"bytes": pa.binary(), "path": pa.string()})))
            features[name] = {"_type": "Image"}
            continue
        array = arrays[name]
        dtype, kind = "bool" if array.dtype == np.bool_ else str(array.dtype), f"Array{array.ndim}D"
        type_ = pa.from_numpy_dtype(array.dtype)
        for _ in array.shape:
            type_ = pa.list_(type_)
        # The name of the Arrow type by which `datasets` recognizes its arrays; other readers see lists.
        extension = {
            "ARROW:extension:name": f"datasets.features.features.{kind}ExtensionType",
            "ARROW:extension:metadata": json.dumps((array.shape, dtype)),
        }
        fields.append(pa.field(name, type_, metadata=extension))
        features[name] = {"shape": list(array.shape), "dtype": dtype, "_type": kind}
    return pa.schema(fields, metadata={"huggingface": json.dumps({"info": {"features": features}})})


def _column(field: Any, group: list[FramePieces], run: ExportRun) -> Any:
    """Return the cells of a column."""
    import pyarrow as pa

    match field.name:
        case "index":
            return pa.array([frame.index for frame in group], field.type)
        case "time":
            return pa.array([frame.index / run.fps for frame in group], field.type)
        case "labels":
            return pa.array([frame.members["labels"].decode() for frame in group], field.type)
        case "rgb":
            return pa.array([{"bytes": frame.members["rgb"], "path": None} for frame in group], field.type)
    return _nested(np.stack([from_npy(frame.members[field.name]) for frame in group]))


def _nested(array: NDArray[Any]) -> Any:
    """Return an array [rows, ...] as nested lists, without a Python object for each value."""
    import pyarrow as pa

    values = pa.array(array.ravel())
    for axis in range(array.ndim - 1, 0, -1):
        lists, length = int(np.prod(array.shape[:axis])), array.shape[axis]
        values = pa.ListArray.from_arrays(pa.array(np.arange(lists + 1, dtype=np.int32) * length, pa.int32()), values)
    return values


def _batches(frames: Iterator[FramePieces], size: int) -> Iterator[list[FramePieces]]:
    while batch := list(islice(frames, size)):
        yield batch
