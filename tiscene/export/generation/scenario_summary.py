# SPDX-License-Identifier: Apache-2.0
"""ScenarioSummary: what the index of a data set knows of a scenario, gathered while its frames are written."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from tiscene.export.array_files import json_file, png
from tiscene.export.manifest import Manifest
from tiscene.files import write_atomically
from tiscene.frame.visualize import picture

if TYPE_CHECKING:
    from tiscene.frame.frame import Frame

FILE, THUMBNAIL = "summary.json", "thumbnail.png"
THUMBNAIL_WIDTH = 160  # px
SHOWN = ("rgb", "denoised", "instance", "semantic", "normal", "depth")  # the first that frames have is on thumbnails
FRAME_FIELDS = {"scene", "objects", "frames", "digest", "visible", "sizes", "mean_flow", "difficulty"}
SIZE_STEPS = 12  # size classes: more than 2^-(k+1) of the image and at most 2^-k; the last one has all smaller ones


class ScenarioSummary:
    """Gathers statistics of the frames of one scenario.

    Args:
        frames: Number of frames; measures of difficulty and the thumbnail are of the middle one.
    """

    def __init__(self, frames: int) -> None:
        self._middle = frames // 2
        self._visible: Counter[str] = Counter()
        self._sizes: Counter[int] = Counter()
        self._flow: list[float] = []
        self._difficulty: dict[str, Any] = {}
        self._thumbnail = b""

    def add(self, frame: Frame) -> None:
        """Add a frame."""
        if "instance" in frame:
            total = frame["instance"].size
            rows = {row.id: row.category for row in frame.objects}
            ids, counts = np.unique(frame["instance"], return_counts=True)
            for id, count in zip(ids.tolist(), counts.tolist(), strict=True):
                if id:
                    self._visible[rows.get(id, "")] += 1
                    self._sizes[min(SIZE_STEPS, int(-np.log2(count / total)))] += 1
        if "forward_flow" in frame:
            self._flow.append(float(np.linalg.norm(frame["forward_flow"], axis=2).mean()))
        if frame.index == self._middle:
            self._difficulty = asdict(frame.difficulty)
            self._thumbnail = _thumbnail(frame)

    def save(self, folder: Path, about: Mapping[str, Any], manifest: Manifest) -> None:
        """Write summary and thumbnail into the folder of the scenario, the summary last: it says that all is done."""
        if self._thumbnail:
            write_atomically(folder / THUMBNAIL, self._thumbnail)
        content = {
            **about,
            "frames": len(manifest.frames),
            "digest": frames_digest(manifest),
            "visible": dict(sorted(self._visible.items())),
            "sizes": {str(step): self._sizes[step] for step in sorted(self._sizes)},
            "mean_flow": float(np.mean(self._flow)) if self._flow else None,
            "difficulty": self._difficulty,
        }
        write_atomically(folder / FILE, json_file(content))


def frames_digest(manifest: Manifest) -> str:
    """Return the SHA-256 of the digests of all frames."""
    digests = "".join(manifest.frames[index]["digest"] for index in manifest.frames)
    return hashlib.sha256(digests.encode()).hexdigest()


def read_summary(folder: Path) -> dict[str, Any] | None:
    """Return the summary in the folder of a scenario; None if the scenario is not done, or its summary is damaged."""
    try:
        content = json.loads((folder / FILE).read_text())
    except (OSError, ValueError):
        return None
    if not isinstance(content, dict) or not {"number", "split"} <= content.keys():
        return None
    return content if "error" in content or content.keys() >= FRAME_FIELDS else None


def _thumbnail(frame: Frame) -> bytes:
    """Return a small picture of a frame as PNG."""

    name = next((name for name in SHOWN if name in frame), next(iter(frame)))
    image = Image.fromarray(picture(name, frame[name]).image)
    height = round(THUMBNAIL_WIDTH * image.height / image.width)
    smooth = Image.Resampling.LANCZOS if name == "rgb" else Image.Resampling.NEAREST
    return png(np.asarray(image.resize((THUMBNAIL_WIDTH, height), smooth)))
