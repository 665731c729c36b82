# SPDX-License-Identifier: Apache-2.0
"""Video: `preview.mp4` (H.264) to look at, and one FFV1 video in Matroska per buffer, `instance.mkv`, for programs.

==================================  =============================================================
buffer                              FFV1 pixels
==================================  =============================================================
`rgb`                               8-bit RGB, exact; `preview.mp4` shows the same, with loss
`semantic`, `instance`, `part`      16-bit gray, the ids; an id beyond 65535 is an error
the occlusion masks                 8-bit gray, 255 is True
`depth`, `distance`                 16-bit gray, mm, as in the PNG format
`forward_flow`, `backward_flow`     16-bit RGB, as in KITTI: 64 dx + 2^15, 64 dy + 2^15, valid
==================================  =============================================================

Frames of the video are the exported frames in order; their times are k / fps if every frame is exported. Encoders
differ between versions: compare decoded frames, whose digests are in the manifest, not bytes of videos.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import ExitStack
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import ExportError
from tiscene.export.array_files import Contents, from_npy, npy
from tiscene.export.kitti_flow import kitti
from tiscene.export.png import ids16, mask8, millimeters
from tiscene.frame.buffers import BUFFERS

if TYPE_CHECKING:
    from tiscene.export.packing import ExportRun, FramePieces
    from tiscene.frame.frame import Frame
    from tiscene.stream.stream import Stream

FRAMES_PER_FILE = None
READS_ONCE = True
PREVIEW = "preview.mp4"
PACKED = (PREVIEW, *(f"{name}.mkv" for name in BUFFERS))
# x264's tree of macroblocks reads memory that it never wrote when pictures are small: other bytes in a rare run.
_H264 = {"crf": "20", "preset": "veryfast", "mbtree": "0"}
# What FFmpeg converts to. Players guess another matrix for large pictures where a video does not say it.
_H264 |= {"colorspace": "smpte170m", "color_range": "tv", "color_primaries": "bt709", "color_trc": "iec61966-2-1"}
_LAYOUTS = {  # by dtype and number of channels: the layout of arrays, and of FFV1's pixels
    ("uint8", 3): ("rgb24", "bgr0"),
    ("uint8", 1): ("gray", "gray"),
    ("uint16", 1): ("gray16le", "gray16le"),
    ("uint16", 3): ("rgb48le", "gbrp16le"),
}


class VideoWriter:
    """Writes a video frame by frame; the same frames give the same bytes. A context manager.

    Args:
        path: Of the file.
        fps: Frames per second.
        codec: "ffv1" or "libx264".
    """

    def __init__(self, path: Path, fps: float, codec: str) -> None:
        import av

        self._av, self._codec = av, codec
        self._rate = frame_rate(fps)
        if not self._rate:
            raise ExportError(f"fps={fps:g}: videos have at least one frame in 1001 s; export in another format")
        self._container = av.open(str(path), "w", options={"fflags": "+bitexact"})
        self._stream: Any = None
        self._count = 0

    def write(self, pixels: NDArray[Any]) -> None:
        """Append a picture: uint8 or uint16, [h, w] or [h, w, 3]."""
        layout, ffv1 = _LAYOUTS[str(pixels.dtype), 1 if pixels.ndim == 2 else pixels.shape[2]]
        if self._codec != "ffv1":  # H.264 has half the colors along each axis: even sizes
            pixels = np.pad(pixels, [(0, size % 2) for size in pixels.shape[:2]] + [(0, 0)], "edge")
        elif pixels.shape[1] == 1 < pixels.shape[0]:
            raise ExportError("width=1: FFmpeg writes no FFV1 videos that are one pixel wide; export in another format")
        if self._stream is None:
            options = {"level": "3", "g": "1"} if self._codec == "ffv1" else _H264
            self._stream = self._container.add_stream(self._codec, rate=self._rate, options=options)
            self._stream.height, self._stream.width = pixels.shape[:2]
            self._stream.pix_fmt = ffv1 if self._codec == "ffv1" else "yuv420p"
            self._stream.codec_context.thread_count = 1  # slices of several threads would change the bytes
        frame = self._av.VideoFrame.from_ndarray(np.ascontiguousarray(pixels), format=layout)
        frame.pts = self._count
        frame.time_base = 1 / self._rate
        self._count += 1
        for packet in self._stream.encode(frame):
            self._container.mux(packet)

    def __enter__(self) -> VideoWriter:
        return self

    def __exit__(self, *error: object) -> None:
        if self._stream is not None:
            for packet in self._stream.encode():
                self._container.mux(packet)
        self._container.close()


def frame_rate(fps: float) -> Fraction:
    """Return the frame rate of a video of some frames per second."""
    return Fraction(fps).limit_denominator(1001)


def check(buffers: Iterable[str]) -> None:
    """Raise ExportError for a buffer that has no form as video."""
    for name in buffers:
        pixels(name, np.zeros(BUFFERS[name].shape(1, 1), BUFFERS[name].dtype))


def pieces(frame: Frame, labels: dict[str, Any], stream: Stream) -> dict[str, Contents]:
    """Return the pixels of each buffer.

    Raises:
        ExportError: A buffer has no form as video.
    """
    return {name: partial(_piece, name, buffer) for name, buffer in frame.buffers.items()}


def pack(frames: Iterable[FramePieces], run: ExportRun, folder: Path) -> None:
    """Write the videos, all at once, a frame at a time."""
    with ExitStack() as stack:
        targets = {}
        for name in run.buffers:
            targets[name] = stack.enter_context(VideoWriter(folder / f"{name}.mkv", run.fps, "ffv1"))
        if "rgb" in run.buffers:
            targets[PREVIEW] = stack.enter_context(VideoWriter(folder / PREVIEW, run.fps, "libx264"))
        for frame in frames:
            for name, target in targets.items():
                target.write(from_npy(frame.members["rgb" if name == PREVIEW else name]))


def _piece(name: str, buffer: NDArray[Any]) -> bytes:
    return npy(pixels(name, buffer))


def pixels(name: str, buffer: NDArray[Any]) -> NDArray[Any]:
    """Return a buffer as pixels of a video: uint8 or uint16, [h, w] or [h, w, 3]."""
    if buffer.dtype == np.uint8:
        return buffer
    if buffer.dtype == np.bool_:
        return mask8(buffer)
    if np.issubdtype(buffer.dtype, np.integer):
        return ids16(name, buffer)
    if name in ("depth", "distance"):
        return millimeters(buffer)
    if name in ("forward_flow", "backward_flow"):
        return kitti(buffer)
    raise ExportError(f"buffer {name!r} has no form as video: leave it out, or export as npz, exr or webdataset")
