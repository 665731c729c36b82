# SPDX-License-Identifier: Apache-2.0
"""PathImage: what the path pass renders."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.render.integrators.path.wavefront_kernels import develop

FloatImage = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class PathImage:
    """Images of a path-traced frame, float32 [height, width, 3], means over the samples of each pixel.

    Attributes:
        hdr: Scene-linear Rec.709 radiance, W/m²/sr.
        albedo: Denoiser feature, 0..1: diffuse albedo of the first surface that is neither mirror nor clear glass, plus
            what it emits, at most 1.
        normal: Denoiser feature: shading normal of that surface, world space, of unit length before averaging.
    """

    hdr: FloatImage
    albedo: FloatImage
    normal: FloatImage


def developed(film: Any, pixels: Any, shape: tuple[int, int], spp: int) -> tuple[PathImage, int]:
    """Return a film as images, and the number of non-finite samples.

    Args:
        film: See `PathPass.film`.
        pixels: See `upload_pixels`.
        shape: Height and width of the image, px.
        spp: Samples per pixel.
    """
    hdr, albedo, normal = (np.empty((*shape, 3), np.float32) for _ in range(3))
    dropped = np.empty(shape, np.int32)
    develop(film, pixels, spp, hdr, albedo, normal, dropped)
    return PathImage(hdr, albedo, normal), int(dropped.sum())
