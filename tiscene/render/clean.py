"""Traced pictures without their noise, in full size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tiscene.render.denoise import denoise
from tiscene.render.integrators.path import PathImage
from tiscene.render.integrators.replay import ReplayImage
from tiscene.render.integrators.replay_base import Base
from tiscene.render.upsample import light, upsample

FloatImage = NDArray[np.float32]
# Patches are made of such squares, px, with so much around, and are as large as whole numbers of the last.
CELL, AROUND, STEP = 8, 8, 16


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
        if self.reduction > 1:
            self._sharpen(quick, image)
        return np.maximum(quick, 0.0, out=quick)

    def _sharpen(self, shown: FloatImage, image: ReplayImage) -> None:
        """Denoise in full size where something moves, as that was traced more finely too."""
        moved = image.unmoved[..., 0] == 0.0
        for rows, columns in patches(moved):
            here = moved[rows, columns]
            parts = (each[rows, columns] for each in (np.maximum(image.even, 0.0), image.albedo, image.normal))
            shown[rows, columns][here] = self._denoised(*parts, False)[here]

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


def patches(mask: NDArray[np.bool_]) -> list[tuple[slice, slice]]:
    """Rectangles that hold all of the mask, one for each group of it; of the whole picture, if that is no larger."""
    height, width = mask.shape
    padded = np.pad(mask, ((0, -height % CELL), (0, -width % CELL)))
    cells = padded.reshape(padded.shape[0] // CELL, CELL, padded.shape[1] // CELL, CELL).any(axis=(1, 3))
    left = set(map(tuple, np.argwhere(cells).tolist()))
    result = []
    while left:
        waiting, group = [left.pop()], []
        while waiting:
            row, column = waiting.pop()
            group.append((row, column))
            near = {(row + y, column + x) for y in (-1, 0, 1) for x in (-1, 0, 1)} & left
            left -= near
            waiting += near
        cell_rows, cell_columns = zip(*group, strict=True)
        result.append((_span(cell_rows, height), _span(cell_columns, width)))
    if sum((y.stop - y.start) * (x.stop - x.start) for y, x in result) >= mask.size:
        return [(slice(0, height), slice(0, width))]
    return result


def _span(cells: Sequence[int], size: int) -> slice:
    """Pixels along one axis that hold the cells and what is around them."""
    begin, end = min(cells) * CELL - AROUND, (max(cells) + 1) * CELL + AROUND
    length = min(-(-(end - begin) // STEP) * STEP, size)
    begin = max(0, min(begin, size - length))
    return slice(begin, begin + length)
