# SPDX-License-Identifier: Apache-2.0
"""Rerun: recordings of 250 frames each, with pictures, depth, labels, boxes and the camera on two timelines.

`recording-000000.rrd` has the frames 0 to 249, on the timelines `frame` and `time`. All files are parts of one
recording: `rerun out/*.rrd` shows them together.

======================================  =======================================================================
entity                                  archetype
======================================  =======================================================================
`world/camera`                          Transform3D and Pinhole: pose and intrinsics of each frame
`world/camera/rgb`                      EncodedImage (PNG, exact)
`world/camera/depth`                    DepthImage, m
`world/camera/semantic` and other ids   SegmentationImage; ids in 16 bits
`world/camera/<other buffers>`          Tensor, exact
`world/objects`                         Boxes3D of all objects, with their names
`world/camera/boxes`                    Boxes2D of the visible objects
======================================  =======================================================================

Rerun gives rows ids by the clock. Here they are functions of the frame, so that equal frames give equal chunks. Around
them Rerun writes an id by the clock and an index in random order: the manifest has the digest of the chunks.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tiscene.export.array_files import Contents, png
from tiscene.export.png import ids16

if TYPE_CHECKING:
    from tiscene.export.packing import ExportRun, FramePieces
    from tiscene.frame.frame import Frame, FrameCamera
    from tiscene.frame.measurements import OrientedBox
    from tiscene.frame.object_table import Box, ObjectRow
    from tiscene.stream.stream import Stream

FRAMES_PER_FILE = 250  # Rerun holds a file in memory while it is written
CAMERA = "world/camera"


def archetypes(frame: Frame) -> dict[str, list[Any]]:
    """Return what a frame logs: Rerun's archetypes by entity path."""
    return {path: make() for path, make in _makers(frame).items()}


def _makers(frame: Frame) -> dict[str, Callable[[], list[Any]]]:
    """Return functions that make what a frame logs, by entity path. They may be called in other threads."""
    rows = list(frame.objects)
    boxes = [row.box_3d for row in rows]  # rendered on demand: here
    seen = [(row, row.visible_box) for row in rows if row.visible_pixels > 0]
    return {
        CAMERA: partial(_camera, frame.camera),
        **{f"{CAMERA}/{name}": partial(_buffer, name, buffer) for name, buffer in frame.buffers.items()},
        "world/objects": partial(_boxes_3d, rows, boxes),
        f"{CAMERA}/boxes": partial(_boxes_2d, [(row, box) for row, box in seen if box is not None]),
    }


def _camera(camera: FrameCamera) -> list[Any]:
    """Return the pose and the intrinsics of a camera."""
    import rerun as rr

    pose, K = camera.world_from_camera, camera.K_at(0.5)
    size = [camera.width, camera.height]
    return [
        rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]),
        rr.Pinhole(image_from_camera=K, resolution=size, camera_xyz=rr.ViewCoordinates.RDF),
    ]


def _boxes_3d(rows: Sequence[ObjectRow], boxes: Sequence[OrientedBox]) -> list[Any]:
    """Return the boxes of all objects, with their names."""
    import rerun as rr

    return [
        rr.Boxes3D(
            centers=np.array([box.center for box in boxes], np.float32).reshape(-1, 3),
            half_sizes=0.5 * np.array([box.size for box in boxes], np.float32).reshape(-1, 3),
            quaternions=np.array([(*box.rotation[1:], box.rotation[0]) for box in boxes], np.float32).reshape(-1, 4),
            class_ids=[row.category_id for row in rows],
            labels=[row.name for row in rows],
        )
    ]


def _boxes_2d(seen: Sequence[tuple[ObjectRow, Box]]) -> list[Any]:
    """Return the boxes of the visible objects, with their names."""
    import rerun as rr

    return [
        rr.Boxes2D(
            array=np.array([box for _, box in seen], np.float32).reshape(-1, 4),
            array_format=rr.Box2DFormat.XYXY,
            class_ids=[row.category_id for row, _ in seen],
            labels=[row.name for row, _ in seen],
        )
    ]


