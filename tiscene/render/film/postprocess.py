# SPDX-License-Identifier: Apache-2.0
"""Denoising and upsampling of radiance images."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tiscene.render.film.denoise import denoise
from tiscene.render.film.light_nearby import light_nearby
from tiscene.render.film.shrinkage import shrunk_change
from tiscene.render.film.smooth_light import apply_reduced_light
from tiscene.render.film.upsample import demodulate, upsample
from tiscene.render.integrators.incremental.base_image import IncrementalBase
from tiscene.render.integrators.incremental.changed_regions import MARGIN, NARROW_MARGIN, Region, regions_of
from tiscene.render.integrators.incremental.incremental_pass import IncrementalImage
from tiscene.render.integrators.panorama.light_changes import REDUCTION
from tiscene.render.integrators.panorama.panorama_pass import PanoramaImage
from tiscene.render.integrators.path.path_image import PathImage

FloatImage = NDArray[np.float32]
COARSE_FACTOR = 2  # additional downscale of incremental images outside of changed regions
BLOCK_NOISE = 1.2  # contrast between blocks of a panorama with one sample per pixel, in noisy light
LEFT = 0.7  # share of a base's light from which on all of its correction is added
COARSE, FINE = "coarse", "fine"  # names of the two resolutions in cache keys


@dataclass(frozen=True)
class Postprocessor:
    """Denoising and upsampling with fixed settings.

    Attributes:
        denoiser: One of `denoise.QUALITIES`; None: no denoising.
        downscale: Factor per axis by which irradiance is denoised at a lower resolution.
        sharp: Albedo and normal are noise-free; False with depth of field.
    """

    denoiser: str | None
    downscale: int
    sharp: bool

    def process(self, image: PathImage | PanoramaImage, albedo: FloatImage, normal: FloatImage) -> FloatImage:
        """Return the radiance, [h, w, 3], of an image; if it is path traced, of the reduced size.

        Args:
            image: The image.
            albedo: Of full size, float32 [h, w, 3].
            normal: The same.
        """
        if isinstance(image, PanoramaImage):
            return self.process_panorama(image)
        if isinstance(image, IncrementalImage):
            return self.process_incremental(image)
        if self.downscale == 1:
            return self._denoised(image.hdr, image.albedo, image.normal, self.sharp)
        irradiance, white, _ = demodulate(image.hdr, image.albedo, image.normal)
        return upsample(self._denoised(irradiance, white, image.normal, False), image.normal, albedo, normal)

    def process_incremental(self, image: IncrementalImage) -> FloatImage:
        """Return the radiance, [h, w, 3], of an incremental image, base plus difference, both of full size.

        The sum is denoised: with `downscale`, at full resolution in changed regions only, and at a lower resolution
        elsewhere, where illumination changes smoothly. The denoiser's error on the base is known, since the base is
        denoised once at high quality; outside of movers it is corrected.
        """
        if self.denoiser is None:
            return np.maximum(image.hdr, 0.0)  # a difference may be below minus the base
        noisy = np.maximum(image.filtered, 0.0), image.albedo, image.normal
        shown = self._corrected(self._quick(*noisy), image, (slice(None), slice(None)), COARSE)
        if self.downscale > 1:
            for rows, columns in image.changed_regions:
                here = rows, columns
                radiance, albedo, normal = (each[here] for each in noisy)
                fine = self._corrected(self._denoised(radiance, albedo, normal, False), image, here, FINE)
                weight = blend_weights(here, shown.shape[0], shown.shape[1])
                shown[here] += weight * (fine - shown[here])
        return np.maximum(shown, 0.0, out=shown)

    def process_panorama(self, image: PanoramaImage) -> FloatImage:
        """Return the radiance, [h, w, 3], of an image over a panorama.

        The cells of the panorama are denoised already. Path-traced pixels are denoised in rectangles around them; those
        beside movers are blended with the rest in the end.

        Where light varies slowly it is that of the static image denoised as a whole, at reduced size; and so is the
        light of what edges hide from the panorama's center, unless its samples tell otherwise. The movers' change of
        light is what they change in the denoised irradiance, as far as it is more than noise.
        """
        if self.denoiser is None:
            return np.maximum(image.hdr, 0.0)
        paths, (height, width) = np.zeros_like(image.denoised), image.traced.shape
        for here in regions_of(image.traced):
            clean = self._denoised(image.static[here], image.albedo[here], image.normal[here], self.sharp)
            weight = blend_weights(here, height, width, NARROW_MARGIN)  # rectangles may overlap
            paths[here] += weight * (clean - paths[here])
        kept = image.traced & (image.beside == 0.0)
        shown = np.where(kept[..., None], paths, image.denoised)
        before = self._denoised(image.before, image.white, image.reduced_normal, False)
        if len(image.hidden.pixels):
            self._add_hidden(image, before, shown)
        guides = image.albedo, image.normal
        own, _, _ = demodulate(shown, *guides, REDUCTION)
        change = np.zeros_like(before)
        if image.after is not None:
            change = self._denoised(image.after, image.white, image.reduced_normal, False) - before
            change = shrunk_change(change, image.after - image.before, image.reduced_normal)
        if image.emitted is not None:
            change += self._denoised(image.emitted, image.white, image.reduced_normal, False)
        apply_reduced_light(
            shown, own, before, image.before, change, image.reduced_normal, guides, kept, image.static_mask, REDUCTION,
            contrast=BLOCK_NOISE / math.sqrt(image.panorama_spp),
        )  # fmt: skip
        shown += image.beside[..., None] * (paths - shown)
        return shown

    def _add_hidden(self, image: PanoramaImage, irradiance: FloatImage, shown: FloatImage) -> None:
        """Add the light of parts of pixels that are hidden from the panorama's center, in place."""
        hidden, known = image.hidden, (image.denoised, image.static_mask, image.albedo, image.normal)
        expected = light_nearby(
            hidden.pixels, hidden.albedo, hidden.normal, known, irradiance, image.reduced_normal, REDUCTION
        )
        expected *= 1.0 - image.static_mask.reshape(-1, 1)[hidden.pixels]
        shown.reshape(-1, 3)[hidden.pixels] += hidden.estimate(expected)

    def _corrected(self, quick: FloatImage, image: IncrementalImage, here: Region, kind: str) -> FloatImage:
        """Add the known corrections outside of movers, in place, as far as the light that they correct is there."""
        correction, shown = np.zeros_like(quick), np.zeros_like(quick)
        for group, factor in enumerate(image.factors):
            if factor.any():
                error, rough = self._correction(image.base, group, kind)
                correction += error[here] * factor
                shown += rough[here] * factor
        left = _channel_sum(quick) / np.maximum(_channel_sum(shown), np.float32(1e-6))
        quick += np.clip(left / LEFT, 0.0, 1.0) * image.static_mask[here] * correction
        return quick

    def _correction(self, base: IncrementalBase, group: int, kind: str) -> tuple[FloatImage, FloatImage]:
        """Return high-quality denoising of a base under a light group minus that of frames, and the latter; cached."""
        name = f"{kind} correction of {self} in group {group}"
        if name not in base.derived:
            best = denoise(*base.channels(group), "high", clean=self.sharp)
            noisy = base.noise_matched_channels(group)
            rough = self._quick(*noisy) if kind == COARSE else self._denoised(*noisy, False)
            base.derived[name] = best - rough, rough
        return base.derived[name]

    def _quick(self, radiance: FloatImage, albedo: FloatImage, normal: FloatImage) -> FloatImage:
        """Denoise at the coarse resolution."""
        if self.downscale == 1:
            return self._denoised(radiance, albedo, normal, self.sharp)
        smaller = COARSE_FACTOR * self.downscale
        irradiance, white, coarse = demodulate(radiance, albedo, normal, smaller)
        return upsample(self._denoised(irradiance, white, coarse, False), coarse, albedo, normal, smaller)

    def _denoised(self, radiance: FloatImage, albedo: FloatImage, normal: FloatImage, clean: bool) -> FloatImage:
        if self.denoiser is None:
            return radiance
        return denoise(radiance, albedo, normal, self.denoiser, clean=clean)


def _channel_sum(image: FloatImage) -> FloatImage:
    """Return the sums of red, green and blue, [h, w, 1]; faster than NumPy's along so short an axis."""
    return image[..., :1] + image[..., 1:2] + image[..., 2:]


def blend_weights(region: Region, height: int, width: int, margin: int = MARGIN) -> FloatImage:
    """Return blending weights [h, w, 1] that rise from 0 to 1 at the sides of a region that are inside the image.

    Args:
        region: The region.
        height: Image height, px.
        width: Image width, px.
        margin: How far inside a side the weight is 1, px.
    """
    ramps = []
    for span, size in zip(region, (height, width), strict=True):
        here = np.arange(span.start, span.stop, dtype=np.float32) + 0.5
        ramp = np.ones(len(here), np.float32)
        if span.start > 0:
            ramp = np.minimum(ramp, (here - span.start) / margin)
        if span.stop < size:
            ramp = np.minimum(ramp, (span.stop - here) / margin)
        ramps.append(ramp)
    return np.minimum(ramps[0][:, None, None], ramps[1][None, :, None])
