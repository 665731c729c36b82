# SPDX-License-Identifier: Apache-2.0
"""Light that hidden parts of pixels should have: that of the surface beside them, not of all that is near."""

from __future__ import annotations

import numpy as np
import pytest

from tiscene.render.film.light_nearby import light_nearby
from tiscene.render.film.upsample import ALBEDO_OFFSET, demodulate

pytestmark = pytest.mark.usefixtures("taichi")

SIZE = 16, 24
DARK, BRIGHT = 0.1, 5.0
AT = 6 * SIZE[1] + 12  # the pixel of which some is hidden, beside the bright strip


def expected_at(shares: np.ndarray, normal: tuple[float, float, float] = (0.0, 0.0, 1.0)) -> float:
    """Return irradiance expected of a part of the pixel AT, left of which is a bright strip on the same plane.

    Args:
        shares: [h, w], known shares of pixels.
        normal: Of the part.
    """
    irradiance = np.where(np.arange(SIZE[1]) // 4 == 2, BRIGHT, DARK)
    light = np.ones((*SIZE, 3), np.float32) * irradiance[:, None].astype(np.float32)
    albedo = np.full((*SIZE, 3), 1.0 - ALBEDO_OFFSET, np.float32)
    normals = np.zeros((*SIZE, 3), np.float32)
    normals[..., 2] = 1.0
    reduced, _, reduced_normal = demodulate(light, albedo, normals, 4)
    share = shares[..., None].astype(np.float32)
    white, facing = np.full((1, 3), 0.5 - ALBEDO_OFFSET, np.float32), np.array([normal], np.float32)
    known = share * light, share, albedo, normals
    found = light_nearby(np.array([AT], np.int32), white, facing, known, reduced, reduced_normal, 4)
    assert found.shape == (1, 3)
    return float(found[0, 0]) / 0.5


def test_a_dark_surface_beside_a_bright_one_stays_dark() -> None:
    shares = np.ones(SIZE)
    shares.reshape(-1)[AT] = 0.75
    assert expected_at(shares) == pytest.approx(DARK + 0.1875 * (BRIGHT - DARK), abs=0.05)
    shares[:, :12] = 0.0  # what is not known has no light
    assert expected_at(shares) == pytest.approx(DARK, abs=0.05)


def test_without_known_parts_of_its_orientation_light_of_reduced_size_counts() -> None:
    unknown = expected_at(np.zeros(SIZE))
    assert 5.0 * DARK < unknown < BRIGHT
    assert expected_at(np.ones(SIZE), (0.0, 1.0, 0.0)) == pytest.approx(unknown, rel=0.02)
