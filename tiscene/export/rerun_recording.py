# SPDX-License-Identifier: Apache-2.0
"""Rerun: recordings of 250 frames each, with pictures, depth, labels, boxes and the camera on two timelines.

`recording-000000.rrd` has the frames 0 to 249, on the timelines `frame` and `time`. All files are parts of one
recording: `rerun out/*.rrd` shows them together.

======================================  =======================================================================
entity                                  archetype
======================================  =======================================================================
`world/camera`                          Transform3D: pose in each frame; Pinhole: intrinsics, if perspective
`world/camera/rgb`                      EncodedImage (PNG, exact)
`world/camera/depth`                    DepthImage, m
`world/camera/semantic` and other ids   SegmentationImage; ids in 16 bits
`world/camera/<other buffers>`          Tensor, exact
`world/objects`                         Boxes3D of all objects, with their names
`world/camera/boxes`                    Boxes2D of the visible objects
======================================  =======================================================================

A chunk has the rows of up to 25 frames. Rerun gives chunks and rows ids by the clock. Here they are functions of the
frames, so that equal frames give equal chunks. Around them Rerun writes an id by the clock and an index in random
order: the manifest has the digest of the chunks.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import ExportError
from tiscene.export.array_files import Contents, from_npy, npy, png
from tiscene.export.packing import PACKING
from tiscene.export.png import ids16

if TYPE_CHECKING:
    from tiscene.export.packing import ExportRun, FramePieces, GroupFrames
    from tiscene.frame.frame import Frame
    from tiscene.frame.measurements import OrientedBox
    from tiscene.frame.object_table import Box, ObjectRow
    from tiscene.stream.stream import Stream

FRAMES_PER_FILE = 250  # Rerun holds a file in memory while it is written
PACKED = ("recording-*.rrd",)
READS_ONCE = True
FRAMES_PER_CHUNK, CHUNK_BYTES = 25, 8_000_000  # at most: what is seen of a frame is read with its chunk
CAMERA, OBJECTS, BOXES = "world/camera", "world/objects", "world/camera/boxes"

_POSE = [
    ("time", "<f8"),
    ("translation", "<f4", 3),
    ("rotation", "<f4", (3, 3)),
    ("K", "<f4", (3, 3)),
    ("resolution", "<f4", 2),
]
_BOX_2D = [("center", "<f4", 2), ("half_size", "<f4", 2), ("class_id", "<u2")]
_BOX_3D = [("center", "<f4", 3), ("half_size", "<f4", 3), ("quaternion", "<f4", 4), ("class_id", "<u2")]


def entities(frame: Frame) -> dict[str, Callable[[], NDArray[Any]]]:
    """Return functions that make what a frame logs, by entity path, for `columns`. Other threads may call them."""
    rows = list(frame.objects)
    boxes = [row.box_3d for row in rows]  # rendered on demand: here
    seen = [(row, row.visible_box) for row in rows if row.visible_pixels > 0]
    return {
        CAMERA: partial(_pose, frame),
        **{f"{CAMERA}/{name}": partial(_image, name, buffer) for name, buffer in frame.buffers.items()},
        OBJECTS: partial(_boxes_3d, rows, boxes),
        BOXES: partial(_boxes_2d, [(row, box) for row, box in seen if box is not None]),
    }


def _pose(frame: Frame) -> NDArray[Any]:
    """Return the time of a frame, and the pose and the intrinsics of its camera, [1] of _POSE.

    An orthographic camera has intrinsics of nan: Rerun's Pinhole is perspective.
    """
    camera = frame.camera
    pose = camera.world_from_camera
    K = camera.K_at(0.5) if camera.camera.orthographic_height is None else np.full((3, 3), np.nan)
    return np.array([(frame.time, pose[:3, 3], pose[:3, :3], K, (camera.width, camera.height))], _POSE)


def _image(name: str, buffer: NDArray[Any]) -> NDArray[Any]:
    """Return a buffer with the values that are logged; `rgb` as the bytes of a PNG file."""
    if name == "rgb":
        return np.frombuffer(png(buffer), np.uint8)
    if buffer.dtype == np.bool_:
        return buffer.astype(np.uint8)
    return ids16(name, buffer) if np.issubdtype(buffer.dtype, np.integer) else buffer


def _boxes_3d(rows: Sequence[ObjectRow], boxes: Sequence[OrientedBox]) -> NDArray[Any]:
    """Return the boxes of all objects, with their names."""
    result = _named(_BOX_3D, rows)
    if rows:
        result["center"] = [box.center for box in boxes]
        result["half_size"] = 0.5 * np.array([box.size for box in boxes], np.float32)
        result["quaternion"] = np.array([box.rotation for box in boxes], np.float32)[:, [1, 2, 3, 0]]
    return result


def _boxes_2d(seen: Sequence[tuple[ObjectRow, Box]]) -> NDArray[Any]:
    """Return the boxes of the visible objects, with their names."""
    result = _named(_BOX_2D, [row for row, _ in seen])
    if seen:
        corners = np.array([box for _, box in seen], np.float32)
        result["center"] = 0.5 * (corners[:, :2] + corners[:, 2:])
        result["half_size"] = 0.5 * (corners[:, 2:] - corners[:, :2])
    return result


def _named(fields: Sequence[Any], rows: Sequence[ObjectRow]) -> NDArray[Any]:
    """Return a record for each object that has its category and its name beside some fields, which are 0."""
    names = np.array([row.name for row in rows], np.str_)
    result = np.zeros(len(rows), [*fields, ("name", names.dtype)])
    result["class_id"], result["name"] = [row.category_id for row in rows], names
    return result


def columns(path: str, arrays: Sequence[NDArray[Any]]) -> list[Any]:
    """Return what several frames log of an entity as Rerun's columns, with a row for each frame.

    Args:
        path: Of the entity.
        arrays: What the function of `entities` returned for each frame.
    """
    import rerun as rr

    if path == CAMERA:
        poses = np.concatenate(arrays)
        axes = [rr.ViewCoordinates.RDF] * len(poses)
        transform = rr.Transform3D.columns(translation=poses["translation"], mat3x3=list(poses["rotation"]))
        if np.isnan(poses["K"]).any():
            return list(transform)
        return [
            *transform,
            *rr.Pinhole.columns(image_from_camera=list(poses["K"]), resolution=poses["resolution"], camera_xyz=axes),
        ]
    if path in (OBJECTS, BOXES):
        boxes = np.concatenate(arrays)
        values: dict[str, Any] = {
            "centers": boxes["center"],
            "half_sizes": boxes["half_size"],
            "class_ids": boxes["class_id"],
            "labels": boxes["name"].tolist(),
        }
        if path == OBJECTS:
            values["quaternions"] = boxes["quaternion"]
        kind = rr.Boxes3D if path == OBJECTS else rr.Boxes2D
        return list(kind.columns(**values).partition([len(each) for each in arrays]))
    return list(_image_columns(path.rpartition("/")[2], arrays))


def _image_columns(name: str, arrays: Sequence[NDArray[Any]]) -> Iterable[Any]:
    """Return the columns of a buffer."""
    import pyarrow as pa
    import rerun as rr
    from rerun.components import ImageFormat, TensorDataBatch
    from rerun.encodings import ChannelDatatype, TensorBuffer, TensorData

    first, count = arrays[0], len(arrays)
    if name == "rgb":
        return rr.EncodedImage.columns(blob=_blobs(arrays), media_type=["image/png"] * count)
    if name in ("depth", "distance") or np.issubdtype(first.dtype, np.integer):
        datatype = ChannelDatatype.from_np_dtype(first.dtype)
        formats = [ImageFormat(width=first.shape[1], height=first.shape[0], channel_datatype=datatype)] * count
        if name in ("depth", "distance"):
            return rr.DepthImage.columns(buffer=_blobs(arrays), format=formats, meter=[1.0] * count)
        return rr.SegmentationImage.columns(buffer=_blobs(arrays), format=formats)
    names = ("height", "width", "channel", "value")[: first.ndim]
    tensors = [TensorData(shape=each.shape, buffer=TensorBuffer(each.ravel()), dim_names=names) for each in arrays]
    return rr.Tensor.columns(data=pa.concat_arrays([TensorDataBatch(each).as_arrow_array() for each in tensors]))


def _blobs(arrays: Sequence[NDArray[Any]]) -> Any:
    """Return the bytes of arrays as an Arrow array with an element for each."""
    import pyarrow as pa

    data = [np.ascontiguousarray(array).reshape(-1).view(np.uint8) for array in arrays]
    offsets = np.cumsum([0, *map(len, data)], dtype=np.int32)
    return pa.ListArray.from_arrays(
        offsets, pa.array(np.concatenate(data)), type=pa.list_(pa.field("item", pa.uint8(), nullable=False))
    )


def pieces(frame: Frame, labels: dict[str, Any], stream: Stream) -> dict[str, Contents]:
    """Return what a frame logs, an array for each entity."""
    return {path: partial(_piece, make) for path, make in entities(frame).items()}


def _piece(make: Callable[[], NDArray[Any]]) -> bytes:
    """Return what an entity logs as .npy."""
    return npy(make())


def pack(frames: GroupFrames, run: ExportRun, folder: Path) -> dict[str, str]:
    """Write one file of the recording; return its content digest by its name."""
    from rerun.chunk import LazyChunkStream

    path = folder / f"recording-{frames.first // FRAMES_PER_FILE:06d}.rrd"
    camera = folder.name if folder.parent.parent.name == PACKING else ""
    about = {name: run.provenance[name] for name in ("scenario", "settings")} | {"camera": camera}
    identity = hashlib.sha256(json.dumps(about, sort_keys=True).encode()).hexdigest()[:32]
    digest = hashlib.sha256()
    stream = LazyChunkStream.from_iter(_digested(_chunks(frames), digest))
    try:
        stream.write_rrd(path, application_id="tiscene", recording_id=identity)
    except RuntimeError as error:  # of a file that cannot be written
        raise ExportError(f"cannot write {str(path)!r}: {error}") from error
    return {path.name: digest.hexdigest()}


def content_digest(path: Path) -> str | None:
    """Return the digest of the chunks of a recording; None for another file, or one that is damaged."""
    if path.suffix != ".rrd":
        return None
    from rerun.chunk import RrdReader

    digest = hashlib.sha256()
    try:
        for _ in _digested(RrdReader(path).stream(), digest):
            pass
    except (OSError, ValueError, RuntimeError):
        return None
    return digest.hexdigest()


def _digested(chunks: Iterable[Any], digest: Any) -> Iterator[Any]:
    """Yield chunks, and update a digest with their contents."""
    for chunk in chunks:
        batch = chunk.to_record_batch()
        digest.update(f"{batch.schema.metadata[b'rerun:id'].decode()} {batch.num_rows}\n".encode())
        for column in batch.columns:
            for data in column.buffers():
                digest.update(b"-" if data is None else memoryview(data))
        yield chunk


def _chunks(frames: Iterable[FramePieces]) -> Iterator[Any]:
    """Yield the chunks of frames, one for each entity and some frames."""
    rows = iter(frames)
    for first in rows:
        largest = max(map(len, first.members.values()))
        count = min(FRAMES_PER_CHUNK, max(CHUNK_BYTES // largest, 1))
        some = [first, *islice(rows, count - 1)]
        poses = [from_npy(frame.members[CAMERA]) for frame in some]
        times = [np.timedelta64(round(float(pose["time"][0]) * 1e9), "ns") for pose in poses]
        for path in first.members:
            yield _chunk(path, some, times)


def _chunk(path: str, frames: Sequence[FramePieces], times: Sequence[np.timedelta64]) -> Any:
    """Return the chunk of an entity in some frames, which are at these times."""
    import rerun as rr
    from rerun.chunk import Chunk

    indices = [frame.index for frame in frames]
    indexes = [rr.TimeColumn("frame", sequence=indices), rr.TimeColumn("time", duration=times)]
    values = columns(path, [from_npy(frame.members[path]) for frame in frames])
    batch = Chunk.from_columns(path, indexes, values).to_record_batch()
    (chunk,) = Chunk.from_record_batch(_with_ids(batch, path, indices))
    return chunk


def _with_ids(batch: Any, path: str, frames: Sequence[int]) -> Any:
    """Return a chunk with ids that depend on the path of the entity and the indices of the frames alone."""
    import pyarrow as pa

    entity = hashlib.sha256(path.encode()).digest()[:8]
    ids = [index.to_bytes(8, "big") + entity for index in frames]  # ascending, as Rerun's by the clock
    metadata = dict(batch.schema.metadata)
    metadata[b"rerun:id"] = f"chunk_{hashlib.sha256(b''.join(ids)).hexdigest()[:32].upper()}".encode()
    column = batch.schema.get_field_index("rerun.controls.RowId")
    rows = pa.array(ids, batch.schema.field(column).type)
    return batch.set_column(column, batch.schema.field(column), rows).replace_schema_metadata(metadata)
