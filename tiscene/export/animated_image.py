# SPDX-License-Identifier: Apache-2.0
"""Pictures in a row as one animated file that browsers show: .webp (small, full color), .gif or .png."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tiscene.errors import ArgumentError, export_errors
from tiscene.files import write_atomically

OPTIONS: dict[str, dict[str, Any]] = {
    ".webp": {"format": "webp", "quality": 82, "method": 4},
    ".gif": {"format": "gif", "optimize": False},
    ".png": {"format": "png"},
}


def write_animation(path: str | Path, images: Sequence[NDArray[np.uint8]], fps: float) -> None:
    """Write uint8 images [h, w, 3] of one size as an endless loop.

    Raises ArgumentError for a suffix that is not in OPTIONS, for no images, or for images of different sizes,
    ExportError if it cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in OPTIONS:
        raise ArgumentError(f"{str(path)!r}: an animation ends in {', '.join(OPTIONS)}")
    if not images or len({image.shape for image in images}) != 1:
        raise ArgumentError("an animation needs one image or more, all of one size")
    first, *rest = [Image.fromarray(image) for image in images]
    data = io.BytesIO()
    options = OPTIONS[path.suffix.lower()]
    first.save(data, save_all=True, append_images=rest, duration=round(1000.0 / fps), loop=0, **options)
    with export_errors(path):
        write_atomically(Path(path), data.getvalue())
