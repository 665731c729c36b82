# SPDX-License-Identifier: Apache-2.0
"""LeRobot's data set layout, version 3.0: one episode, with the camera as the robot.

================================================  ===================================================================
`meta/info.json`                                  features, sizes, frame rate
`meta/tasks.parquet`, `meta/stats.json`           the task; extrema, mean, deviation and quantiles of features
`meta/episodes/chunk-000/file-000.parquet`        the episode: its length, and where its rows and videos are
`data/chunk-000/file-000.parquet`                 one row per frame
`videos/observation.images.rgb/chunk-000/...mp4`  pictures, H.264
================================================  ===================================================================

`observation.state` is the camera's pose: position (m) and quaternion (w, x, y, z); `action` is the pose at the next
frame of the data set, that of the last one is its own. Frames are numbered from 0; times are number / fps.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tiscene.export.array_files import Contents, from_npy, npy
from tiscene.export.video import VideoWriter

if TYPE_CHECKING:
    from tiscene.export.packing import ExportRun, FramePieces
    from tiscene.frame.frame import Frame
    from tiscene.stream.stream import Stream

FRAMES_PER_FILE = None
PACKED = ("meta/*.*", "meta/*/chunk-*/*", "data/chunk-*/*", "videos/*/chunk-*/*")
FILES_PER_CHUNK = 1000
VIDEO, TASK = "observation.images.rgb", "observe the scene"
PLACE = "chunk-{chunk_index:03d}/file-{file_index:03d}"
FIRST = PLACE.format(chunk_index=0, file_index=0)
QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}
POSE = ["x", "y", "z", "qw", "qx", "qy", "qz"]


def pieces(frame: Frame, labels: dict[str, Any], stream: Stream) -> dict[str, Contents]:
    """Return the picture and the pose of the camera."""
    pose = np.array((*frame.camera.position, *frame.camera.rotation), np.float32)
    return {"rgb": partial(npy, frame.rgb), "pose": npy(pose)}


def pack(frames: Iterable[FramePieces], run: ExportRun, folder: Path) -> None:
    """Write the data set, a picture at a time."""
    poses: list[NDArray[np.float32]] = []
    colors = _ColorStatistics()
    path = folder / "videos" / VIDEO / f"{FIRST}.mp4"
    path.parent.mkdir(parents=True)
    with VideoWriter(path, run.fps, "libx264") as video:
        for frame in frames:
            picture = from_npy(frame.members["rgb"])
            colors.add(picture)
            video.write(picture)
            poses.append(from_npy(frame.members["pose"]))
    states = np.stack(poses)
    actions = np.concatenate([states[1:], states[-1:]])
    count = len(states)
    numbers = np.arange(count, dtype=np.int64)
    columns: dict[str, NDArray[Any]] = {
        "observation.state": states,
        "action": actions,
        "timestamp": (numbers / run.fps).astype(np.float32),
        "frame_index": numbers,
        "episode_index": np.zeros(count, np.int64),
        "index": numbers,
        "task_index": np.zeros(count, np.int64),
    }
    statistics = {name: _statistics(column) for name, column in columns.items()} | {VIDEO: colors.result()}
    _write_table(folder / "data" / f"{FIRST}.parquet", columns)
    _write_meta(folder / "meta", run, columns, picture.shape, statistics)


def _write_meta(
    folder: Path, run: ExportRun, columns: dict[str, NDArray[Any]], shape: tuple[int, ...], statistics: dict[str, Any]
) -> None:
    """Write what LeRobot reads first: features, statistics, tasks and episodes."""
    count = len(columns["index"])
    info = {
        "codebase_version": "v3.0",
        "robot_type": "camera",
        "total_episodes": 1,
        "total_frames": count,
        "total_tasks": 1,
        "chunks_size": FILES_PER_CHUNK,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 500,
        "fps": int(run.fps) if run.fps == int(run.fps) else run.fps,
        "splits": {"train": "0:1"},
        "data_path": f"data/{PLACE}.parquet",
        "video_path": f"videos/{{video_key}}/{PLACE}.mp4",
        "features": _features(columns, shape, run.fps),
    }
    folder.mkdir(parents=True)
    (folder / "info.json").write_text(json.dumps(info, indent=4) + "\n")
    (folder / "stats.json").write_text(json.dumps(statistics, indent=4) + "\n")
    _write_tasks(folder / "tasks.parquet")
    _write_table(folder / "episodes" / f"{FIRST}.parquet", _episode(count, run.fps, statistics))


def _features(columns: dict[str, NDArray[Any]], shape: tuple[int, ...], fps: float) -> dict[str, Any]:
    """Return the description of the video and of each column, by name."""
    height, width = (size + size % 2 for size in shape[:2])  # H.264 has even sizes
    video = {
        "dtype": "video",
        "shape": [height, width, 3],
        "names": ["height", "width", "channels"],
        "info": {
            "video.height": height,
            "video.width": width,
            "video.codec": "h264",
            "video.pix_fmt": "yuv420p",
            "video.is_depth_map": False,
            "video.fps": fps,
            "video.channels": 3,
            "has_audio": False,
        },
    }
    features: dict[str, Any] = {VIDEO: video}
    for name, column in columns.items():
        names = POSE if column.ndim == 2 else None
        features[name] = {"dtype": str(column.dtype), "shape": list(column.shape[1:]) or [1], "names": names}
    return features


def _episode(count: int, fps: float, statistics: dict[str, Any]) -> dict[str, Any]:
    """Return the columns of the table of episodes, which has one."""
    episode: dict[str, Any] = {
        "episode_index": [0],
        "tasks": [[TASK]],
        "length": [count],
        "data/chunk_index": [0],
        "data/file_index": [0],
        "dataset_from_index": [0],
        "dataset_to_index": [count],
        f"videos/{VIDEO}/chunk_index": [0],
        f"videos/{VIDEO}/file_index": [0],
        f"videos/{VIDEO}/from_timestamp": [0.0],
        f"videos/{VIDEO}/to_timestamp": [count / fps],
        "meta/episodes/chunk_index": [0],
        "meta/episodes/file_index": [0],
    }
    for name, values in statistics.items():
        episode |= {f"stats/{name}/{kind}": [value] for kind, value in values.items()}
    return episode


def _write_table(path: Path, columns: dict[str, Any]) -> None:
    """Write columns as Parquet; those of vectors as lists."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    arrays = {}
    for name, column in columns.items():
        is_vector = isinstance(column, np.ndarray) and column.ndim == 2
        arrays[name] = pa.array(column.tolist(), pa.list_(pa.float32())) if is_vector else pa.array(column)
    table = pa.table(arrays)
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(table, path, compression="snappy")


