# SPDX-License-Identifier: Apache-2.0
"""Animated images that browsers show: WebP (small, full color), GIF or APNG."""

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

# Arguments of PIL.Image.save by suffix.
OPTIONS: dict[str, dict[str, Any]] = {
    ".webp": {"format": "webp", "quality": 82, "method": 4},
    ".gif": {"format": "gif", "optimize": False},
    ".png": {"format": "png"},
}


def write_animation(path: str | Path, images: Sequence[NDArray[np.uint8]], fps: float) -> None:
    """Write an animation that loops forever.

    Args:
        path: A file with the suffix .webp, .gif or .png.
        images: uint8 [h, w, 3], all of the same size.
        fps: Images per second.

    Raises:
        ArgumentError: Another suffix, no images, or images of different sizes.
        ExportError: The file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in OPTIONS:
        raise ArgumentError(f"{str(path)!r}: the suffix of an animation must be {', '.join(OPTIONS)}")
    if not images or len({image.shape for image in images}) != 1:
        raise ArgumentError("an animation needs at least one image, and all must have the same size")
    first, *rest = [Image.fromarray(image) for image in images]
    data = io.BytesIO()
    options = OPTIONS[path.suffix.lower()]
    first.save(data, save_all=True, append_images=rest, duration=round(1000.0 / fps), loop=0, **options)
    with export_errors(path):
        write_atomically(path, data.getvalue())
