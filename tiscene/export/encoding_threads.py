# SPDX-License-Identifier: Apache-2.0
"""EncodingThreads: frames are encoded and written by threads while the next ones are rendered, and finish in order.

Compression, digests and file operations run without Python's global lock. What a frame adds to the manifest is recorded
by the thread that renders, in the order of frames, once its files are there.
"""

from __future__ import annotations

import contextlib
import os
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from types import TracebackType
from typing import TYPE_CHECKING

from tiscene.errors import TisceneError

if TYPE_CHECKING:
    from tiscene.export.folder_writer import FolderWriter, WrittenFrame
    from tiscene.frame.frame import Frame
    from tiscene.stream.stream import Stream

MAX_THREADS = 4  # each holds a frame and its encoded files


@dataclass(frozen=True)
class _Pending:
    """A frame that is not finished: the frame and what its files will be; None for one that was there already."""

    index: int
    frame: Frame | None = None
    written: Future[WrittenFrame] | None = None


class EncodingThreads:
    """Writes frames in threads. A context manager: at its end all frames are finished, or, after an error, recorded.

    Args:
        writer: Of the folder.
        finish: Called in the order of frames, by the thread that renders, with the index of a frame whose files are
            there, and the frame; None for one that was there before.
    """

    def __init__(self, writer: FolderWriter, finish: Callable[[int, Frame | None], None]) -> None:
        self._writer, self._finish = writer, finish
        self._count = min(MAX_THREADS, os.cpu_count() or 1)
        self._threads = ThreadPoolExecutor(self._count, thread_name_prefix="tiscene-export")
        self._pending: deque[_Pending] = deque()

    def write(self, frame: Frame, stream: Stream) -> None:
        """Begin to write a frame. Waits for the oldest one if as many as there are threads are being written."""
        self._reserve()
        written = self._threads.submit(self._writer.writing(frame, stream))
        self._pending.append(_Pending(frame.index, frame, written))

    def skip(self, index: int) -> None:
        """Finish a frame that is in the folder already, after those before it."""
        self._reserve()
        self._pending.append(_Pending(index))

    def _reserve(self) -> None:
        """Wait until fewer frames than threads are pending."""
        while len(self._pending) >= self._count:
            self._finish_first()

    def _finish_first(self) -> None:
        first = self._pending.popleft()
        self._record(first)
        self._finish(first.index, first.frame)

    def _record(self, pending: _Pending) -> None:
        if pending.written is not None:
            self._writer.record(pending.index, pending.written.result())

    def __enter__(self) -> EncodingThreads:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            while kind is None and self._pending:
                self._finish_first()
        finally:
            for pending in self._pending:  # after an error: what has been rendered is not lost
                with contextlib.suppress(TisceneError, OSError):
                    self._record(pending)
            self._threads.shutdown()
