"""What holds for every material: it reflects no more than it gets, and light takes either way alike."""

import numpy as np
import pytest

from tests.render.shading import Bsdf
from tiscene.scene.description import Material

COUNT = 4000


def random_material(seed: int) -> Material:
    """Opaque and without a coat, of any roughness, metal or not, in either workflow."""
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


def directions(seed: int, count: int = COUNT) -> np.ndarray:
    """Above the surface, not at grazing angles."""
    random = np.random.default_rng(seed)
    z, turn = random.uniform(0.1, 1.0, count), random.uniform(0.0, 2.0 * np.pi, count)
    level = np.sqrt(1.0 - z * z)
    return np.stack([level * np.cos(turn), level * np.sin(turn), z], axis=1).astype(np.float32)


@pytest.mark.parametrize("seed", range(12))
def test_no_more_comes_out_than_goes_in(seed: int) -> None:
    bsdf = Bsdf(random_material(seed))
    for outgoing in directions(seed, 4):
        numbers = np.random.default_rng(seed).random((COUNT, 3))
        _, values = bsdf.sample(np.repeat(outgoing[None], COUNT, axis=0), numbers)
        weight = np.divide(values[:, :3], values[:, 3:], out=np.zeros((COUNT, 3)), where=values[:, 3:] > 0.0)
        error = weight.std(axis=0) / np.sqrt(COUNT)
        assert (weight.mean(axis=0) <= 1.0 + 4.0 * error + 2e-3).all(), (seed, outgoing)


@pytest.mark.parametrize("seed", range(12))
def test_light_takes_either_way_alike(seed: int) -> None:
    bsdf = Bsdf(random_material(seed))
    a, b = directions(2 * seed), directions(2 * seed + 1)
    there = bsdf.evaluate(a, b)[:, :3] / b[:, 2:]
    back = bsdf.evaluate(b, a)[:, :3] / a[:, 2:]
    np.testing.assert_allclose(there, back, rtol=2e-3, atol=1e-4)