def pieces(frame: Frame, labels: dict[str, Any], stream: Stream) -> dict[str, Contents]:
    """Return the chunks of a frame, each as a stream of one Arrow record batch."""
    return {path: partial(_chunk, path, frame.index, frame.time, make) for path, make in _makers(frame).items()}


def _chunk(path: str, index: int, time: float, make: Callable[[], list[Any]]) -> bytes:
    """Return the chunk of an entity at a frame."""
    import pyarrow as pa
    import rerun as rr
    from rerun.chunk import Chunk

    indexes = [
        rr.TimeColumn("frame", sequence=[index]),
        rr.TimeColumn("time", duration=[np.timedelta64(round(time * 1e9), "ns")]),
    ]
    columns = [column for value in make() for column in _columns(value)]
    batch = _with_ids(Chunk.from_columns(path, indexes, columns).to_record_batch(), f"{index} {path}")
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, batch.schema) as target:
        target.write_batch(batch)
    data: bytes = sink.getvalue().to_pybytes()
    return data


def pack(frames: Iterable[FramePieces], run: ExportRun, folder: Path) -> dict[str, str]:
    """Write one file of the recording; return its content digest by its name."""
    from rerun.chunk import LazyChunkStream

    rows = iter(frames)
    first = next(rows)
    path = folder / f"recording-{first.index // FRAMES_PER_FILE:06d}.rrd"
    identity = hashlib.sha256(repr(sorted(run.provenance["settings"].items())).encode()).hexdigest()[:32]
    digest = hashlib.sha256()
    stream = LazyChunkStream.from_iter(_digested(_chunks(chain([first], rows)), digest))
    stream.write_rrd(path, application_id="tiscene", recording_id=identity)
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
    import pyarrow as pa
    from rerun.chunk import Chunk

    for frame in frames:
        for data in frame.members.values():
            yield from Chunk.from_record_batch(pa.ipc.open_stream(pa.py_buffer(data)).read_next_batch())


def _buffer(name: str, buffer: NDArray[Any]) -> list[Any]:
    """Return a buffer as an archetype."""
    return [_archetype(name, buffer)]


def _archetype(name: str, buffer: NDArray[Any]) -> Any:
    """Return a buffer as an archetype."""
    import rerun as rr

    if name == "rgb":
        return rr.EncodedImage(contents=png(buffer), media_type="image/png")
    if name in ("depth", "distance"):
        return rr.DepthImage(buffer, meter=1.0)
    if buffer.dtype == np.bool_:
        return rr.SegmentationImage(buffer.astype(np.uint8))
    if np.issubdtype(buffer.dtype, np.integer):
        return rr.SegmentationImage(ids16(name, buffer))
    return rr.Tensor(buffer, dim_names=("height", "width", "channel", "value")[: buffer.ndim])


def _columns(value: Any) -> list[Any]:
    """Return the components of an archetype as columns of one row."""
    batches = value.as_component_batches()
    return [column for batch in batches for column in [batch.partition([len(batch.as_arrow_array())])]]


def _with_ids(batch: Any, key: str) -> Any:
    """Return a chunk with ids that depend on a key alone."""
    import pyarrow as pa

    chunk, row = (hashlib.sha256(f"{kind} {key}".encode()).hexdigest()[:32].upper() for kind in ("chunk", "row"))
    metadata = dict(batch.schema.metadata)
    metadata[b"rerun:id"] = f"chunk_{chunk}".encode()
    column = batch.schema.get_field_index("rerun.controls.RowId")
    ids = pa.array([bytes.fromhex(row)], batch.schema.field(column).type)
    return batch.set_column(column, batch.schema.field(column), ids).replace_schema_metadata(metadata)
