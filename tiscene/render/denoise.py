"""Intel Open Image Denoise (https://www.openimagedenoise.org), through its Python binding `pyoidn`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def denoise(
    hdr: NDArray[np.float32], albedo: NDArray[np.float32], normal: NDArray[np.float32], quality: str = "high"
) -> NDArray[np.float32]:
    """The radiance without its noise, a new float32 [h, w, 3].

    albedo (0..1), normal (-1..1): of what is seen, the same shape; they are taken as free of noise and keep textures
    and edges sharp. quality: "fast", "balanced" or "high". The same bytes on one machine.
    """
    import pyoidn  # loads 60 MB of weights

    result: NDArray[np.float32] = pyoidn.denoise(
        hdr, np.clip(albedo, 0.0, 1.0), np.clip(normal, -1.0, 1.0), hdr=True, clean_aux=True, quality=quality
    )
    return result
