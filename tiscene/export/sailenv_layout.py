# SPDX-License-Identifier: Apache-2.0
"""The folder layout of SAILenv's recordings. Frames are numbered from 1, with 100 frames per folder.

===============================  =======================================================================
`frames/00000001/001.png`        frame 0, 8-bit RGB
`frames/fps.json`                {"fps": ..., "frames_count": ...}
`motion/00000001/001.bin`        flow from the previous frame, float32 [h, w, 2] with SAILenv's signs: (-dx, +dy) px
`sup/00000001/001.targets.bin`   int32 [n], categories of the pixels that have one, in row-major order
`sup/00000001/001.indices.bin`   int32 [n], row-major indices of those pixels
`sup/map.json`                   {name: category}
===============================  =======================================================================

A `.bin` file is a gzip-compressed `.npy` file. `Recording` reads the layout.
"""

from __future__ import annotations

import gzip
import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tiscene.errors import ExportError, MissingFile
from tiscene.sailenv.unity_coordinates import flow_of

if TYPE_CHECKING:
    from tiscene.export.manifest import Manifest
    from tiscene.frame.frame import Frame
    from tiscene.stream.stream import Stream

BUFFERS = ("rgb", "semantic", "backward_flow")
SUMMARY = ("frames/fps.json", "sup/map.json")
FILES_PER_FOLDER = 100


def encode(frame: Frame) -> dict[str, bytes]:
    """Return the files of a frame by name. Raises BufferNotFound without one of BUFFERS."""
    image = io.BytesIO()
    Image.fromarray(frame.rgb).save(image, "png", compress_level=4)
    semantic = frame.semantic.ravel()
    (supervised,) = np.nonzero(semantic)
    name = file_name(frame.index)
    return {
        f"frames/{name}.png": image.getvalue(),
        f"motion/{name}.bin": _packed(flow_of(frame.backward_flow)),
        f"sup/{name}.targets.bin": _packed(semantic[supervised]),
        f"sup/{name}.indices.bin": _packed(supervised.astype(np.int32)),
    }


def summary(stream: Stream, manifest: Manifest) -> dict[str, bytes]:
    """Return the files about all frames by name."""
    count = max(manifest.frames, default=-1) + 1
    categories = {name: number for number, name in manifest.categories.items() if number}
    contents: tuple[dict[str, Any], ...] = ({"fps": stream.fps, "frames_count": count}, categories)
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
        category: int32 [h, w]; 0 for no category.
    """

    rgb: NDArray[np.uint8]
    flow: NDArray[np.float32]
    category: NDArray[np.int32]


class Recording:
    """A recording on disk: `Recording("out")[12].rgb`. `len` and indexing work as for a sequence.

    Attributes:
        folder: The folder of the recording.
        fps: Frames per second.
        categories: Names of the numbers in `category`.
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
        category = np.zeros(rgb.shape[:2], np.int32)
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


def _packed(array: NDArray[Any]) -> bytes:
    """Return an array as a gzip-compressed .npy file without a time stamp."""
    data = io.BytesIO()
    np.lib.format.write_array(data, np.ascontiguousarray(array), version=(1, 0), allow_pickle=False)
    return gzip.compress(data.getvalue(), compresslevel=4, mtime=0)
