# SPDX-License-Identifier: Apache-2.0
"""Write what SAILenv agents receive as a recording in the layout of `sailenv_layout`, while a script runs."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import ExportError, export_errors
from tiscene.export.array_files import resolved
from tiscene.export.focus_of_attention import focus_file, focus_path
from tiscene.export.sailenv_layout import Recording, frame_files, summary_files
from tiscene.files import write_atomically
from tiscene.sailenv.recorded_classes import RecordedClasses

FOLDERS = ("frames", "motion", "sup")
FOCUS = "focus.foa"


class SailenvRecorder:
    """Writes a recording frame by frame. It is complete once `finish` has written the files about all frames."""

    def __init__(self, folder: Path, fps: float, classes: RecordedClasses, *, overwrite: bool = False) -> None:
        """Prepare the folder.

        Args:
            folder: The folder of the recording; created if needed.
            fps: Frames per second.
            classes: The classes of the pixels.
            overwrite: Whether an earlier recording in the folder is deleted.

        Raises:
            ExportError: The folder has a recording, or cannot be written.
        """
        self.folder, self.count = folder, 0
        self._fps, self._classes = fps, classes
        present = [folder / name for name in (*FOLDERS, FOCUS) if (folder / name).exists()]
        if present and not overwrite:
            raise ExportError(f"{str(folder)!r} has a recording: pass overwrite=True (--overwrite) to delete it")
        with export_errors(folder):
            for path in present:
                shutil.rmtree(path) if path.is_dir() else path.unlink()
            folder.mkdir(parents=True, exist_ok=True)

    def write(
        self,
        rgb: NDArray[np.uint8],
        flow: NDArray[np.float32],
        category: NDArray[np.uint8],
        categories: Mapping[int, str],
    ) -> None:
        """Write the next frame.

        Args:
            rgb: The main view, uint8 [h, w, 3].
            flow: The flow view, float32 [h, w, 2].
            category: The category view, uint8 [h, w].
            categories: Names of its numbers.
        """
        classes = self._classes.table(categories, 256)[category]
        self._write(resolved(frame_files(self.count, rgb, flow, classes)))
        self.count += 1

    def finish(self, *, focus: bool = True) -> None:
        """Write the files about all frames.

        Args:
            focus: Whether to compute a focus of attention, `focus.foa`.

        Raises:
            ExportError: There are no frames.
        """
        if not self.count:
            raise ExportError("nothing was recorded: the script has not asked for a frame")
        self._write(summary_files(self._fps, self.count, self._classes))
        if focus:
            recording = Recording(self.folder)
            frames = ((recording[index].rgb, recording[index].flow) for index in range(self.count))
            self._write({FOCUS: focus_file(focus_path(frames, self._fps))})

    def _write(self, files: Mapping[str, bytes]) -> None:
        with export_errors(self.folder):
            for name, data in files.items():
                write_atomically(self.folder / name, data)
