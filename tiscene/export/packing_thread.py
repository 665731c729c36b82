# SPDX-License-Identifier: Apache-2.0
"""PackingThread: the files of a group are written while its later frames are rendered.

Formats whose `READS_ONCE` is True read the pieces in the order of frames once, and nothing else that later frames
change. So most of their work is done when the last frame arrives. The files stay in the temporary folder until then: a
killed export loses nothing but time.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from tiscene.export.manifest import Manifest
from tiscene.export.packing import ExportRun, write_group


class _Stopped(Exception):
    """The export ends before the group is complete."""


class PackingThread:
    """Writes the files of one group into a temporary folder.

    Args:
        format: The module of the format.
        folder: Of the export.
        manifest: Of the export; it lists a frame of the group at least.
        indices: The frames of the group, ascending.
        present: Those whose pieces are there.
    """

    def __init__(
        self, format: Any, folder: Path, manifest: Manifest, indices: Sequence[int], present: Iterable[int]
    ) -> None:
        self.indices = indices
        self._present, self._stopped = set(present), False
        self._changed = threading.Condition()
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="tiscene-pack")
        self._known = self._thread.submit(
            write_group, format, folder, ExportRun.of(manifest), manifest.folders, indices, self._wait
        )

    def add(self, index: int) -> None:
        """Note that the pieces of a frame are there. Raises what the thread has raised, if it has."""
        with self._changed:
            self._present.add(index)
            self._changed.notify()
        if self._known.done():
            self._known.result()

    def finish(self) -> dict[str, str]:
        """Wait until the files are written; return what `write_group` returned. Every frame has been added."""
        known = self._known.result()
        self._thread.shutdown()
        return known

    def stop(self) -> None:
        """End the thread, at the next frame that it reads."""
        with self._changed:
            self._stopped = True
            self._changed.notify()
        with contextlib.suppress(Exception):
            self._known.result()
        self._thread.shutdown()

    def _wait(self, index: int) -> None:
        with self._changed:
            self._changed.wait_for(lambda: self._stopped or index in self._present)
            if self._stopped:
                raise _Stopped
