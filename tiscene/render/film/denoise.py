# SPDX-License-Identifier: Apache-2.0
"""Intel Open Image Denoise, through pyoidn: loaded at the first use; one device, and filters for the last few sizes.

Its result has the same bytes for the same input on one machine; other processors may round otherwise.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import ArgumentError, DeviceError

FloatImage = NDArray[np.float32]
QUALITIES = ("fast", "balanced", "high")
MAX_KEPT = 48  # filters, each with its images


class _Denoiser:
    """A committed filter over images of one size that it owns."""

    def __init__(self, device: Any, height: int, width: int, quality: str, clean: bool) -> None:
        import pyoidn

        self.device = device
        self.color, self.albedo, self.normal, self.output = (np.zeros((height, width, 3), np.float32) for _ in range(4))
        self.filter = pyoidn.Filter(device, pyoidn.OIDN_FILTER_TYPE_RT)
        for name, image in (
            (pyoidn.OIDN_IMAGE_COLOR, self.color),
            (pyoidn.OIDN_IMAGE_ALBEDO, self.albedo),
            (pyoidn.OIDN_IMAGE_NORMAL, self.normal),
            (pyoidn.OIDN_IMAGE_OUTPUT, self.output),
        ):
            self.filter.set_image(name, image, pyoidn.OIDN_FORMAT_FLOAT3)
        self.filter.set_bool("hdr", True)
        self.filter.set_bool("cleanAux", clean)
        self.filter.set_int("quality", getattr(pyoidn, f"OIDN_QUALITY_{quality.upper()}"))
        self.filter.commit()
        _check(device)

    def __call__(self, hdr: FloatImage, albedo: FloatImage, normal: FloatImage) -> FloatImage:
        self.color[...], self.albedo[...], self.normal[...] = hdr, albedo, normal
        self.filter.execute()
        _check(self.device)
        return self.output.copy()


_device: Any = None
_denoisers: dict[tuple[int, int, str, bool], _Denoiser] = {}


def denoise(
    hdr: FloatImage, albedo: FloatImage, normal: FloatImage, quality: str = "high", *, clean: bool = True
) -> FloatImage:
    """The radiance without its noise, a new float32 [h, w, 3].

    albedo: 0..1; normal: world, unit or shorter; of what each pixel shows, as `PathImage` has them.
    quality: "fast", "balanced" or "high". clean: albedo and normal have no noise themselves (False under a wide lens).
    Raises ArgumentError for images of different shapes or another quality, DeviceError where the library fails.
    """
    if quality not in QUALITIES:
        raise ArgumentError(f"quality={quality!r}: must be one of {', '.join(QUALITIES)}")
    if hdr.ndim != 3 or hdr.shape[2] != 3 or not hdr.shape == albedo.shape == normal.shape:
        raise ArgumentError(f"images of shapes {hdr.shape}, {albedo.shape} and {normal.shape}: all must be (h, w, 3)")
    height, width, _ = hdr.shape
    key = (height, width, quality, clean)
    filter = _denoisers.pop(key, None) or _Denoiser(_the_device(), height, width, quality, clean)
    _denoisers[key] = filter
    if len(_denoisers) > MAX_KEPT:
        del _denoisers[next(iter(_denoisers))]  # not used for longest
    return filter(hdr, albedo, normal)


def _the_device() -> Any:
    global _device
    if _device is None:
        import pyoidn

        device = pyoidn.Device(pyoidn.OIDN_DEVICE_TYPE_CPU)
        device.set_bool("setAffinity", False)  # Taichi's threads share these processors: pinning would slow both
        device.commit()
        _check(device)
        _device = device
    return _device


def _check(device: Any) -> None:
    message = device.get_error()
    if message is not None:
        raise DeviceError(f"Open Image Denoise: {message}")
