"""Traced pictures without their noise, in full size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tiscene.render.denoise import denoise
from tiscene.render.integrators.path import PathImage
from tiscene.render.integrators.replay import ReplayImage
from tiscene.render.integrators.replay_base import Base
from tiscene.render.upsample import light, upsample

FloatImage = NDArray[np.float32]


@dataclass(frozen=True)
class Cleaner:
    """What is done to a picture before it is shown.

    denoiser: one of `denoise.QUALITIES`; None: the noise stays. reduction: light is denoised in a picture so many times
    smaller each way. sharp: albedo and normal have no noise themselves, as they have under a wide lens.
    """

    denoiser: str | None
    reduction: int
    sharp: bool

    def traced(self, image: PathImage, albedo: FloatImage, normal: FloatImage) -> FloatImage:
        """Radiance of a picture of the reduced size, along the albedo and normal of full size."""
        if self.reduction == 1:
            return self._denoised(image.hdr, image.albedo, image.normal, self.sharp)
        reached, white, _ = light(image.hdr, image.albedo, image.normal)
        return upsample(self._denoised(reached, white, image.normal, False), image.normal, albedo, normal)

    def difference(self, image: ReplayImage) -> FloatImage:
        """Radiance of a picture that is a difference to a base, both of full size.

        What is denoised is the sum, as far as that goes in a moment. Where no mover has come, the error that this makes
        of the base is known, since the base's best picture is computed once: it is taken off.
        """
        if self.denoiser is None:
            return np.maximum(image.hdr, 0.0)  # a difference may overshoot
        quick = self._quick(np.maximum(image.even, 0.0), image.albedo, image.normal)
        for group, factor in enumerate(image.factors):
            if factor.any():
                more = self._refinement(image.base, group) * factor
                more *= image.unmoved
                quick += more
        return np.maximum(quick, 0.0, out=quick)

    def _refinement(self, base: Base, group: int) -> FloatImage:
        """What the best picture of a base under a group of lights has more than the quick one."""
        name = f"refinement of {self} in group {group}"
        if name not in base.kept:
            radiance, albedo, normal = base.parts(group)
            best = denoise(radiance, albedo, normal, "high", clean=self.sharp)
            base.kept[name] = best - self._quick(radiance, albedo, normal)
        return base.kept[name]

    def _quick(self, radiance: FloatImage, albedo: FloatImage, normal: FloatImage) -> FloatImage:
        if self.reduction == 1:
            return self._denoised(radiance, albedo, normal, self.sharp)
        reached, white, coarse = light(radiance, albedo, normal, self.reduction)
        return upsample(self._denoised(reached, white, coarse, False), coarse, albedo, normal, self.reduction)

    def _denoised(self, radiance: FloatImage, albedo: FloatImage, normal: FloatImage, clean: bool) -> FloatImage:
        if self.denoiser is None:
            return radiance
        return denoise(radiance, albedo, normal, self.denoiser, clean=clean)
