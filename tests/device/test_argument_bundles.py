# SPDX-License-Identifier: Apache-2.0
"""Named tuples as parameters of kernels."""

import inspect
from typing import NamedTuple

import numpy as np
import taichi as ti

from tiscene.device.argument_bundles import bundled
from tiscene.device.kernel_types import Floats1, Ints1


class Columns(NamedTuple):
    values: Floats1
    weights: Ints1


def weighted_sum(
    columns: Columns,
    count: ti.i32,
    other: Columns,
) -> ti.i32:
    """Sum values times weights of two tables."""
    total = 0.0
    for k in range(count):
        total += columns.values[k] * columns.weights[k] + other.values[k] * other.weights[k]
    return ti.cast(total, ti.i32)


FLAT = bundled(weighted_sum)
KERNEL = ti.kernel(FLAT)


def test_bundled_kernel_takes_fields_in_order() -> None:
    columns = Columns(np.array([1.0, 2.0], np.float32), np.array([3, 4], np.int32))
    other = Columns(np.array([10.0, 20.0], np.float32), np.array([5, 6], np.int32))
    assert KERNEL(*columns, 2, *other) == 3 + 8 + 50 + 120
    assert KERNEL(*columns, 1, *other) == 3 + 50


def test_bundled_parameters_are_named_after_fields() -> None:
    names = list(inspect.signature(FLAT).parameters)
    assert names == ["columns_values", "columns_weights", "count", "other_values", "other_weights"]


def test_bundled_function_keeps_line_numbers() -> None:
    assert FLAT.__code__.co_firstlineno == weighted_sum.__code__.co_firstlineno
    assert len(inspect.getsourcelines(FLAT)[0]) == len(inspect.getsourcelines(weighted_sum)[0])
