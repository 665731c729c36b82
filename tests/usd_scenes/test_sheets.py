# SPDX-License-Identifier: Apache-2.0
"""Plates and shells: closed, of the given size, faces outward."""

from __future__ import annotations

import numpy as np
import pytest

from usd_scenes.author.polygon_mesh import PolygonMesh
from usd_scenes.author.shapes import circle, rectangle
from usd_scenes.author.sheets import plate, shell, unit_uv


def volume(mesh: PolygonMesh) -> float:
    """Return the volume enclosed by the triangle fans of all faces."""
    total, starts = 0.0, np.cumsum(mesh.counts) - mesh.counts
    for k in range(1, int(mesh.counts.max()) - 1):
        start = starts[mesh.counts > k + 1]
        a, b, c = (mesh.points[mesh.indices[start + corner]] for corner in (0, k, k + 1))
        total += float((np.cross(a, b) * c).sum()) / 6.0
    return total


@pytest.mark.parametrize(
    ("outline", "area"), [(rectangle(0.07, 0.15, 0.01, 6), 0.0104142), (circle(0.1, 64), np.pi * 0.01)]
)
def test_plate_has_volume_of_its_outline_minus_rounding(outline: np.ndarray, area: float) -> None:
    sharp, round_ = plate(outline, 0.01, 0.0), plate(outline, 0.01, 0.002)
    assert volume(sharp) == pytest.approx(0.01 * area, rel=5e-3)
    assert 0.9 * volume(sharp) < volume(round_) < volume(sharp)
    np.testing.assert_allclose(round_.bounds, sharp.bounds, atol=1e-6)
    np.testing.assert_allclose(sharp.bounds[:, 1], (0.0, 0.01))


def test_shell_has_given_thickness_and_round_rim() -> None:
    u, v = np.meshgrid(np.linspace(0.0, 1.0, 9), np.linspace(0.0, 0.5, 7))
    flat = np.stack([u, v, 0.0 * u], axis=-1)
    sheet = shell(flat, flat[..., :2], 0.02)
    np.testing.assert_allclose(sheet.bounds[:, 2], (-0.02, 0.0), atol=1e-9)
    rims = 2.0 * (1.0 + 0.5) * np.pi * 0.01**2 / 2.0
    assert volume(sheet) == pytest.approx(0.5 * 0.02 + rims, rel=0.01)


def test_unit_uv_covers_plate_from_corner_to_corner() -> None:
    mesh = unit_uv(plate(rectangle(0.2, 0.4, 0.001), 0.01), (-0.1, 0.2), (0.1, -0.2))
    np.testing.assert_allclose(mesh.uv.min(axis=0), 0.0, atol=1e-6)
    np.testing.assert_allclose(mesh.uv.max(axis=0), 1.0, atol=1e-6)
