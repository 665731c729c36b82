# SPDX-License-Identifier: Apache-2.0
"""One frame's buffers: the label pass, and where color is asked for, the path pass, the denoiser and the film."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import ArgumentError
from tiscene.frame.buffers import COLORS, times_needed
from tiscene.render.film.adaptive import render_to_error
from tiscene.render.film.postprocess import Postprocessor
from tiscene.render.film.tone_map import meter, tone_map
from tiscene.render.film.upsample import reduced
from tiscene.render.integrators.incremental.base_image import ProgressCallback
from tiscene.render.integrators.incremental.base_image_cache import BaseImageCache
from tiscene.render.integrators.incremental.incremental_pass import CACHE_BYTES, IncrementalPass
from tiscene.render.integrators.labels.label_pass import LabelPass
from tiscene.render.integrators.labels.surface_labels import FILTERED_ALBEDO
from tiscene.render.integrators.path.path_pass import PathImage, PathPass
from tiscene.render.sampling.pixel_filter import pixel_filter
from tiscene.render.view import View
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT, Placement
from tiscene.validation import integer, positive

MOST_DEPTH = 1024  # edges of a path that is kept have room each; there is no light left after so many
GUIDES = (FILTERED_ALBEDO, "normal")  # the labels that a picture traced in a smaller size is enlarged along


@dataclass(frozen=True)
class RenderSettings:
    """What a path-traced picture may cost.

    spp: paths per pixel.
    max_depth: edges of a path: 1 shows what emits light, 2 adds direct light, n adds n - 2 bounces; 1024 at most.
    denoise: run Intel Open Image Denoise over the radiance; False never touches a pixel.
    denoiser: how well, one of `denoise.QUALITIES`; "high" takes some four times as long as "fast".
    base_spp: paths per pixel of the base image of what stands still, where frames are differences to it. near_spp: how
    many more than `spp` go then through pixels in which something that moves is seen.
    error: paths go through each pixel until its standard error is estimated to be that part of its luminance, `spp` at
    most; None: always `spp`. clamp: the most that one path brings in a channel, W/m²/sr; None: all that it brings.
    pixel_filter: of `PIXEL_FILTERS`, that paths are spread by.
    downscale: light is traced in a picture so many times smaller each way, and brought to full size along the surfaces
    that the labels show; where frames are differences to a base, it is denoised in full size where much changes only.
    """

    spp: int = 16
    max_depth: int = 6
    denoise: bool = True
    denoiser: str = "balanced"
    base_spp: int = 256
    near_spp: int = 0
    downscale: int = 1
    error: float | None = None
    clamp: float | None = None
    pixel_filter: str = "box"

    def __post_init__(self) -> None:
        for name, least in (("spp", 1), ("max_depth", 1), ("base_spp", 1), ("near_spp", 0), ("downscale", 1)):
            most = MOST_DEPTH if name == "max_depth" else sys.maxsize
            object.__setattr__(self, name, integer(name, getattr(self, name), least, most))
        for name in ("error", "clamp"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, positive(name, getattr(self, name)))
        if self.error is not None and self.error >= 1.0:
            raise ArgumentError(f"error={self.error}: must lie between 0 and 1; 0.02 is 2 %")
        pixel_filter(self.pixel_filter)

    @property
    def of_differences(self) -> tuple[int, int]:
        """The parts that only frames which are differences depend on."""
        return self.base_spp, self.near_spp

    @property
    def allows_incremental(self) -> bool:
        """Whether paths can be kept: each counts for itself and for as much as any other."""
        return self.error is None and self.clamp is None and self.pixel_filter != "mitchell"


@dataclass(frozen=True, eq=False)
class ShutterSample:
    """What so many paths of each pixel see, while the shutter is open."""

    view: View
    placement: Placement
    spp: int


MOST_SPP = 1024  # where an error is asked for, but no number

QUALITIES = {
    "fast": RenderSettings(spp=1, max_depth=4, denoiser="fast", base_spp=64, near_spp=4, downscale=2),
    "preview": RenderSettings(spp=4, max_depth=4, denoiser="fast", base_spp=64),
    "standard": RenderSettings(spp=16, max_depth=6),
    "photo": RenderSettings(spp=256, max_depth=12, denoiser="high", base_spp=1024),
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
        quality: RenderSettings,
        *,
        cache_bytes: int = CACHE_BYTES,
        progress: ProgressCallback | None = None,
    ) -> None:
        """cache_bytes: what kept paths may take of memory. progress: is told what is being made, and how much is done."""
        self.scene = scene
        self.width = width
        self.height = height
        self.quality = quality
        self._labels = LabelPass(scene)
        self.spp = 0.0
        options: dict[str, Any] = {"pixel_filter": quality.pixel_filter, "clamp": quality.clamp}
        self._paths = PathPass(scene, *reduced(width, height, quality.downscale), **options)
        self._replay_paths = self._paths if quality.downscale == 1 else PathPass(scene, width, height, **options)
        self._replay = IncrementalPass(
            scene, width, height,
            memory_limit=cache_bytes, images=BaseImageCache(), progress=progress, paths=self._replay_paths,
        )  # fmt: skip

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
        moments: Iterable[ShutterSample] = (),
    ) -> dict[str, NDArray[Any]]:
        """The buffers named, in that order, each a new array. exposure: stops, for `rgb`.

        moments: what color is the mean of, where a shutter is open: traced in full size, and no difference.
        moving: bool [n], the instances that move before a camera and under lights that do not: color is then a
        difference to an image of the others, if that pays. None: color is traced from nothing.
        """
        self._paths.background = self._replay_paths.background = view.background
        quality = self.quality
        colored = not COLORS.isdisjoint(buffers)
        labels = [name for name in buffers if name not in COLORS]
        sampling: dict[str, int] = {"seed": seed, "max_depth": quality.max_depth}
        if colored and moving is not None and not self._replay.pays(view, placement, moving, **sampling):
            moving = None
        if colored and moving is not None:
            self._replay.prepare(
                view, placement, moving,
                spp=quality.spp, base_spp=max(quality.base_spp, quality.spp), near_spp=quality.near_spp, **sampling,
            )  # fmt: skip
        elif colored and quality.downscale > 1:
            labels += [name for name in GUIDES if name not in labels]
        self.scene.place(placement, times=times_needed([*buffers, *labels]))
        result = self._labels.render(view, labels)
        if colored:
            blurred = self._blurred(moments, frame_index, seed)
            result |= self._color(view, frame_index, seed, exposure, buffers, moving, result, blurred)
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
        blurred: PathImage | None,
    ) -> dict[str, NDArray[Any]]:
        quality, sharp = self.quality, view.current.lens_radius == 0.0 and blurred is None
        downscale = 1 if blurred else quality.downscale
        cleaner = Postprocessor(quality.denoiser if quality.denoise else None, downscale, sharp)
        raw = replace(cleaner, denoiser=None)
        result: dict[str, NDArray[Any]] = {}
        cleaned = "rgb" in buffers or "denoised" in buffers
        if moving is not None:
            difference = self._replay.render(moving)
            self.spp = float(quality.spp)
            result["hdr"] = difference.hdr
            guides = difference.albedo, difference.normal
            if cleaned:
                radiance = cleaner.difference(difference)
        else:
            if downscale > 1:
                view = replace(view, width=self._paths.width, height=self._paths.height)
            image = blurred or self._trace(view, frame_index, seed)
            guides = (image.albedo, image.normal) if downscale == 1 else (labels[GUIDES[0]], labels[GUIDES[1]])
            if "hdr" in buffers:
                result["hdr"] = raw.traced(image, *guides)
            if cleaned:
                radiance = cleaner.traced(image, *guides)
        if "denoised" in buffers:
            result["denoised"] = radiance
        if "rgb" in buffers:
            if any(view.ambient):
                albedo, normal = guides
                surface = normal.any(axis=-1, keepdims=True)
                radiance = radiance + np.where(surface, albedo, 0.0) * np.array(view.ambient, np.float32)
            result["rgb"] = tone_map(radiance, exposure)
        return result

    def _blurred(self, moments: Iterable[ShutterSample], frame_index: int, seed: int) -> PathImage | None:
        """The mean over the moments; None without any."""
        quality, image, first = self.quality, None, 0
        for moment in moments:
            if quality.error is not None:
                raise ArgumentError(
                    f"error={quality.error}: not while the camera's shutter is open; ask for spp= in its place, or "
                    "close it with shutter=(0, 0)"
                )
            self.scene.place(moment.placement)
            image = self._replay_paths.render(
                moment.view, frame_index=frame_index, seed=seed, spp=quality.spp, max_depth=quality.max_depth,
                part=(first, moment.spp),
            )  # fmt: skip
            first += moment.spp
            self.spp = float(first)
        return image

    def _trace(self, view: View, frame_index: int, seed: int) -> PathImage:
        quality = self.quality
        if quality.error is None:
            self.spp = float(quality.spp)
            return self._paths.render(
                view, frame_index=frame_index, seed=seed, spp=quality.spp, max_depth=quality.max_depth
            )
        image = render_to_error(
            self._paths, view,
            frame_index=frame_index, seed=seed, error=quality.error, most=quality.spp, max_depth=quality.max_depth,
        )  # fmt: skip
        self.spp = float(image.samples.mean())
        return image

    def meter(self, view: View, placement: Placement, *, seed: int) -> float:
        """The exposure in stops that shows this placement well, from a small picture of it."""
        width, height = self.METER_SIZE
        self.scene.place(placement, times=(CURRENT,))
        view = View(*view.cameras, width=width, height=height)
        image = PathPass(self.scene, width, height).render(
            view, frame_index=0, seed=seed, spp=self.METER_SPP, max_depth=self.quality.max_depth
        )
        return float(np.round(meter(image.hdr), 3))


def quality_named(name: str, **overrides: Any) -> RenderSettings:
    """The preset of that name with the given parts replaced (None keeps the preset's).

    With an error, spp is the most, and MOST_SPP if it is not among the parts.
    """
    if not isinstance(name, str) or name not in QUALITIES:
        raise ArgumentError(f"quality={name!r}: must be one of {', '.join(QUALITIES)}")
    if overrides.get("error") is not None and overrides.get("spp") is None:
        overrides["spp"] = MOST_SPP
    return replace(QUALITIES[name], **{part: value for part, value in overrides.items() if value is not None})
