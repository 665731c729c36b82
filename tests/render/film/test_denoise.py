# SPDX-License-Identifier: Apache-2.0
"""Open Image Denoise: less noise, reproducible bytes, no output, clear errors."""

import gc
import subprocess
import sys

import numpy as np
import pytest

from dynamics.lru_cache import LRUCache
from tiscene.errors import ArgumentError
from tiscene.render.film import denoise as module
from tiscene.render.film.denoise import QUALITIES, denoise


def noisy() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return (clean, noisy, albedo, normal) of stripes under uniform light."""
    albedo = np.zeros((48, 64, 3), np.float32)
    albedo[:, ::8], albedo[:, 1::8] = 0.8, 0.8
    albedo += 0.1
    clean = albedo * np.linspace(0.5, 2.0, 48, dtype=np.float32)[:, None, None]
    noise = np.random.default_rng(0).gamma(2.0, 0.5, clean.shape[:2]).astype(np.float32)[..., None]
    normal = np.zeros_like(clean)
    normal[..., 1] = 1.0
    return clean, clean * noise, albedo, normal


@pytest.mark.parametrize("quality", QUALITIES)
def test_denoising_removes_noise_reproducibly(quality: str) -> None:
    clean, image, albedo, normal = noisy()
    given = image.copy()
    result = denoise(image, albedo, normal, quality)
    assert result.dtype == np.float32
    assert np.mean((result - clean) ** 2) < 0.05 * np.mean((image - clean) ** 2)
    again = denoise(image, albedo, normal, quality)
    assert again is not result
    assert (again == result).all()
    assert (image == given).all()


def test_other_sizes_in_between_do_not_change_result() -> None:
    _, image, albedo, normal = noisy()
    first = denoise(image, albedo, normal)
    denoise(image[:32, :32], albedo[:32, :32], normal[:32, :32])
    assert (denoise(image, albedo, normal) == first).all()


@pytest.mark.parametrize("clean", [True, False])
def test_images_in_device_memory_give_the_same_bytes(clean: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """On the CPU's device, whose buffers are used as a card's."""
    _, image, albedo, normal = noisy()
    expected = denoise(image, albedo, normal, clean=clean)
    device, _ = module._oidn_device()
    monkeypatch.setattr(module, "_denoisers", LRUCache(1))
    monkeypatch.setattr(module, "_device", (device, module._DeviceImage))
    assert module.denoiser_device() == "cuda"
    for _ in range(2):
        np.testing.assert_array_equal(denoise(image, albedo, normal, clean=clean), expected)
    mirrored = [each[:, ::-1] for each in (image, albedo, normal)]  # not contiguous
    assert denoise(*mirrored, clean=clean).shape == (48, 64, 3)


def test_cpu_denoises_where_the_library_finds_no_card(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_device", None)
    monkeypatch.setattr(module.runtime, "running", lambda: "cuda")
    assert module.denoiser_device() == "cpu"


def test_filters_that_are_dropped_are_released(monkeypatch: pytest.MonkeyPatch) -> None:
    import pyoidn

    released = []
    release = pyoidn.Filter.release
    monkeypatch.setattr(pyoidn.Filter, "release", lambda self: released.append(self) or release(self))
    monkeypatch.setattr(module, "_denoisers", LRUCache(2))
    _, image, albedo, normal = noisy()
    for height in (16, 17, 18, 19):
        denoise(image[:height], albedo[:height], normal[:height])
    gc.collect()
    assert len(released) == 2


def test_denoising_prints_nothing() -> None:
    code = (
        "import numpy as np; from tiscene.render.film.denoise import denoise; "
        "z = np.ones((16, 16, 3), np.float32); denoise(z, z, z)"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout == result.stderr == ""


def test_wrong_arguments_raise() -> None:
    _, image, albedo, normal = noisy()
    with pytest.raises(ArgumentError, match="'best'"):
        denoise(image, albedo, normal, "best")
    with pytest.raises(ArgumentError, match="shapes"):
        denoise(image, albedo[:-1], normal)


@pytest.mark.parametrize(("height", "width"), [(1, 1), (1, 64), (64, 2), (9, 12)])
def test_small_images_keep_their_mean(height: int, width: int) -> None:
    random = np.random.default_rng(0)
    hdr = random.uniform(0.9, 1.1, (height, width, 3)).astype(np.float32)
    flat = np.full_like(hdr, 0.5)
    assert denoise(hdr, flat, flat).mean() == pytest.approx(hdr.mean(), rel=0.1)
