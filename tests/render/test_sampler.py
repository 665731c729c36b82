"""Scrambled Sobol points: their net property, independence of the keys, and what they are worth."""

import numpy as np
import pytest
import taichi as ti
from scipy import stats

from tiscene.render import sampler

Rows = ti.types.ndarray(dtype=ti.f32, ndim=2)


@ti.kernel
def draw(key: ti.u32, bits: ti.i32, points: Rows):
    for i in range(points.shape[0]):
        p = sampler.sobol(key, i, bits)
        for c in ti.static(range(4)):
            points[i, c] = p[c]


@ti.kernel
def draw_first(index: ti.i32, bits: ti.i32, dimension_set: ti.u32, points: Rows):
    for pixel in range(points.shape[0]):
        p = sampler.sobol(sampler.combine(sampler.pixel_key(77, pixel), dimension_set), index, bits)
        for c in ti.static(range(4)):
            points[pixel, c] = p[c]


@ti.kernel
def lone(points: Rows):
    for i in range(points.shape[0]):
        points[i, 0] = sampler.uniform(ti.cast(i, ti.u32))


def points(key: int, count: int, bits: int | None = None) -> np.ndarray:
    result = np.empty((count, 4), np.float32)
    draw(key, sampler.index_bits(count) if bits is None else bits, result)
    return result


@pytest.mark.parametrize("key", [0, 1, 0xDEADBEEF])
def test_each_dimension_is_stratified(key: int) -> None:
    drawn = points(key, 256)
    assert drawn.min() >= 0.0
    assert drawn.max() < 1.0
    for column in drawn.T:
        assert sorted((column * 256).astype(int)) == list(range(256))


@pytest.mark.parametrize("key", [3, 0xBADC0DE])
def test_the_first_two_dimensions_are_a_net_in_base_2(key: int) -> None:
    drawn = points(key, 64)
    for level in range(7):
        wide, tall = 1 << level, 1 << (6 - level)
        boxes = (drawn[:, 0] * wide).astype(int) * tall + (drawn[:, 1] * tall).astype(int)
        assert sorted(boxes) == list(range(64))


def test_fewer_samples_than_a_power_of_two_are_still_spread() -> None:
    drawn = points(5, 48, bits=6)
    assert np.unique((drawn[:, 0] * 64).astype(int)).size == 48
    counts = np.histogram(drawn[:, 0], bins=4, range=(0, 1))[0]
    assert counts.min() >= 8


def test_every_point_of_every_key_is_uniform() -> None:
    """Over pixels, any one sample is uniform, and its dimensions and those of other sets are independent."""
    first, second = np.empty((20000, 4), np.float32), np.empty((20000, 4), np.float32)
    for index in (0, 5):
        draw_first(index, 4, 1, first)
        draw_first(index, 4, 2, second)
        columns = np.concatenate([first, second], axis=1).T
        for column in columns:
            assert stats.kstest(column, "uniform").pvalue > 1e-4
        for a in range(8):
            for b in range(a):
                counts = np.histogram2d(columns[a], columns[b], bins=8, range=((0, 1), (0, 1)))[0]
                assert stats.chisquare(counts.ravel()).pvalue > 1e-5


def test_it_beats_independent_numbers() -> None:
    """The mean of a smooth function of four numbers from 64 of them: its squared error, over many keys."""

    def integrand(at: np.ndarray) -> np.ndarray:
        return np.exp(-((at - 0.3) ** 2).sum(axis=-1)) * (1.0 + at[..., 0] * at[..., 1])

    estimates = [integrand(points(key, 64)).mean() for key in range(300)]
    independent = integrand(np.random.default_rng(0).random((300, 64, 4))).mean(axis=1)
    assert np.mean(estimates) == pytest.approx(independent.mean(), rel=0.01)
    assert np.var(estimates) < 0.05 * np.var(independent)


def test_lone_numbers_are_uniform() -> None:
    drawn = np.empty((20000, 1), np.float32)
    lone(drawn)
    assert stats.kstest(drawn[:, 0], "uniform").pvalue > 1e-4


def test_frame_keys_differ() -> None:
    keys = {sampler.frame_key(seed, frame) for seed in range(50) for frame in range(50)}
    assert len(keys) == 2500
    assert all(-(1 << 31) <= key < 1 << 31 for key in keys)
    assert sampler.frame_key(1 << 80, 3) == sampler.frame_key(1 << 80, 3)


@pytest.mark.parametrize(("spp", "bits"), [(1, 0), (2, 1), (3, 2), (16, 4), (17, 5)])
def test_index_bits(spp: int, bits: int) -> None:
    assert sampler.index_bits(spp) == bits
