# SPDX-License-Identifier: Apache-2.0
"""Proxy spheres: they cover the surface, stay near it and are grouped."""

import numpy as np
import pytest

from dynamics.sphere_proxy import cover
from tests.dynamics.solids import box, quad


def on_surface(triangles, count=5000):
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
    "apart": np.concatenate([box((0.1, 0.1, 0.1)), box((0.1, 0.1, 0.1), (3.0, 0.0, 0.0))]),
}


@pytest.mark.parametrize("name", SURFACES)
@pytest.mark.parametrize("most", [24, 192])
def test_every_point_of_the_surface_is_in_a_sphere(name, most):
    surface = SURFACES[name]
    shape = cover(surface, most)
    centers, radii = shape.spheres[:, :3].astype(float), shape.spheres[:, 3].astype(float)
    points = on_surface(surface)
    outside = np.linalg.norm(points[:, None] - centers, axis=2) - radii
    assert outside.min(axis=1).max() <= 0.0
    assert len(centers) <= most
    assert radii.min() > 0.0
    # Groups bound their spheres, and the reach bounds everything.
    assert shape.first[0] == 0
    assert shape.first[-1] == len(centers)
    for group, (first, last) in enumerate(zip(shape.first[:-1], shape.first[1:], strict=True)):
        assert last > first
        inside = np.linalg.norm(centers[first:last] - shape.groups[group, :3], axis=1) + radii[first:last]
        assert inside.max() <= shape.groups[group, 3] + 1e-6
    assert (np.linalg.norm(centers, axis=1) + radii).max() <= shape.reach + 1e-6


def test_more_spheres_stay_nearer_to_the_surface():
    coarse, fine = cover(SURFACES["cube"], 24), cover(SURFACES["cube"], 192)
    assert fine.spheres[:, 3].mean() < 0.6 * coarse.spheres[:, 3].mean()


def test_it_is_always_the_same():
    first, second = cover(SURFACES["cube"]), cover(SURFACES["cube"])
    assert first.spheres.tobytes() == second.spheres.tobytes()
    assert first.first.tobytes() == second.first.tobytes()


@pytest.mark.parametrize("corners", [np.zeros((0, 3, 3)), np.zeros((3, 3)), np.full((1, 3, 3), np.nan)])
def test_what_has_no_surface_is_refused(corners):
    with pytest.raises(ValueError, match="corners"):
        cover(corners)


def hover(shape, surface):
    """How far spheres stand out beyond the box that they cover, m, on average."""
    centers, radii = shape.spheres[:, :3].astype(float), shape.spheres[:, 3:].astype(float)
    low, high = surface.reshape(-1, 3).min(axis=0), surface.reshape(-1, 3).max(axis=0)
    return np.maximum(low - (centers - radii), centers + radii - high).max(axis=1).mean()


def test_in_solids_larger_spheres_stand_out_less():
    solid = SURFACES["cube"]
    opened = solid[2:]
    assert hover(cover(solid), solid) < 0.8 * hover(cover(opened), solid)
    # What is turned inside out encloses nothing.
    assert hover(cover(solid[:, ::-1]), solid) < 1.5 * hover(cover(opened), solid)
