# SPDX-License-Identifier: Apache-2.0
"""Polygonized implicit surfaces: exact position, closed, faces outward."""

from __future__ import annotations

import numpy as np
import pytest

from usd_scenes.author import implicit
from usd_scenes.author.polygon_mesh import PolygonMesh

BOX = [-0.12] * 3, [0.12] * 3


def volume(mesh: PolygonMesh) -> float:
    """Return the volume enclosed by the triangle fans of all faces."""
    quads = mesh.points[mesh.indices.reshape(-1, 4)]
    a, b, c, d = (quads[:, k] for k in range(4))
    return float((np.cross(a, b) * c).sum() + (np.cross(a, c) * d).sum()) / 6.0


def test_sphere_has_exact_radius_and_volume() -> None:
    ball = implicit.surface(implicit.ellipsoid((0.0, 0.0, 0.0), (0.1, 0.1, 0.1)), *BOX, 0.01)
    np.testing.assert_allclose(np.linalg.norm(ball.points, axis=1), 0.1, atol=1e-6)
    np.testing.assert_allclose(ball.normals, ball.points / 0.1, atol=1e-3)
    assert volume(ball) == pytest.approx(4.0 / 3.0 * np.pi * 0.1**3, rel=0.01)


def test_limb_has_given_length_and_radii() -> None:
    limb = implicit.surface(implicit.limb((0.0, -0.05, 0.0), (0.0, 0.05, 0.0), 0.04, 0.02), *BOX, 0.006)
    np.testing.assert_allclose(limb.bounds[:, 1], (-0.09, 0.07), atol=2e-3)
    np.testing.assert_allclose(limb.bounds[:, 0], (-0.04, 0.04), atol=2e-3)


def test_union_contains_both_and_fills_the_crease() -> None:
    balls = [implicit.ellipsoid((x, 0.0, 0.0), (0.05, 0.05, 0.05)) for x in (-0.04, 0.04)]
    crease = np.array([[0.0, 0.031, 0.0]])
    assert implicit.union(balls, 1e-6)(crease) > 0.0
    assert implicit.union(balls, 0.03)(crease) < 0.0
    apart = np.array([[-0.09, 0.0, 0.0], [0.09, 0.0, 0.0]])
    np.testing.assert_allclose(implicit.union(balls, 0.03)(apart), 0.0, atol=1e-9)


def test_box_uv_has_no_stretched_faces() -> None:
    ball = implicit.surface(implicit.ellipsoid((0.0, 0.0, 0.0), (0.1, 0.1, 0.1)), *BOX, 0.02)
    quads = ball.indices.reshape(-1, 4)
    spread = np.ptp(ball.uv[quads], axis=1).max()
    assert spread < 0.06
