# SPDX-License-Identifier: Apache-2.0
"""Fitting of primitives to meshes."""

from __future__ import annotations

import numpy as np
import pytest

from usd_scenes.author import primitives
from usd_scenes.author.polygon_mesh import PolygonMesh, merged
from usd_scenes.author.shapes import cylinder, lathe, rounded_box, sphere


@pytest.mark.parametrize(
    ("mesh", "kind", "size"),
    [
        (rounded_box((0.4, 0.2, 0.3), 0.004), "Cube", (0.4, 0.2, 0.3)),
        (sphere(0.2), "Sphere", (0.4, 0.4, 0.4)),
        (sphere(1.0).scaled(0.1, 0.3, 0.2), "Ellipsoid", (0.2, 0.6, 0.4)),
        (cylinder(0.1, 0.5), "Cylinder", (0.2, 0.5, 0.2)),
        (cylinder(0.1, 0.5).rotated("z", 90.0), "Cylinder", (0.2, 0.5, 0.2)),
        (lathe([[0.0, 0.0], [0.2, 0.0], [0.0, 0.5]], 48), "Cone", (0.4, 0.5, 0.4)),
    ],
)
def test_shape_is_fitted_by_its_own_kind(mesh: PolygonMesh, kind: str, size: tuple[float, float, float]) -> None:
    (gprim,) = primitives.fit(mesh.translated(1.0, 2.0, 3.0))
    assert gprim.kind == kind
    np.testing.assert_allclose(gprim.size, size, atol=2e-3)
    np.testing.assert_allclose(gprim.center, np.add(mesh.bounds.mean(axis=0), (1.0, 2.0, 3.0)), atol=2e-3)
    np.testing.assert_allclose(gprim.axes @ gprim.axes.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(gprim.axes) == pytest.approx(1.0)


def test_rotated_board_is_fitted_by_rotated_box() -> None:
    (gprim,) = primitives.fit(rounded_box((0.02, 1.0, 0.1), 0.002).rotated("z", 30.0))
    np.testing.assert_allclose(gprim.size, (0.02, 1.0, 0.1), atol=2e-3)
    lean = np.degrees(np.arccos(abs(gprim.axes[1, 1])))
    assert lean == pytest.approx(30.0, abs=0.5)


def test_each_piece_gets_a_gprim_unless_there_are_too_many() -> None:
    balls = [sphere(0.1, 12).translated(0.3 * i) for i in range(40)]
    few = primitives.fit(merged(balls[:5]))
    assert sorted(gprim.center[0] for gprim in few) == pytest.approx([0.0, 0.3, 0.6, 0.9, 1.2], abs=1e-3)
    (many,) = primitives.fit(merged(balls))
    assert max(many.size) == pytest.approx(39 * 0.3 + 0.2, abs=1e-2)
