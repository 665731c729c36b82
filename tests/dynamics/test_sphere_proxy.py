# SPDX-License-Identifier: Apache-2.0
"""Sphere proxies cover the surface, stay near it and are grouped."""

import numpy as np
import pytest

from dynamics.sphere_proxy import cover
from tests.dynamics.solids import box, quad


def surface_points(triangles, count=5000):
    random = np.random.default_rng(2)
    area = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    rows = random.choice(len(triangles), count, p=area / area.sum())
    weights = random.dirichlet((1.0, 1.0, 1.0), count)
    return (triangles[rows] * weights[:, :, None]).sum(axis=1)


SURFACES = {
    "cube": box((0.4, 0.4, 0.4)),
    "plate": box((1.0, 0.01, 1.0)),
    "rod": box((0.01, 1.5, 0.01)),
    "sheet": quad((0.1, 0.0, 0.0), (0.3, 0, 0), (0, 0.2, 0.1)),
    "crumb": box((0.002, 0.001, 0.001)),
    "two_boxes": np.concatenate([box((0.1, 0.1, 0.1)), box((0.1, 0.1, 0.1), (3.0, 0.0, 0.0))]),
}


@pytest.mark.parametrize("name", SURFACES)
@pytest.mark.parametrize("max_spheres", [24, 192])
def test_spheres_cover_every_surface_point(name, max_spheres):
    surface = SURFACES[name]
    shape = cover(surface, max_spheres)
    centers, radii = shape.spheres[:, :3].astype(float), shape.spheres[:, 3].astype(float)
    points = surface_points(surface)
    outside = np.linalg.norm(points[:, None] - centers, axis=2) - radii
    assert outside.min(axis=1).max() <= 0.0
    assert len(centers) <= max_spheres
    assert radii.min() > 0.0
    # Groups bound their spheres, and the reach bounds everything.
    assert shape.first[0] == 0
    assert shape.first[-1] == len(centers)
    for group, (first, last) in enumerate(zip(shape.first[:-1], shape.first[1:], strict=True)):
        assert last > first
        inside = np.linalg.norm(centers[first:last] - shape.groups[group, :3], axis=1) + radii[first:last]
        assert inside.max() <= shape.groups[group, 3] + 1e-6
    assert (np.linalg.norm(centers, axis=1) + radii).max() <= shape.reach + 1e-6


def test_more_spheres_are_smaller():
    coarse, fine = cover(SURFACES["cube"], 24), cover(SURFACES["cube"], 192)
    assert fine.spheres[:, 3].mean() < 0.6 * coarse.spheres[:, 3].mean()


def test_cover_is_deterministic():
    first, second = cover(SURFACES["cube"]), cover(SURFACES["cube"])
    assert first.spheres.tobytes() == second.spheres.tobytes()
    assert first.first.tobytes() == second.first.tobytes()


@pytest.mark.parametrize("corners", [np.zeros((0, 3, 3)), np.zeros((3, 3)), np.full((1, 3, 3), np.nan)])
def test_cover_rejects_missing_or_non_finite_triangles(corners):
    with pytest.raises(ValueError, match="corners"):
        cover(corners)


def protrusion(shape, surface):
    """Return how far spheres protrude from the box that they cover, meters, on average."""
    centers, radii = shape.spheres[:, :3].astype(float), shape.spheres[:, 3:].astype(float)
    low, high = surface.reshape(-1, 3).min(axis=0), surface.reshape(-1, 3).max(axis=0)
    return np.maximum(low - (centers - radii), centers + radii - high).max(axis=1).mean()


def test_spheres_of_closed_solids_protrude_less():
    solid = SURFACES["cube"]
    opened = solid[2:]
    assert protrusion(cover(solid), solid) < 0.8 * protrusion(cover(opened), solid)
    # A surface turned inside out encloses no volume.
    assert protrusion(cover(solid[:, ::-1]), solid) < 1.5 * protrusion(cover(opened), solid)
