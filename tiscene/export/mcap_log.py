# SPDX-License-Identifier: Apache-2.0
"""MCAP: `recording.mcap` with Foxglove's messages as JSON; the time of frame k is k / fps.

=======================  ==============================================================================================
topic                    message
=======================  ==============================================================================================
`/camera/rgb`            foxglove.CompressedImage (PNG)
`/camera/<buffer>`       foxglove.RawImage: mono16 (ids), mono8 (masks), 32FC1 (depth and other floats)
`/camera/calibration`    foxglove.CameraCalibration of a perspective camera; the message has no other projection
`/tf`                    foxglove.FrameTransform: the camera in the world
`/objects`               foxglove.SceneUpdate: a cube with a name for each object
`/camera/points`         foxglove.PointCloud of the buffer `position`, with colors if there is `rgb`
`/labels`                tiscene.Labels: camera, events and objects of the frame
`/camera/<buffer>.npy`   tiscene.Array: buffers of several channels, as .npy
=======================  ==============================================================================================
"""

from __future__ import annotations

import base64
import colorsys
import json
from collections.abc import Iterable
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tiscene.export.array_files import Contents, npy, png
from tiscene.export.png import ids16, mask8

if TYPE_CHECKING:
    from tiscene.export.packing import ExportRun, FramePieces
    from tiscene.frame.frame import Frame
    from tiscene.frame.measurements import OrientedBox
    from tiscene.stream.stream import Stream

FRAMES_PER_FILE = None
PACKED = ("recording.mcap",)
READS_ONCE = True
HOLDS_LABELS = True
WORLD, CAMERA = "world", "camera"

_NUMBER, _TEXT, _WHOLE = {"type": "number"}, {"type": "string"}, {"type": "integer"}
_BYTES = {"type": "string", "contentEncoding": "base64"}


def _object(**properties: Any) -> dict[str, Any]:
    return {"type": "object", "properties": properties}


def _list(items: Any) -> dict[str, Any]:
    return {"type": "array", "items": items}


_TIME = _object(sec=_WHOLE, nsec=_WHOLE)
_VECTOR = _object(x=_NUMBER, y=_NUMBER, z=_NUMBER)
_POSE = _object(position=_VECTOR, orientation=_object(x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER))
_COLOR = _object(r=_NUMBER, g=_NUMBER, b=_NUMBER, a=_NUMBER)
_STAMP = {"timestamp": _TIME, "frame_id": _TEXT}
_CUBE = _object(pose=_POSE, size=_VECTOR, color=_COLOR)
_LABEL = _object(
    pose=_POSE,
    billboard={"type": "boolean"},
    font_size=_NUMBER,
    scale_invariant={"type": "boolean"},
    color=_COLOR,
    text=_TEXT,
)
SCHEMAS: dict[str, dict[str, Any]] = {
    "foxglove.CompressedImage": _object(**_STAMP, data=_BYTES, format=_TEXT),
    "foxglove.RawImage": _object(**_STAMP, width=_WHOLE, height=_WHOLE, encoding=_TEXT, step=_WHOLE, data=_BYTES),
    "foxglove.CameraCalibration": _object(
        **_STAMP,
        width=_WHOLE,
        height=_WHOLE,
        distortion_model=_TEXT,
        D=_list(_NUMBER),
        K=_list(_NUMBER),
        R=_list(_NUMBER),
        P=_list(_NUMBER),
    ),
    "foxglove.FrameTransform": _object(
        timestamp=_TIME,
        parent_frame_id=_TEXT,
        child_frame_id=_TEXT,
        translation=_VECTOR,
        rotation=_POSE["properties"]["orientation"],
    ),
    "foxglove.SceneUpdate": _object(
        deletions=_list(_object(timestamp=_TIME, type=_WHOLE, id=_TEXT)),
        entities=_list(
            _object(
                **_STAMP,
                id=_TEXT,
                lifetime=_TIME,
                frame_locked={"type": "boolean"},
                cubes=_list(_CUBE),
                texts=_list(_LABEL),
            )
        ),
    ),
    "foxglove.PointCloud": _object(
        **_STAMP,
        pose=_POSE,
        point_stride=_WHOLE,
        fields=_list(_object(name=_TEXT, offset=_WHOLE, type=_WHOLE)),
        data=_BYTES,
    ),
    "tiscene.Labels": _object(index=_WHOLE, time=_NUMBER, camera=_object(), events=_list(_object())),
    "tiscene.Array": _object(timestamp=_TIME, format=_TEXT, data=_BYTES),
}


