# SPDX-License-Identifier: Apache-2.0
"""Cells of panoramas in 16 bits: how exactly they are kept."""

import numpy as np
import pytest
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.kernel_types import Floats1, Ints2
from tiscene.render.integrators.panorama.packed_cells import UNIT, pack, unpacked, words

LARGEST = 2.0**33 * (1.0 - 2.0**-10)


@ti.kernel
def _unpack(cells: Ints2, even: Floats1, odd: Floats1):
    for i in range(cells.shape[0]):
        even[i] = UNIT * unpacked(cells[i, 0], 0)
        odd[i] = UNIT * unpacked(cells[i, 0], 1)


def kept(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return values after packing, which must be the same in the lower and the upper half of a word."""
    even, odd = (np.empty(len(values), np.float32) for _ in range(2))
    _unpack(pack(np.stack([values, values], axis=-1)), even, odd)
    np.testing.assert_array_equal(even, odd)
    return even


def test_values_are_rounded_to_nearest() -> None:
    rng = np.random.default_rng(0)
    values = (10.0 ** rng.uniform(-8.0, 9.9, 20_000) * rng.choice([-1.0, 1.0], 20_000)).astype(np.float32)
    error = kept(values) / values - 1.0
    assert np.abs(error).max() <= 2.0**-10
    assert abs(error.mean()) < 3e-5  # light gets neither brighter nor darker
    packed = kept(values)
    np.testing.assert_array_equal(kept(packed), packed)


@pytest.mark.parametrize(
    ("value", "expected"),
    [(0.0, 0.0), (1.0, 1.0), (-0.75, -0.75), (1e5, 99968.0), (1e12, LARGEST), (-np.inf, -LARGEST), (1e-15, 0.0)],
)
def test_single_values(value: float, expected: float) -> None:
    assert kept(np.array([value], np.float32))[0] == np.float32(expected)


def test_odd_numbers_of_columns_fill_the_last_word() -> None:
    values = np.arange(1.0, 6.0, dtype=np.float32).reshape(1, 5)
    cells = pack(values)
    assert cells.shape == (1, words(5)) == (1, 3)
    np.testing.assert_array_equal(cells.view(np.uint16)[0, 4:], pack(values[:, 4:]).view(np.uint16)[0])
    assert cells.view(np.uint16)[0, 5] == 0
