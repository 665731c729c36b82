"""One frame's buffers: the label pass, and where colour is asked for, the path pass, the denoiser and the film."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import ArgumentError
from tiscene.render.aovs import COLORS, times_needed
from tiscene.render.base_image import BaseImages
from tiscene.render.denoise import denoise
from tiscene.render.film import meter, tone_map
from tiscene.render.integrators.labels import LabelPass
from tiscene.render.integrators.path import PathImage, PathPass
from tiscene.render.integrators.replay import CACHE_BYTES, ReplayImage, ReplayPass, Report
from tiscene.render.upsample import light, reduced, upsample
from tiscene.render.view import View
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT, Placement

FloatImage = NDArray[np.float32]
GUIDES = ("albedo", "normal")  # the labels that a picture traced in a smaller size is enlarged along


@dataclass(frozen=True)
class Quality:
    """What a path-traced picture may cost.

    spp: paths per pixel.
    max_depth: edges of a path: 1 shows what emits light, 2 adds direct light, n adds n - 2 bounces.
    denoise: run Intel Open Image Denoise over the radiance; False never touches a pixel.
    denoiser: how well, one of `denoise.QUALITIES`; "high" takes some four times as long as "fast".
    base_spp: paths per pixel of the base image of what stands still, where frames are differences to it.
    reduction: light is traced in a picture so many times smaller each way, and brought to full size along the surfaces
    that the labels show.
    """

    spp: int = 16
    max_depth: int = 6
    denoise: bool = True
    denoiser: str = "balanced"
    base_spp: int = 256
    reduction: int = 1

    def __post_init__(self) -> None:
        if self.spp < 1:
            raise ArgumentError(f"spp={self.spp}: at least one path per pixel")
        if self.max_depth < 1:
            raise ArgumentError(f"max_depth={self.max_depth}: a path has at least one edge")
        if self.reduction < 1:
            raise ArgumentError(f"reduction={self.reduction}: at least 1, which is full size")


QUALITIES = {
    "fast": Quality(spp=2, max_depth=4, denoiser="fast", base_spp=64, reduction=2),
    "preview": Quality(spp=4, max_depth=4, denoiser="fast", base_spp=64),
    "standard": Quality(spp=16, max_depth=6),
    "photo": Quality(spp=256, max_depth=12, denoiser="high", base_spp=1024),
}


class Renderer:
    """Renders one size of picture of one device scene."""

    METER_SIZE = (64, 48)
    METER_SPP = 32

    def __init__(
        self,
        scene: DeviceScene,
        width: int,
        height: int,
        quality: Quality,
        *,
        cache_bytes: int = CACHE_BYTES,
        report: Report | None = None,
    ) -> None:
        """cache_bytes: what kept paths may take of memory. report: is told what is being made, and how much is done."""
        self.scene = scene
        self.width = width
        self.height = height
        self.quality = quality
        self._traced_size = reduced(width, height, quality.reduction)
        self._labels = LabelPass(scene)
        self._paths = PathPass(scene, *self._traced_size)
        self._replay = ReplayPass(
            scene, *self._traced_size, memory_limit=cache_bytes, images=BaseImages(), report=report, paths=self._paths
        )

    def render(
        self,
        view: View,
        placement: Placement,
        buffers: Sequence[str],
        *,
        frame_index: int,
        seed: int,
        exposure: float,
        moving: NDArray[np.bool_] | None = None,
    ) -> dict[str, NDArray[Any]]:
        """The buffers named, in that order, each a new array. exposure: stops, for `rgb`.

        moving: bool [n], the instances that move before a camera and under lights that do not: colour is then a
        difference to an image of the others. None: colour is traced from nothing.
        """
        self._paths.background = view.background
        colored = not COLORS.isdisjoint(buffers)
        traced = view
        if self.quality.reduction > 1:
            traced = replace(view, width=self._traced_size[0], height=self._traced_size[1])
        if moving is not None and colored:
            quality = self.quality
            self._replay.prepare(
                traced, placement, moving,
                seed=seed, spp=quality.spp, max_depth=quality.max_depth, base_spp=max(quality.base_spp, quality.spp),
            )  # fmt: skip
        labels = [name for name in buffers if name not in COLORS]
        if colored and self.quality.reduction > 1:
            labels += [name for name in GUIDES if name not in labels]
        self.scene.place(placement, times=times_needed([*buffers, *labels]))
        result = self._labels.render(view, labels)
        if colored:
            result |= self._color(traced, frame_index, seed, exposure, buffers, moving, result)
        return {name: result[name] for name in buffers}

    def _color(
        self,
        view: View,
        frame_index: int,
        seed: int,
        exposure: float,
        buffers: Sequence[str],
        moving: NDArray[np.bool_] | None,
        labels: dict[str, NDArray[Any]],
    ) -> dict[str, NDArray[Any]]:
        """view: of the size that is traced. labels: the frame's, of full size."""
        image: PathImage
        if moving is not None:
            image = self._replay.render(moving)
        else:
            image = self._paths.render(
                view, frame_index=frame_index, seed=seed, spp=self.quality.spp, max_depth=self.quality.max_depth
            )
        result: dict[str, NDArray[Any]] = {}
        if "hdr" in buffers:
            result["hdr"] = self._enlarged(image.hdr, image, labels, view, denoised=False)
        if "rgb" in buffers:
            radiance = image.even if isinstance(image, ReplayImage) else image.hdr
            radiance = np.maximum(radiance, 0.0)  # a difference may overshoot
            radiance = self._enlarged(radiance, image, labels, view, denoised=self.quality.denoise)
            if any(view.ambient):
                albedo, normal = image.albedo, image.normal
                if self.quality.reduction > 1:
                    albedo, normal = (labels[name] for name in GUIDES)
                surface = normal.any(axis=-1, keepdims=True)
                radiance = radiance + np.where(surface, albedo, 0.0) * np.array(view.ambient, np.float32)
            result["rgb"] = tone_map(radiance, exposure)
        return result

    def _enlarged(
        self, radiance: FloatImage, image: PathImage, labels: dict[str, NDArray[Any]], view: View, *, denoised: bool
    ) -> FloatImage:
        """Radiance of the size that is traced in full size, denoised or not."""
        sharp = view.current.lens_radius == 0.0
        albedo, reduction = image.albedo, self.quality.reduction
        if reduction > 1:
            radiance, albedo = light(radiance, albedo, image.normal)
        if denoised:
            clean = sharp and reduction == 1
            radiance = denoise(radiance, albedo, image.normal, self.quality.denoiser, clean=clean)
        if reduction > 1:
            radiance = upsample(radiance, image.normal, *(labels[name] for name in GUIDES))
        return radiance

    def meter(self, view: View, placement: Placement, *, seed: int) -> float:
        """The exposure in stops that shows this placement well, from a small picture of it."""
        width, height = self.METER_SIZE
        self.scene.place(placement, times=(CURRENT,))
        view = View(*view.cameras, width=width, height=height)
        image = PathPass(self.scene, width, height).render(
            view, frame_index=0, seed=seed, spp=self.METER_SPP, max_depth=self.quality.max_depth
        )
        return float(np.round(meter(image.hdr), 3))


def quality_named(name: str, **overrides: Any) -> Quality:
    """The preset of that name with the given parts replaced (None keeps the preset's)."""
    if name not in QUALITIES:
        raise ArgumentError(f"quality={name!r}: must be one of {', '.join(QUALITIES)}")
    return replace(QUALITIES[name], **{part: value for part, value in overrides.items() if value is not None})
