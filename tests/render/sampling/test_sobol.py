# SPDX-License-Identifier: Apache-2.0
"""Scrambled Sobol points: net property per pixel and over neighborhoods, independence of sets and frames."""

import numpy as np
import pytest
import taichi as ti
from scipy import stats

from tiscene.device.kernel_types import Floats2, Ints1
from tiscene.device.memory import upload
from tiscene.render.sampling import sobol


@ti.kernel
def draw(frame_key: ti.i32, number: ti.i32, bits: ti.i32, positions: Ints1, points: Floats2):
    """Write all points of each pixel."""
    each = points.shape[0] // positions.shape[0]
    keys = sobol.set_keys(frame_key, number)
    for i in range(points.shape[0]):
        place = ti.cast(positions[i // each], ti.u32)
        p = sobol.draw(keys, sobol.reverse_bits((place << bits) + ti.cast(i % each, ti.u32)))
        points[i, 0] = p.x
        points[i, 1] = p.y


@ti.kernel
def draw_of_frames(number: ti.i32, index: ti.u32, points: Floats2):
    for frame in range(points.shape[0]):
        p = sobol.draw(sobol.set_keys(ti.cast(sobol.mix(ti.cast(frame, ti.u32)), ti.i32), number), index)
        points[frame, 0] = p.x
        points[frame, 1] = p.y


@ti.kernel
def unstratified(points: Floats2):
    for i in range(points.shape[0]):
        points[i, 0] = sobol.uniform(ti.cast(i, ti.u32))


def points(key: int, count: int, bits: int | None = None, positions: np.ndarray | None = None) -> np.ndarray:
    """Return the first `count` points of each pixel, [pixels * count, 2]."""
    if positions is None:
        positions = np.array([77], np.int32)
    result = np.empty((count * len(positions), 2), np.float32)
    draw(key, 5, sobol.index_bits(count) if bits is None else bits, upload(positions), result)
    return result


def is_net(drawn: np.ndarray) -> bool:
    """Return whether every elementary interval contains exactly one point."""
    levels = len(drawn).bit_length() - 1
    for level in range(levels + 1):
        wide, tall = 1 << level, 1 << (levels - level)
        boxes = (drawn[:, 0] * wide).astype(int) * tall + (drawn[:, 1] * tall).astype(int)
        if sorted(boxes) != list(range(1 << levels)):
            return False
    return True


@pytest.mark.parametrize("key", [3, 0x3ADC0DE, -1])
@pytest.mark.parametrize("count", [1, 2, 4, 8, 64, 256])
def test_points_of_a_pixel_are_a_net_in_base_2(key: int, count: int) -> None:
    drawn = points(key, count)
    assert drawn.min() >= 0.0
    assert drawn.max() < 1.0
    assert is_net(drawn)


def test_points_are_stratified_for_any_number_of_samples() -> None:
    drawn = points(5, 48, bits=6)
    assert np.unique((drawn[:, 0] * 64).astype(int)).size == 48
    assert is_net(drawn[:32])
    assert is_net(drawn[32:])
    for count in (3, 5, 6):
        first = 1 << count.bit_length() - 1
        assert is_net(points(5, count)[:first])


@pytest.mark.parametrize("count", [1, 2, 4, 8])
def test_points_of_a_square_of_pixels_are_a_net(count: int) -> None:
    order = sobol.pixel_order(48, 40).reshape(40, 48)
    for size in (2, 4, 8):
        for y, x in ((0, 0), (16, 24), (32, 40)):
            assert is_net(points(9, count, positions=order[y : y + size, x : x + size].ravel()))


@pytest.mark.parametrize(("width", "height"), [(1, 1), (5, 1), (1, 7), (64, 64), (48, 36), (33, 130), (700, 3)])
def test_pixel_order_is_hierarchical(width: int, height: int) -> None:
    order = sobol.pixel_order(width, height)
    assert len(np.unique(order)) == width * height
    assert order.min() == 0
    assert order.max() < 1 << sobol.index_bits(width) + sobol.index_bits(height)
    order = order.reshape(height, width)
    for level in range(sobol.index_bits(min(width, height))):
        size = 1 << level
        squares = order >> 2 * level
        for y in range(0, height, size):
            assert (np.ptp(squares[y : y + size, :size], axis=(0, 1)) == 0).all()


def test_pairings_of_four_pixels_are_equally_frequent() -> None:
    order = sobol.pixel_order(128, 128).reshape(64, 2, 64, 2) % 4 // 2
    beside = (order[:, 0, :, 0] == order[:, 0, :, 1]).mean()
    above = (order[:, 0, :, 0] == order[:, 1, :, 0]).mean()
    across = (order[:, 0, :, 0] == order[:, 1, :, 1]).mean()
    assert beside + above + across == 1.0
    np.testing.assert_allclose((beside, above, across), 1.0 / 3.0, atol=0.03)


def test_points_are_uniform_and_independent_over_frames() -> None:
    """Over frames, a sample is uniform and independent of those of other sets.

    So are the points of neighboring pixels, except for the common net.
    """
    sets = [np.empty((20000, 2), np.float32) for _ in range(4)]
    for index in (0, 5 << 29):
        for number, drawn in enumerate(sets):
            draw_of_frames(number, index, drawn)
        columns = np.concatenate(sets, axis=1).T
        for column in columns:
            assert stats.kstest(column, "uniform").pvalue > 1e-4
        for a in range(len(columns)):
            for b in range(a):
                counts = np.histogram2d(columns[a], columns[b], bins=8, range=((0, 1), (0, 1)))[0]
                assert stats.chisquare(counts.ravel()).pvalue > 1e-5


def test_integration_error_is_below_independent_sampling() -> None:
    """The mean squared error, over many keys, of integrating a smooth 2D function with 64 points."""

    def integrand(at: np.ndarray) -> np.ndarray:
        return np.exp(-((at - 0.3) ** 2).sum(axis=-1)) * (1.0 + at[..., 0] * at[..., 1])

    estimates = [integrand(points(key, 64)).mean() for key in range(300)]
    independent = integrand(np.random.default_rng(0).random((300, 64, 2))).mean(axis=1)
    assert np.mean(estimates) == pytest.approx(independent.mean(), rel=0.01)
    assert np.var(estimates) < 0.005 * np.var(independent)


def test_unstratified_numbers_are_uniform() -> None:
    drawn = np.empty((20000, 1), np.float32)
    unstratified(drawn)
    assert stats.kstest(drawn[:, 0], "uniform").pvalue > 1e-4


def test_frame_keys_differ() -> None:
    keys = {sobol.frame_key(seed, frame) for seed in range(50) for frame in range(50)}
    assert len(keys) == 2500
    assert all(-(1 << 31) <= key < 1 << 31 for key in keys)
    assert sobol.frame_key(1 << 80, 3) == sobol.frame_key(1 << 80, 3)


@pytest.mark.parametrize(("spp", "bits"), [(1, 0), (2, 1), (3, 2), (16, 4), (17, 5)])
def test_index_bits(spp: int, bits: int) -> None:
    assert sobol.index_bits(spp) == bits
