# SPDX-License-Identifier: Apache-2.0
"""Properties of all BSDFs, over random materials: energy conservation and reciprocity."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.render.shading import Bsdf
from tiscene.scene.description import Material

COUNT = 4000


def random_material(seed: int) -> Material:
    """Return an opaque material without clearcoat, of random roughness and metalness, in either workflow."""
    random = np.random.default_rng(seed)
    color, specular = (tuple(float(c) for c in random.uniform(0.0, 1.0, 3)) for _ in range(2))
    return Material(
        f"material {seed}",
        diffuse_color=color,
        use_specular_workflow=bool(seed % 3 == 0),
        specular_color=specular,
        metallic=float(random.choice([0.0, 1.0, random.uniform()])),
        roughness=float(random.uniform(0.15, 1.0)),
        ior=float(random.uniform(1.1, 2.0)),
    )


def coated_material(seed: int) -> Material:
    """Return a random material with clearcoat."""
    random = np.random.default_rng((seed, 1))
    return replace(
        random_material(seed),
        clearcoat=float(random.uniform(0.2, 1.0)),
        clearcoat_roughness=float(random.uniform(0.15, 1.0)),
    )


def glass_material(seed: int) -> Material:
    """Return a random material with a fraction of 0.1 to 1 of rough glass."""
    random = np.random.default_rng((seed, 2))
    return replace(
        random_material(seed),
        metallic=0.0,
        use_specular_workflow=False,
        opacity=float(max(random.uniform(-0.5, 0.9), 0.0)),
    )


def directions(seed: int, count: int = COUNT) -> np.ndarray:
    """Return directions above the surface, not at grazing angles."""
    random = np.random.default_rng(seed)
    z, turn = random.uniform(0.1, 1.0, count), random.uniform(0.0, 2.0 * np.pi, count)
    level = np.sqrt(1.0 - z * z)
    return np.stack([level * np.cos(turn), level * np.sin(turn), z], axis=1).astype(np.float32)


@pytest.mark.parametrize("front", [True, False], ids=["outside", "inside"])
@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("make", [random_material, coated_material, glass_material])
def test_albedo_is_at_most_one(make: Callable[[int], Material], seed: int, front: bool) -> None:
    material = make(seed)
    bsdf = Bsdf(material, front=front)
    for outgoing in directions(seed, 4):
        numbers = np.random.default_rng(seed).random((COUNT, 3))
        incoming, values = bsdf.sample(np.repeat(outgoing[None], COUNT, axis=0), numbers)
        weight = np.divide(values[:, :3], values[:, 3:], out=np.zeros((COUNT, 3)), where=values[:, 3:] > 0.0)
        # Radiance scales by the squared ratio of indices across the boundary, which is neither loss nor gain.
        eta = material.ior if front else 1.0 / material.ior
        weight *= np.where(incoming[:, 2:] < 0.0, eta * eta, 1.0)
        error = weight.std(axis=0) / np.sqrt(COUNT)
        assert (weight.mean(axis=0) <= 1.0 + 4.0 * error + 4e-3).all(), (seed, outgoing)


def reflectance(material: Material, a: np.ndarray, b: np.ndarray, front: bool = True) -> np.ndarray:
    """Return f [n, 3] without the cosine. a: outgoing, above the surface."""
    value: np.ndarray = Bsdf(material, front=front).evaluate(a, b)[:, :3] / np.abs(b[:, 2:])
    return value


@pytest.mark.parametrize("seed", range(12))
def test_reflection_is_reciprocal(seed: int) -> None:
    material, a, b = random_material(seed), directions(2 * seed), directions(2 * seed + 1)
    np.testing.assert_allclose(reflectance(material, a, b), reflectance(material, b, a), rtol=2e-3, atol=1e-4)


@pytest.mark.parametrize("seed", range(12))
def test_coat_is_reciprocal_and_attenuates_by_outgoing_direction(seed: int) -> None:
    """The coat attenuates lower layers by the outgoing direction alone, which conserves energy but not reciprocity."""
    coated = coated_material(seed)
    bare = random_material(seed)
    coat = replace(coated, diffuse_color=(0.0, 0.0, 0.0), use_specular_workflow=True, specular_color=(0.0, 0.0, 0.0))
    a, b = directions(2 * seed), directions(2 * seed + 1)
    np.testing.assert_allclose(reflectance(coat, a, b), reflectance(coat, b, a), rtol=2e-3, atol=1e-5)
    a[:] = a[:1]
    below = reflectance(coated, a, b) - reflectance(coat, a, b)
    dimming = (below / np.maximum(reflectance(bare, a, b), 1e-4))[:, 1]
    assert 0.2 < np.median(dimming) < 1.0
    np.testing.assert_allclose(dimming, np.median(dimming), rtol=0.02)


@pytest.mark.parametrize("seed", range(12))
def test_glass_cycles_are_symmetric(seed: int) -> None:
    """For three directions, one inside, the product around the cycle is equal both ways (Kolmogorov's criterion).

    This holds if energy compensation is a factor of the outgoing direction alone.
    """
    glass = glass_material(seed)
    glass = replace(glass, opacity=0.0, roughness=0.5 + 0.5 * glass.roughness)
    a, b, inner = directions(3 * seed), directions(3 * seed + 1), directions(3 * seed + 2) * (1, 1, -1)

    def goes(to: np.ndarray, origin: np.ndarray) -> np.ndarray:
        inside = bool(to[0, 2] < 0.0)
        flip = np.array([1, 1, -1 if inside else 1], np.float32)
        return reflectance(glass, to * flip, origin * flip, front=not inside)[:, 1]

    one = goes(a, b) * goes(b, inner) * goes(inner, a)
    other = goes(b, a) * goes(inner, b) * goes(a, inner)
    some = one > 1e-6
    assert some.sum() > 15
    np.testing.assert_allclose(one[some], other[some], rtol=0.02)
    np.testing.assert_array_less(other[~some], 2e-6)
    # Radiance scales by the squared index, apart from the compensation.
    smoother = replace(glass, roughness=0.2)
    to, back = directions(seed)[:500], directions(seed + 99)[:500] * (1, 1, -1)
    into = reflectance(smoother, to, back)[:, 1]
    flip = np.array([1, 1, -1], np.float32)
    out = reflectance(smoother, back * flip, to * flip, front=False)[:, 1]
    lit = (into > 1e-3) & (to[:, 2] > 0.3) & (-back[:, 2] > 0.3)
    assert lit.sum() > 5
    np.testing.assert_allclose(out[lit] / into[lit], glass.ior**2, rtol=0.06)
