# SPDX-License-Identifier: Apache-2.0
"""PathImage: what the path pass renders."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
