# SPDX-License-Identifier: Apache-2.0
"""RenderSettings: what the path tracer may cost, and the presets."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from typing import Any

from dynamics.argument_checks import flag, integer, optional, positive, set_checked
from tiscene.errors import ArgumentError
from tiscene.render.sampling.pixel_filter import pixel_filter

MAX_DEPTH = 1024  # kept paths have room for each segment; no light is left at this depth
DEFAULT_MAX_SPP = 1024  # with a relative error, but no spp


@dataclass(frozen=True)
class RenderSettings:
    """What the path tracer may cost.

    Attributes:
        spp: samples per pixel; with `relative_error` their maximum.
        max_depth: maximum path depth in segments: 1 shows emission, 2 adds direct light, n adds n - 2 bounces; at most
            1024.
        denoise: whether radiance is denoised by Intel Open Image Denoise.
        denoiser: its quality, one of `denoise.QUALITIES`; "high" takes about four times as long as "fast".
        incremental: whether frames share light where the camera stands still; with `panorama_spp`, also where it moves.
        base_spp: samples per pixel of the base image of the static scene, in incremental rendering.
        near_spp: samples per pixel added to `spp` where movers are visible, in incremental rendering.
        panorama_spp: samples per pixel of the panoramas that frames of a camera that turns or walks show, about,
            where light varies, and half as many elsewhere, in incremental rendering; 0: such frames are path traced.
        downscale: light is traced in an image smaller by this factor along each axis, and upsampled along the surfaces
            that the labels show. Incremental rendering denoises at full size where much changes only.
        relative_error: sample each pixel until the standard error of its luminance is estimated to be at most this
            fraction; None: always `spp` samples.
        clamp: maximum radiance per sample and channel, W/m²/sr; None: no maximum.
        pixel_filter: one of `PIXEL_FILTERS`.
    """

    spp: int = 16
    max_depth: int = 6
    denoise: bool = True
    denoiser: str = "balanced"
    incremental: bool = False
    base_spp: int = 256
    near_spp: int = 0
    panorama_spp: int = 0
    downscale: int = 1
    relative_error: float | None = None
    clamp: float | None = None
    pixel_filter: str = "box"

    def __post_init__(self) -> None:
        for name in ("spp", "max_depth", "base_spp", "near_spp", "panorama_spp", "downscale"):
            least = 0 if name in ("near_spp", "panorama_spp") else 1
            most = MAX_DEPTH if name == "max_depth" else sys.maxsize
            object.__setattr__(self, name, integer(getattr(self, name), name, least, most))
        set_checked(self, relative_error=optional(positive), clamp=optional(positive))
        set_checked(self, denoise=flag, incremental=flag)
        if self.relative_error is not None and self.relative_error >= 1.0:
            raise ArgumentError(f"relative_error={self.relative_error}: must lie between 0 and 1; 0.02 is 2 %")
        pixel_filter(self.pixel_filter)
        if self.incremental and not self.allows_incremental:
            raise ArgumentError(
                "incremental=True: not with relative_error=, clamp= or pixel_filter='mitchell'; leave one of both out"
            )

    @property
    def allows_incremental(self) -> bool:
        """Whether paths can be kept: each must count for itself, and as much as any other."""
        return self.relative_error is None and self.clamp is None and self.pixel_filter != "mitchell"

    def to_json(self, cache_bytes: int) -> dict[str, Any]:
        """Return the settings that pixels depend on, as JSON values.

        Args:
            cache_bytes: memory limit of kept paths, on which incremental rendering depends.
        """
        incremental = [self.base_spp, self.near_spp, cache_bytes, self.panorama_spp]
        return {
            "spp": self.spp,
            "max_depth": self.max_depth,
            "relative_error": self.relative_error,
            "clamp": self.clamp,
            "pixel_filter": self.pixel_filter,
            "downscale": self.downscale,
            "denoiser": self.denoiser if self.denoise else None,
            "incremental": incremental if self.incremental else None,
        }


PRESETS = {
    "fast": RenderSettings(
        spp=1, max_depth=8, denoiser="fast", incremental=True, base_spp=64, near_spp=4, panorama_spp=64, downscale=2
    ),
    "preview": RenderSettings(spp=4, max_depth=8, denoiser="fast", incremental=True, base_spp=64, panorama_spp=128),
    "standard": RenderSettings(spp=16, max_depth=8),
    "photo": RenderSettings(spp=256, max_depth=12, denoiser="high", base_spp=1024),
}


def preset(name: str, **overrides: Any) -> RenderSettings:
    """Return a preset with some of its parts replaced.

    Args:
        name: of the preset, a key of `PRESETS`.
        **overrides: attributes of RenderSettings; None keeps the preset's. With `relative_error`, `spp` is the maximum,
            DEFAULT_MAX_SPP by default. A preset that is incremental is not where the overrides do not allow it.

    Raises:
        ArgumentError: an unknown preset or an invalid value.
    """
    if not isinstance(name, str) or name not in PRESETS:
        raise ArgumentError(f"quality={name!r}: must be one of {', '.join(PRESETS)}")
    parts = {part: value for part, value in overrides.items() if value is not None}
    if "relative_error" in parts:
        parts.setdefault("spp", DEFAULT_MAX_SPP)
    if parts.get("incremental") is None:
        plain = replace(PRESETS[name], **parts | {"incremental": False})
        parts["incremental"] = PRESETS[name].incremental and plain.allows_incremental
    return replace(PRESETS[name], **parts)
