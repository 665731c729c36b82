# SPDX-License-Identifier: Apache-2.0
"""Shrinkage of noisy changes of light towards the mean around, as far as noise could explain the difference.

A few paths find how movers change the light of a frame. The denoiser takes single ones that a mover stops for shadows:
dark spots, elsewhere in each frame. Here a denoised change is drawn to the mean around, unless the paths nearby agree.
"""

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.kernel_types import Floats3, Template, vec3
from tiscene.render.film.james_stein import james_stein
from tiscene.render.film.upsample import read, similarity

FloatImage = NDArray[np.float32]

NEAR, AROUND = 2, 4  # px to each side: of the window whose mean the denoised change is like, and of a wider one
DOUBT = 6.0  # variances that a change is drawn by: it takes some six paths that agree to show


def shrunk_change(change: FloatImage, samples: FloatImage, normal: FloatImage) -> FloatImage:
    """Return a denoised change of light, shrunk towards the mean around as far as it may be noise, see `james_stein`.

    Args:
        change: Change of irradiance, denoised, float32 [h, w, 3].
        samples: The same, as paths have found it, float32 [h, w, 3].
        normal: Normals, float32 [h, w, 3]. Means are over surfaces of like orientation.

    Returns:
        float32 [h, w, 3], a new array.
    """
    height, width, _ = change.shape
    means, variances = np.empty_like(change), np.empty((height, width, 1), np.float32)
    _find_means(samples, normal, means, variances)
    return james_stein(change, means, np.float32(DOUBT) * variances)


@ti.kernel
def _find_means(samples: Floats3, normal: Floats3, means: Floats3, variances: Floats3):
    """Find the mean of the samples around each pixel, and the variance of a mean of those near it."""
    for y, x in ti.ndrange(samples.shape[0], samples.shape[1]):
        mean, wide_variance, _wide_share = _around(samples, normal, y, x, AROUND)
        _near_mean, near_variance, share = _around(samples, normal, y, x, NEAR)
        # Where no path nearby has found a change, others around may have: no change would be as doubtful.
        variances[y, x, 0] = share * ti.max(near_variance, wide_variance)
        for c in ti.static(range(3)):
            means[y, x, c] = mean[c]


@ti.func
def _around(samples: Template, normal: Template, y: ti.i32, x: ti.i32, reach: Template):
    """Return mean and variance of the samples around a pixel, and one over their number, in effect.

    The variance is the sum over red, green and blue.
    """
    n = read(normal, y, x)
    sums, squares, total, total_squares = vec3(0.0), 0.0, 0.0, 0.0
    for down, right in ti.ndrange((-reach, reach + 1), (-reach, reach + 1)):
        at_y, at_x = y + down, x + right
        if at_y >= 0 and at_y < samples.shape[0] and at_x >= 0 and at_x < samples.shape[1]:
            weight = similarity(n, read(normal, at_y, at_x))
            sample = read(samples, at_y, at_x)
            sums += weight * sample
            squares += weight * sample.norm_sqr()
            total += weight
            total_squares += weight * weight
    mean = sums / total
    return mean, ti.max(squares / total - mean.norm_sqr(), 0.0), total_squares / total**2
