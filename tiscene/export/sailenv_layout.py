# SPDX-License-Identifier: Apache-2.0
"""The folder layout of SAILenv's recordings. Frames are numbered from 1, with 100 frames per folder.

===============================  =======================================================================
`frames/00000001/001.png`        frame 0, 8-bit RGB
`frames/fps.json`                {"fps": ..., "frames_count": ...}
`motion/00000001/001.bin`        flow from the previous frame, float32 [h, w, 2] with SAILenv's signs: (-dx, +dy) px
`sup/00000001/001.targets.bin`   int32 [h * w], class of each pixel: 0, 1, ... for categories, then the background
`sup/00000001/001.indices.bin`   int32 [h * w], row-major indices of the pixels
`sup/map.json`                   {name: class}, with "background" as the last class
===============================  =======================================================================

A `.bin` file is a gzip-compressed `.npy` file. The classes are those of the categories that the stream selects, else of
all categories of the catalog. `Recording` reads the layout, with pixels that have no class as well.
"""

from __future__ import annotations

import gzip
import io
import json
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tiscene.errors import ExportError, MissingFile
from tiscene.export.array_files import Contents, npy, png
from tiscene.sailenv.recorded_classes import RecordedClasses
from tiscene.sailenv.unity_coordinates import flow_of

if TYPE_CHECKING:
    from tiscene.export.packing import ExportRun
    from tiscene.frame.frame import Frame

SUMMARY = ("frames/fps.json", "sup/map.json")
FILES_PER_FOLDER = 100


def encode(frame: Frame) -> dict[str, Contents]:
    """Return the files of a frame by name. Raises BufferNotFound without a buffer that the format requires."""
    table = RecordedClasses.of_ids(frame.categories).table(frame.categories, int(frame.semantic.max(initial=0)) + 1)
    return frame_files(frame.index, frame.rgb, flow_of(frame.backward_flow), table[frame.semantic])


def frame_files(
    index: int, rgb: NDArray[np.uint8], flow: NDArray[np.float32], classes: NDArray[np.int32]
) -> dict[str, Contents]:
    """Return the files of a frame by name.

    Args:
        index: The index of the frame, from 0.
        rgb: uint8 [h, w, 3].
        flow: With SAILenv's signs, float32 [h, w, 2].
        classes: int32 [h, w].
    """
    name = file_name(index)
    return {
        f"frames/{name}.png": partial(png, rgb),
        f"motion/{name}.bin": partial(_packed, flow),
        f"sup/{name}.targets.bin": partial(_packed, classes.ravel()),
        f"sup/{name}.indices.bin": partial(_indices, classes.size),
    }


def summary(run: ExportRun) -> dict[str, bytes]:
    """Return the files about all frames by name."""
    return summary_files(run.fps, max(run.frames, default=-1) + 1, RecordedClasses.of_ids(run.categories))


def summary_files(fps: float, count: int, classes: RecordedClasses) -> dict[str, bytes]:
    """Return the files about all frames by name.

    Args:
        fps: Frames per second.
        count: The number of frames.
        classes: The classes.
    """
    contents: tuple[dict[str, Any], ...] = ({"fps": fps, "frames_count": count}, classes.numbers)
    return {name: json.dumps(content).encode() + b"\n" for name, content in zip(SUMMARY, contents, strict=True)}


def file_name(index: int) -> str:
    """Return folder and file name of a frame without suffix: "00000001/001" for frame 0."""
    return f"{index // FILES_PER_FOLDER + 1:08d}/{index % FILES_PER_FOLDER + 1:03d}"


@dataclass(frozen=True, eq=False)
class RecordedFrame:
    """A frame of a recording.

    Attributes:
        rgb: uint8 [h, w, 3].
        flow: float32 [h, w, 2], px, with SAILenv's signs.
        category: int32 [h, w], a class for each pixel; -1 where the recording has none.
    """

    rgb: NDArray[np.uint8]
    flow: NDArray[np.float32]
    category: NDArray[np.int32]


class Recording:
    """A recording on disk: `Recording("out")[12].rgb`. `len` and indexing work as for a sequence.

    Attributes:
        folder: The folder of the recording.
        fps: Frames per second.
        categories: Names of the classes in `category`.
    """

    def __init__(self, folder: str | Path) -> None:
        """Open a recording. Raises MissingFile, or ExportError for damaged files."""
        self.folder = Path(folder)
        fps = self._json(SUMMARY[0])
        self.fps, self._count = float(fps["fps"]), int(fps["frames_count"])
        self.categories = {int(number): str(name) for name, number in self._json(SUMMARY[1]).items()}

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: int) -> RecordedFrame:
        if not 0 <= index < self._count:
            raise IndexError(f"frame {index} is outside 0..{self._count - 1}")
        name = file_name(index)
        rgb = np.asarray(Image.open(io.BytesIO(self._bytes(f"frames/{name}.png"))))
        category = np.full(rgb.shape[:2], -1, np.int32)
        category.ravel()[self._array(f"sup/{name}.indices.bin")] = self._array(f"sup/{name}.targets.bin")
        return RecordedFrame(rgb, self._array(f"motion/{name}.bin"), category)

    def _bytes(self, name: str) -> bytes:
        try:
            return (self.folder / name).read_bytes()
        except FileNotFoundError as error:
            raise MissingFile(f"{self.folder} is not a complete SAILenv recording: it has no file {name!r}") from error

    def _array(self, name: str) -> NDArray[Any]:
        try:
            array: NDArray[Any] = np.load(io.BytesIO(gzip.decompress(self._bytes(name))), allow_pickle=False)
        except (ValueError, EOFError, gzip.BadGzipFile) as error:
            raise ExportError(f"{self.folder / name} is not a gzip-compressed array: {error}") from error
        return array

    def _json(self, name: str) -> dict[str, Any]:
        try:
            content: dict[str, Any] = json.loads(self._bytes(name))
        except ValueError as error:
            raise ExportError(f"{self.folder / name} is not valid JSON: {error}") from error
        return content


@lru_cache(maxsize=4)
def _indices(count: int) -> bytes:
    """Return the file of the indices of all pixels, which is the same for each frame."""
    return _packed(np.arange(count, dtype=np.int32))


def _packed(array: NDArray[Any]) -> bytes:
    """Return an array as a gzip-compressed .npy file without a time stamp."""
    return gzip.compress(npy(array), compresslevel=4, mtime=0)
