# SPDX-License-Identifier: Apache-2.0
"""Traced pictures without their noise, in full size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tiscene.render.film.denoise import denoise
from tiscene.render.film.upsample import light, upsample
from tiscene.render.integrators.incremental.base_image import IncrementalBase
from tiscene.render.integrators.incremental.changed_regions import MARGIN, Region
from tiscene.render.integrators.incremental.incremental_pass import IncrementalImage
from tiscene.render.integrators.path.path_pass import PathImage

FloatImage = NDArray[np.float32]
COARSER = 2  # so much smaller than other pictures are differences denoised where little has changed
COARSE, FINE = "coarse", "fine"  # how they are there, and how they are where much has changed


@dataclass(frozen=True)
class Postprocessor:
    """What is done to a picture before it is shown.

    denoiser: one of `denoise.QUALITIES`; None: the noise stays. downscale: light is denoised in a picture so many times
    smaller each way. sharp: albedo and normal have no noise themselves, as they have under a wide lens.
    """

    denoiser: str | None
    downscale: int
    sharp: bool

    def traced(self, image: PathImage, albedo: FloatImage, normal: FloatImage) -> FloatImage:
        """Radiance of a picture of the reduced size, along the albedo and normal of full size."""
        if self.downscale == 1:
            return self._denoised(image.hdr, image.albedo, image.normal, self.sharp)
        reached, white, _ = light(image.hdr, image.albedo, image.normal)
        return upsample(self._denoised(reached, white, image.normal, False), image.normal, albedo, normal)

    def difference(self, image: IncrementalImage) -> FloatImage:
        """Radiance of a picture that is a difference to a base, both of full size.

        What is denoised is the sum, as far as that goes in a moment: if light is reduced, in full size only where much
        has changed, and smaller still elsewhere, where light changes smoothly. Where no mover has come, the error that
        this makes of the base is known, since the base's best picture is computed once: it is taken off.
        """
        if self.denoiser is None:
            return np.maximum(image.hdr, 0.0)  # a difference may overshoot
        noisy = np.maximum(image.filtered, 0.0), image.albedo, image.normal
        shown = self._refined(self._quick(*noisy), image, (slice(None), slice(None)), COARSE)
        if self.downscale > 1:
            for rows, columns in image.changed_regions:
                here = rows, columns
                radiance, albedo, normal = (each[here] for each in noisy)
                fine = self._refined(self._denoised(radiance, albedo, normal, False), image, here, FINE)
                weight = inside(here, shown.shape[0], shown.shape[1])
                shown[here] += weight * (fine - shown[here])
        return np.maximum(shown, 0.0, out=shown)

    def _refined(self, quick: FloatImage, image: IncrementalImage, here: Region, kind: str) -> FloatImage:
        """Without what is known to be wrong with it."""
        for group, factor in enumerate(image.factors):
            if factor.any():
                more = self._refinement(image.base, group, kind)[here] * factor
                more *= image.static_mask[here]
                quick += more
        return quick

    def _refinement(self, base: IncrementalBase, group: int, kind: str) -> FloatImage:
        """What the best picture of a base under a group of lights has more than one that is made as those of frames."""
        name = f"{kind} refinement of {self} in group {group}"
        if name not in base.derived:
            best = denoise(*base.channels(group), "high", clean=self.sharp)
            rough = base.noise_matched_channels(group)
            base.derived[name] = best - (self._quick(*rough) if kind == COARSE else self._denoised(*rough, False))
        return base.derived[name]

    def _quick(self, radiance: FloatImage, albedo: FloatImage, normal: FloatImage) -> FloatImage:
        if self.downscale == 1:
            return self._denoised(radiance, albedo, normal, self.sharp)
        smaller = COARSER * self.downscale
        reached, white, coarse = light(radiance, albedo, normal, smaller)
        return upsample(self._denoised(reached, white, coarse, False), coarse, albedo, normal, smaller)

    def _denoised(self, radiance: FloatImage, albedo: FloatImage, normal: FloatImage, clean: bool) -> FloatImage:
        if self.denoiser is None:
            return radiance
        return denoise(radiance, albedo, normal, self.denoiser, clean=clean)


def inside(patch: Region, height: int, width: int) -> FloatImage:
    """Weights [h, w, 1] that grow from 0 to 1 along those sides of a patch that are not the picture's."""
    ramps = []
    for span, size in zip(patch, (height, width), strict=True):
        here = np.arange(span.start, span.stop, dtype=np.float32) + 0.5
        ramp = np.ones(len(here), np.float32)
        if span.start > 0:
            ramp = np.minimum(ramp, (here - span.start) / MARGIN)
        if span.stop < size:
            ramp = np.minimum(ramp, (span.stop - here) / MARGIN)
        ramps.append(ramp)
    return np.minimum(ramps[0][:, None, None], ramps[1][None, :, None])
