# SPDX-License-Identifier: Apache-2.0
"""Intel Open Image Denoise, through pyoidn, which is imported at the first use.

One device, and a cache of filters by image size. The result is bitwise reproducible on one machine; other processors
may round differently.

Where Taichi runs on CUDA, so does the denoiser, if the library finds the card: its images are then in buffers in the
card's memory, which are written and read once a frame. They belong to the library: memory of Taichi may be in another
CUDA context.
"""

from __future__ import annotations

import weakref
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynamics.lru_cache import LRUCache
from tiscene.device import runtime
from tiscene.errors import ArgumentError, DeviceError

FloatImage = NDArray[np.float32]
QUALITIES = ("fast", "balanced", "high")
MIN_SIDE = 16  # px; the library darkens smaller images, so they are continued beyond their last row and column
MAX_FILTERS = 48  # in the cache, each with its images


class _HostImage:
    """An image in memory of the host that a filter reads or writes in place."""

    def __init__(self, device: Any, height: int, width: int) -> None:
        self.shared = self.values = np.zeros((height, width, 3), np.float32)

    def write(self, values: FloatImage) -> None:
        self.values[...] = values

    def read(self) -> FloatImage:
        return self.values.copy()


class _DeviceImage:
    """An image in a buffer in the device's memory."""

    def __init__(self, device: Any, height: int, width: int) -> None:
        import pyoidn

        self._shape = height, width, 3
        self._size = 4 * height * width * 3
        self.shared = pyoidn.Buffer(device, self._size, pyoidn.OIDN_STORAGE_DEVICE)
        _check(device)
        weakref.finalize(self, self.shared.release).atexit = False

    def write(self, values: FloatImage) -> None:
        self.shared.write(0, self._size, np.ascontiguousarray(values, np.float32))

    def read(self) -> FloatImage:
        values = np.empty(self._shape, np.float32)
        self.shared.read(0, self._size, values)
        return values


class _Denoiser:
    """A committed OIDN filter and the images of one size that it reads and writes."""

    def __init__(
        self, device: Any, image: type[_HostImage | _DeviceImage], height: int, width: int, quality: str, clean: bool
    ) -> None:
        import pyoidn

        self.device = device
        self.color, self.albedo, self.normal, self.output = (image(device, height, width) for _ in range(4))
        self.filter = pyoidn.Filter(device, pyoidn.OIDN_FILTER_TYPE_RT)
        weakref.finalize(self, self.filter.release).atexit = False
        for name, each in (
            (pyoidn.OIDN_IMAGE_COLOR, self.color),
            (pyoidn.OIDN_IMAGE_ALBEDO, self.albedo),
            (pyoidn.OIDN_IMAGE_NORMAL, self.normal),
            (pyoidn.OIDN_IMAGE_OUTPUT, self.output),
        ):
            self.filter.set_image(name, each.shared, pyoidn.OIDN_FORMAT_FLOAT3, width, height)
        self.filter.set_bool("hdr", True)
        self.filter.set_bool("cleanAux", clean)
        self.filter.set_int("quality", getattr(pyoidn, f"OIDN_QUALITY_{quality.upper()}"))
        self.filter.commit()
        _check(device)

    def __call__(self, hdr: FloatImage, albedo: FloatImage, normal: FloatImage) -> FloatImage:
        for image, values in ((self.color, hdr), (self.albedo, albedo), (self.normal, normal)):
            image.write(values)
        self.filter.execute()
        result = self.output.read()
        _check(self.device)
        return result


_device: tuple[Any, type[_HostImage | _DeviceImage]] | None = None  # and where its images are
_denoisers: LRUCache[tuple[int, int, str, bool], _Denoiser] = LRUCache(MAX_FILTERS)


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
    if min(height, width) < MIN_SIDE:
        rows, columns = (np.minimum(np.arange(max(side, MIN_SIDE)), side - 1) for side in (height, width))
        larger = [each[rows[:, None], columns] for each in (hdr, albedo, normal)]
        return denoise(larger[0], larger[1], larger[2], quality, clean=clean)[:height, :width].copy()
    key = (height, width, quality, clean)
    return _denoisers.get(key, lambda: _Denoiser(*_oidn_device(), height, width, quality, clean))(hdr, albedo, normal)


def denoiser_device() -> str:
    """Return where images are denoised: "cpu" or "cuda"."""
    return "cuda" if _oidn_device()[1] is _DeviceImage else "cpu"


def _oidn_device() -> tuple[Any, type[_HostImage | _DeviceImage]]:
    global _device
    if _device is None:
        import pyoidn

        image: type[_HostImage | _DeviceImage]
        if runtime.running() == "cuda" and pyoidn.Device.is_cuda_available():
            device, image = pyoidn.Device(pyoidn.OIDN_DEVICE_TYPE_CUDA), _DeviceImage
        else:
            device, image = pyoidn.Device(pyoidn.OIDN_DEVICE_TYPE_CPU), _HostImage
            device.set_bool("setAffinity", False)  # Taichi's threads share the cores: pinning would slow both
        device.commit()
        _check(device)
        _device = device, image
    return _device


def _check(device: Any) -> None:
    message = device.get_error()
    if message is not None:
        raise DeviceError(f"Open Image Denoise: {message}")
