# SPDX-License-Identifier: Apache-2.0
"""Intel Open Image Denoise, through pyoidn, which is imported at the first use.

One device, and a cache of filters by image size. The result is bitwise reproducible on one machine; other processors
may round differently.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import ArgumentError, DeviceError

FloatImage = NDArray[np.float32]
QUALITIES = ("fast", "balanced", "high")
MAX_FILTERS = 48  # in the cache, each with its images


class _Denoiser:
    """A committed OIDN filter and the images of one size that it reads and writes."""

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
    """Denoise radiance.

    Args:
        hdr: float32 [h, w, 3], radiance.
        albedo: float32 [h, w, 3], 0..1, as in `PathImage`.
        normal: float32 [h, w, 3], world space, of length 1 or less.
        quality: "fast", "balanced" or "high".
        clean: albedo and normal are noise-free (OIDN's cleanAux); False with depth of field.

    Returns:
        float32 [h, w, 3], a new array.

    Raises:
        ArgumentError: The shapes differ, or there is no such quality.
        DeviceError: The library failed.
    """
    if quality not in QUALITIES:
        raise ArgumentError(f"quality={quality!r}: must be one of {', '.join(QUALITIES)}")
    if hdr.ndim != 3 or hdr.shape[2] != 3 or not hdr.shape == albedo.shape == normal.shape:
        raise ArgumentError(f"images of shapes {hdr.shape}, {albedo.shape} and {normal.shape}: all must be (h, w, 3)")
    height, width, _ = hdr.shape
    key = (height, width, quality, clean)
    filter = _denoisers.pop(key, None) or _Denoiser(_oidn_device(), height, width, quality, clean)
    _denoisers[key] = filter
    if len(_denoisers) > MAX_FILTERS:
        del _denoisers[next(iter(_denoisers))]  # least recently used
    return filter(hdr, albedo, normal)


def _oidn_device() -> Any:
    global _device
    if _device is None:
        import pyoidn

        device = pyoidn.Device(pyoidn.OIDN_DEVICE_TYPE_CPU)
        device.set_bool("setAffinity", False)  # Taichi's threads share the cores: pinning would slow both
        device.commit()
        _check(device)
        _device = device
    return _device


def _check(device: Any) -> None:
    message = device.get_error()
    if message is not None:
        raise DeviceError(f"Open Image Denoise: {message}")