def _write_tasks(path: Path) -> None:
    """Write the tasks, whose names are the index of a pandas data frame."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    column = {"pandas_type": "int64", "numpy_type": "int64", "metadata": None}
    pandas = {
        "index_columns": ["__index_level_0__"],
        "column_indexes": [],
        "columns": [
            {"name": "task_index", "field_name": "task_index", **column},
            {
                "name": None,
                "field_name": "__index_level_0__",
                "pandas_type": "unicode",
                "numpy_type": "object",
                "metadata": None,
            },
        ],
        "creator": {"library": "pyarrow", "version": pa.__version__},
        "pandas_version": "2.0.0",
    }
    table = pa.table({"task_index": pa.array([0], pa.int64()), "__index_level_0__": pa.array([TASK])})
    pq.write_table(table.replace_schema_metadata({"pandas": json.dumps(pandas)}), path)


def _statistics(column: NDArray[Any]) -> dict[str, list[Any]]:
    """Return statistics of a feature along its rows."""
    rows = column.reshape(len(column), -1).astype(np.float64)
    values = {"min": rows.min(0), "max": rows.max(0), "mean": rows.mean(0), "std": rows.std(0)}
    values |= {name: np.quantile(rows, share, axis=0, method="inverted_cdf") for name, share in QUANTILES.items()}
    return {name: value.tolist() for name, value in values.items()} | {"count": [len(rows)]}


class _ColorStatistics:
    """Statistics of the colors of pictures, 0..1, exact and in constant memory: a histogram for each channel."""

    def __init__(self) -> None:
        self._counts: NDArray[np.int64] = np.zeros((3, 256), np.int64)
        self._pictures = 0

    def add(self, picture: NDArray[np.uint8]) -> None:
        """Add a picture, uint8 [h, w, 3]."""
        self._pictures += 1
        for channel in range(3):
            self._counts[channel] += np.bincount(picture[..., channel].ravel(), minlength=256)

    def result(self) -> dict[str, list[Any]]:
        """Return the statistics; those of channels are [3, 1, 1]."""
        levels = np.arange(256) / 255.0
        used = self._counts > 0
        mean = self._counts @ levels / self._counts.sum(1)
        variance = np.maximum(self._counts @ levels**2 / self._counts.sum(1) - mean**2, 0.0)
        low, high = levels[used.argmax(1)], levels[255 - used[:, ::-1].argmax(1)]
        values = {"min": low, "max": high, "mean": mean, "std": np.sqrt(variance)}
        below = self._counts.cumsum(1) / self._counts.sum(1, keepdims=True)  # the share at or below each level
        values |= {name: levels[(below >= share).argmax(1)] for name, share in QUANTILES.items()}
        return {name: value.reshape(3, 1, 1).tolist() for name, value in values.items()} | {"count": [self._pictures]}