def pieces(frame: Frame, labels: dict[str, Any], stream: Stream) -> dict[str, Contents]:
    """Return the messages of a frame; names are "topic schema"."""
    nanoseconds = round(frame.index * 1_000_000_000 / stream.fps)
    time = {"sec": nanoseconds // 1_000_000_000, "nsec": nanoseconds % 1_000_000_000}
    stamp = {"timestamp": time, "frame_id": CAMERA}
    messages: dict[str, Any] = {
        "/labels tiscene.Labels": labels,
        "/tf foxglove.FrameTransform": _transform(frame, time),
    }
    if frame.camera.camera.orthographic_height is None:
        messages["/camera/calibration foxglove.CameraCalibration"] = stamp | _calibration(frame)
    encoded: dict[str, Contents] = {name: _json(message) for name, message in messages.items()}
    encoded["/objects foxglove.SceneUpdate"] = _scene(frame, time)
    for name, buffer in frame.buffers.items():
        if name == "rgb":
            encoded["/camera/rgb foxglove.CompressedImage"] = partial(_picture, stamp, buffer)
        elif name == "position":
            world = {"timestamp": time, "frame_id": WORLD}
            encoded["/camera/points foxglove.PointCloud"] = partial(_cloud, world, buffer, frame.buffers.get("rgb"))
        elif buffer.ndim == 2:
            encoded[f"/camera/{name} foxglove.RawImage"] = partial(_raw_image, stamp, name, buffer)
        else:
            encoded[f"/camera/{name}.npy tiscene.Array"] = partial(_array, time, buffer)
    return encoded


def pack(frames: Iterable[FramePieces], run: ExportRun, folder: Path) -> None:
    """Write the log, a message at a time."""
    from mcap.writer import Writer

    channels: dict[str, int] = {}
    schemas: dict[str, int] = {}
    with (folder / "recording.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start(profile="", library="tiscene")
        for frame in frames:
            time = round(frame.index * 1_000_000_000 / run.fps)
            for name, data in frame.members.items():
                if name not in channels:
                    topic, schema = name.split(" ")
                    if schema not in schemas:
                        text = json.dumps({"title": schema} | SCHEMAS[schema])
                        schemas[schema] = writer.register_schema(schema, "jsonschema", text.encode())
                    channels[name] = writer.register_channel(topic, "json", schemas[schema])
                writer.add_message(channels[name], time, data, time, frame.index)
        writer.finish()


def _transform(frame: Frame, time: dict[str, int]) -> dict[str, Any]:
    """Return the pose of the camera with the axes of Foxglove and OpenCV (x right, y down, z forward)."""
    matrix = frame.camera.world_from_camera
    return {
        "timestamp": time,
        "parent_frame_id": WORLD,
        "child_frame_id": CAMERA,
        "translation": _vector(matrix[:3, 3].tolist()),
        "rotation": _quaternion(_half_turn(frame.camera.rotation)),
    }


def _half_turn(rotation: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """Return a rotation after a half turn about x: from OpenCV's camera axes instead of USD's."""
    w, x, y, z = rotation
    return -x, w, z, -y


def _calibration(frame: Frame) -> dict[str, Any]:
    K = frame.camera.K
    P = np.zeros((3, 4))
    P[:, :3] = K
    return {
        "width": frame.camera.width,
        "height": frame.camera.height,
        "distortion_model": "plumb_bob",
        "D": [0.0] * 5,
        "K": K.ravel().tolist(),
        "R": np.eye(3).ravel().tolist(),
        "P": P.ravel().tolist(),
    }


def _scene(frame: Frame, time: dict[str, int]) -> bytes:
    """Return the boxes of all objects; those of the frame before are deleted."""
    stamp = json.dumps(time, separators=(",", ":"))
    entities = ",".join(f'{{"timestamp":{stamp},{_entity(row.id, row.name, row.box_3d)}' for row in frame.objects)
    return f'{{"deletions":[{{"timestamp":{stamp},"type":1,"id":""}}],"entities":[{entities}]}}'.encode()  # type 1: all


@lru_cache(maxsize=8192)
def _entity(id: int, name: str, box: OrientedBox) -> str:
    """Return the JSON of an object's box after its time. Most objects stand still: it is the same in each frame."""
    pose = {"position": _vector(box.center), "orientation": _quaternion(box.rotation)}
    hue = id * 0.618033988749895 % 1.0
    color = dict(zip("rgba", (*colorsys.hsv_to_rgb(hue, 1.0, 1.0), 0.4), strict=True))
    text = {"pose": pose, "billboard": True, "font_size": 12.0, "scale_invariant": True, "text": name}
    entity = {
        "frame_id": WORLD,
        "id": str(id),
        "lifetime": {"sec": 0, "nsec": 0},
        "frame_locked": False,
        "cubes": [{"pose": pose, "size": _vector(box.size), "color": color}],
        "texts": [text | {"color": {"r": 1.0, "g": 1.0, "b": 1.0, "a": 1.0}}],
    }
    return json.dumps(entity, separators=(",", ":"))[1:]


def _picture(stamp: dict[str, Any], rgb: NDArray[np.uint8]) -> bytes:
    """Return a picture as PNG."""
    return _json(stamp | {"format": "png"}, png(rgb))


def _array(time: dict[str, int], buffer: NDArray[Any]) -> bytes:
    """Return a buffer as .npy."""
    return _json({"timestamp": time, "format": "npy"}, npy(buffer))


def _raw_image(stamp: dict[str, Any], name: str, buffer: NDArray[Any]) -> bytes:
    """Return a buffer [h, w] as an image, little endian."""
    if buffer.dtype == np.bool_:
        pixels, encoding = mask8(buffer), "mono8"
    elif np.issubdtype(buffer.dtype, np.integer):
        pixels, encoding = ids16(name, buffer).astype("<u2"), "mono16"
    else:
        pixels, encoding = buffer.astype("<f4"), "32FC1"
    height, width = buffer.shape
    size = {"width": width, "height": height, "step": width * pixels.itemsize}
    return _json(stamp | size | {"encoding": encoding}, pixels.tobytes())


def _cloud(world: dict[str, Any], position: NDArray[np.float32], rgb: NDArray[np.uint8] | None) -> bytes:
    """Return the points that pixels show: x, y, z as float32, and red, green, blue, alpha as uint8."""
    points = position.reshape(-1, 3)
    hit = np.isfinite(points).all(axis=1)
    colors = np.full((len(points), 3), 255, np.uint8) if rgb is None else rgb.reshape(-1, 3)
    packed = np.zeros(int(hit.sum()), [("point", "<f4", 3), ("color", "u1", 3), ("alpha", "u1")])
    packed["point"], packed["color"], packed["alpha"] = points[hit], colors[hit], 255
    floats = [{"name": name, "offset": 4 * place, "type": 7} for place, name in enumerate("xyz")]
    bytes_ = [
        {"name": name, "offset": 12 + place, "type": 1} for place, name in enumerate(("red", "green", "blue", "alpha"))
    ]
    origin = {"position": _vector((0.0, 0.0, 0.0)), "orientation": _quaternion((1.0, 0.0, 0.0, 0.0))}
    return _json(world | {"pose": origin, "point_stride": 16, "fields": floats + bytes_}, packed.tobytes())


def _vector(values: Iterable[float]) -> dict[str, float]:
    return dict(zip("xyz", map(float, values), strict=True))


def _quaternion(rotation: tuple[float, float, float, float]) -> dict[str, float]:
    return dict(zip("wxyz", map(float, rotation), strict=True))


def _json(message: dict[str, Any], data: bytes | None = None) -> bytes:
    """Return a message as JSON.

    Args:
        message: Its properties.
        data: The value of a further one, `data`, which is encoded as base64; None for a message without.
    """
    text = json.dumps(message, separators=(",", ":")).encode()
    return text if data is None else text[:-1] + b',"data":"' + base64.b64encode(data) + b'"}'
