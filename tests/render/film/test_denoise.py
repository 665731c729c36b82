# SPDX-License-Identifier: Apache-2.0
"""Open Image Denoise: less noise, reproducible bytes, no output, clear errors."""

import subprocess
import sys

import numpy as np
import pytest

from tiscene.errors import ArgumentError
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
