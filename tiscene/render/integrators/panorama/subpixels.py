# SPDX-License-Identifier: Apache-2.0
"""Subpixels that a panorama does not know: path traced one by one, and added to what it knows of their pixels.

Beside edges, a walking camera sees a strip of what the edge hides from the panorama's center, often narrower than a
pixel. Paths through those subpixels alone have less variance than paths through whole pixels.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.kernel_types import Floats2, Floats3, Ints1, Ints2, Template, vec3
from tiscene.render.columns import read3
from tiscene.render.film.james_stein import james_stein
from tiscene.render.film.upsample import ALBEDO_OFFSET
from tiscene.render.integrators.panorama.reprojection_kernels import (
    ALL_KNOWN,
    NONE_KNOWN,
    PLACES,
    SIDE,
    SUBPIXELS,
    known_subpixels,
)
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.integrators.path.path_scene import PathScene
from tiscene.render.integrators.path.path_state import PathState
from tiscene.render.intersect.ray_queue import ROW, Pixels, Rays, write_ray
from tiscene.render.view import View, camera_ray
from tiscene.scene.placement import CURRENT

FloatImage = NDArray[np.float32]

REACH = 3  # subpixels to each side over which path-traced light is averaged
AROUND = 8  # px to each side over which the variance of light is averaged
_DOWN, _RIGHT = np.divmod(np.arange(SUBPIXELS), SIDE)  # places of the subpixels of a pixel


class Hidden(NamedTuple):
    """Path-traced parts of pixels, which edges hide from the center of a panorama.

    Attributes:
        pixels: int32 [n], the pixels, y * width + x.
        light: The parts' share of the pixels' radiance, with the irradiance averaged around them, float32 [n, 3].
        albedo: Mean albedo of the parts, float32 [n, 3].
        normal: Their mean normal, float32 [n, 3].
        variance: Of `light`, the sum over red, green and blue, as the samples' own variance suggests, float32 [n].
        relative_variance: The same relative to squared light, as the samples of the parts around suggest, float32 [n].
    """

    pixels: NDArray[np.int32]
    light: FloatImage
    albedo: FloatImage
    normal: FloatImage
    variance: FloatImage
    relative_variance: FloatImage

    def estimate(self, expected: FloatImage) -> FloatImage:
        """Return `light`, moved towards what is expected as far as its error does not tell them apart.

        The variance is at least the relative one, with either mean: a few dark samples do not make a black surface, nor
        does a bright one make a white spot.

        Args:
            expected: Light from other sources, float32 [n, 3].
        """
        squared_mean = np.maximum((expected**2).sum(axis=-1), (self.light**2).sum(axis=-1))
        variance = np.maximum(self.variance, self.relative_variance * squared_mean)[:, None]
        return james_stein(self.light, expected, variance)


class SubpixelPaths:
    """Traces paths through subpixels.

    Args:
        paths: Path tracer.
    """

    def __init__(self, paths: PathPass) -> None:
        self._paths = paths

    def fill(
        self,
        view: View,
        known: NDArray[np.int32],
        images: tuple[FloatImage, FloatImage, FloatImage, FloatImage],
        *,
        spp: int,
        key: int,
        max_depth: int,
        scene: PathScene | None = None,
    ) -> Hidden:
        """Add the subpixels that are not known to images, in place.

        Args:
            view: Camera and image size.
            known: int32 [h, w], bits of the known subpixels, see `reproject`; NONE_KNOWN where a pixel shows something
                else altogether.
            images: Radiance, denoised radiance, albedo and normal, float32 [h, w, 3], means over the known subpixels.
                Of the denoised radiance, hidden parts of pixels are left out as if they were black.
            spp: Paths per subpixel.
            key: Key of the random numbers, see `frame_key`.
            max_depth: Largest number of segments of a path.
            scene: Scene data; None: see `PathPass.sums`.

        Returns:
            What is hidden in pixels with known subpixels, and beside them.
        """
        pixels = np.flatnonzero(known != ALL_KNOWN).astype(np.int32)
        bits = known.reshape(-1)[pixels]
        missing = (~bits[:, None] >> np.arange(SUBPIXELS) & 1 > 0) | (bits == NONE_KNOWN)[:, None]
        y, x = np.divmod(pixels[:, None], view.width)
        enlarged = replace(view, width=SIDE * view.width, height=SIDE * view.height)
        subpixels = ((SIDE * y + _DOWN) * enlarged.width + SIDE * x + _RIGHT)[missing].astype(np.int32)
        lengths = (3, 3, 3, 1, 1)
        parts = [np.zeros((len(pixels), length), np.float32) for length in lengths]
        if len(pixels):

            def aim(state: PathState, first: int, count: int) -> None:
                _aim_at_points(known, view.array(), self._paths.pixels, first, count, spp, state.rays)

            sums = self._paths.sums(
                enlarged, subpixels, spp=spp, key=key, max_depth=max_depth, scene=scene, on_start=aim
            )
            samples = sums / np.float32(spp)
            rows = np.full((enlarged.height, enlarged.width), -1, np.int32)
            rows.reshape(-1)[subpixels] = np.arange(len(subpixels), dtype=np.int32)
            _fill(pixels, rows, samples, known, *images, *parts)
        is_hidden = bits != NONE_KNOWN
        light, albedo, normal, variance, share = (part[is_hidden] for part in parts)
        hidden, share = pixels[is_hidden], share[:, 0] / np.float32(spp)
        spread = _spread(hidden, view.width, variance[:, 0], share * (light**2).sum(axis=-1), spp)
        return Hidden(hidden, light, albedo, normal, variance[:, 0], spread * share)


def _spread(
    pixels: NDArray[np.int32], width: int, variance: FloatImage, exponential: FloatImage, spp: int
) -> FloatImage:
    """Return how much samples vary around some pixels, compared with exponentially distributed ones, at least 1.

    In a dark room, most paths find nothing and few the light. Where none has found it, the samples' own variance is
    small. What exceeds 1 is uncertain too, the more so the fewer the paths: with one a subpixel it counts twice.

    Args:
        pixels: int32 [n], y * width + x.
        width: Image width, px.
        variance: Of the means of samples at these pixels, float32 [n].
        exponential: What it would be if samples were exponentially distributed, float32 [n].
        spp: Paths per subpixel.

    Returns:
        float32 [n].
    """
    if not len(pixels):
        return variance
    sums = []
    for values in (variance, exponential):
        image = np.zeros((int(pixels.max()) // width + 1, width))
        image.reshape(-1)[pixels] = values
        corners = np.pad(image, ((AROUND + 1, AROUND), (AROUND + 1, AROUND))).cumsum(axis=0).cumsum(axis=1)
        side = 2 * AROUND + 1
        boxes = corners[side:, side:] - corners[:-side, side:] - corners[side:, :-side] + corners[:-side, :-side]
        sums.append(boxes.reshape(-1)[pixels])
    # Box sums are differences of running sums, so that zero is not exact.
    ratio = sums[0] / np.maximum(sums[1], 1e-12 * float(exponential.sum()) + 1e-30)
    spread: FloatImage = np.maximum(ratio + (ratio - 1.0) / spp, 1.0).astype(np.float32)
    return spread


@ti.kernel
def _aim_at_points(known: Ints2, view: Floats2, pixels: Pixels, first: ti.i32, count: ti.i32, spp: ti.i32, rays: Rays):
    """Replace camera rays through hidden subpixels by rays through the points that were found to be hidden.

    Elsewhere in a subpixel there may be the surface whose edge hides the point.

    Args:
        known: i32 [h, w], as of `_fill`. Pixels that show something else altogether keep their rays.
        view: The view, of a pinhole camera.
        pixels: The subpixels that are traced.
        first: Number of the path in row 0.
        count: Number of paths.
        spp: Paths per subpixel.
        rays: Input and output.
    """
    height, width = known.shape[0], known.shape[1]
    for i in range(count):
        y, x = pixels[(first + i) // spp][ROW] // (SIDE * width), pixels[(first + i) // spp][ROW] % (SIDE * width)
        if known[y // SIDE, x // SIDE] != NONE_KNOWN:
            for s in ti.static(range(SUBPIXELS)):
                if s == y % SIDE * SIDE + x % SIDE:
                    right, down = PLACES[s]
                    origin, direction = camera_ray(view, CURRENT, x // SIDE + right, y // SIDE + down, width, height)
                    write_ray(rays, i, origin, direction, ti.math.inf)


@ti.kernel
def _fill(
    pixels: Ints1,
    rows: Ints2,
    samples: Floats2,
    known: Ints2,
    radiance: Floats3,
    denoised: Floats3,
    albedo: Floats3,
    normal: Floats3,
    hidden_light: Floats2,
    hidden_albedo: Floats2,
    hidden_normal: Floats2,
    hidden_variance: Floats2,
    hidden_share: Floats2,
):
    """Add path-traced subpixels to the means over those that are known.

    Args:
        pixels: i32 [n], the pixels with unknown subpixels, y * width + x.
        rows: i32 [SIDE * h, SIDE * w], row of each subpixel in `samples`; -1: it is known.
        samples: f32 [m, at least 9], radiance, albedo and normal of subpixels.
        known: i32 [h, w], of `reproject`; NONE_KNOWN where a pixel shows something else altogether.
        radiance, albedo, normal: Input and output, f32 [h, w, 3].
        denoised: The same; the path-traced subpixels are left out as if they were black.
        hidden_light, hidden_albedo, hidden_normal, hidden_variance, hidden_share: Outputs, f32 [n, 3 or 1], of
            `Hidden`.
    """
    width = known.shape[1]
    for i in range(pixels.shape[0]):
        y, x = pixels[i] // width, pixels[i] % width
        number = known_subpixels(known[y, x])
        light, white, up, smooth, deviation, share = vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0), 0.0, 0.0
        for down, right in ti.ndrange(SIDE, SIDE):
            row = rows[y * SIDE + down, x * SIDE + right]
            if row >= 0:
                light += read3(samples, row, 0)
                white += read3(samples, row, 3)
                up += read3(samples, row, 6)
                if known[y, x] != NONE_KNOWN:
                    mean, error, own = smoothed(rows, samples, known, y * SIDE + down, x * SIDE + right, row)
                    smooth += mean
                    deviation += error  # the same samples: standard deviations add up
                    share = ti.max(share, own)
        for c in ti.static(range(3)):
            radiance[y, x, c] = (number * radiance[y, x, c] + light[c]) / SUBPIXELS
            denoised[y, x, c] *= number / SUBPIXELS
            albedo[y, x, c] = (number * albedo[y, x, c] + white[c]) / SUBPIXELS
            normal[y, x, c] = (number * normal[y, x, c] + up[c]) / SUBPIXELS
            hidden_light[i, c] = smooth[c] / SUBPIXELS
            hidden_albedo[i, c] = white[c] / (SUBPIXELS - number)
            hidden_normal[i, c] = up[c] / (SUBPIXELS - number)
        hidden_variance[i, 0] = (deviation / SUBPIXELS) ** 2
        hidden_share[i, 0] = share


@ti.func
def smoothed(rows: Template, samples: Template, known: Template, y: ti.i32, x: ti.i32, own: ti.i32):
    """Return the radiance of a hidden subpixel, with the mean irradiance of those around it that are oriented like it.

    Returns:
        The radiance, its standard deviation, and one over the number of subpixels, in effect.
    """
    normal = read3(samples, own, 6)
    sums, squares, total, total_squares = vec3(0.0), 0.0, 0.0, 0.0
    for down, right in ti.ndrange((-REACH, REACH + 1), (-REACH, REACH + 1)):
        at_y, at_x = y + down, x + right
        if at_y >= 0 and at_y < rows.shape[0] and at_x >= 0 and at_x < rows.shape[1]:
            row = rows[at_y, at_x]
            if row >= 0 and known[at_y // SIDE, at_x // SIDE] != NONE_KNOWN:
                weight = ti.max(normal.dot(read3(samples, row, 6)), 0.0) ** 4
                irradiance = read3(samples, row, 0) / (read3(samples, row, 3) + ALBEDO_OFFSET)
                sums += weight * irradiance
                squares += weight * irradiance.norm_sqr()
                total += weight
                total_squares += weight * weight
    result, deviation, share = read3(samples, own, 0), 0.0, 0.0  # the background
    if total > 0.0:
        mean = sums / total
        share = total_squares / total**2
        white = read3(samples, own, 3) + ALBEDO_OFFSET
        result = mean * white
        variance = ti.max(squares / total - mean.norm_sqr(), 0.0) * share / ti.max(1.0 - share, 0.01)
        deviation = ti.sqrt(variance) * white.max()
    return result, deviation, share
