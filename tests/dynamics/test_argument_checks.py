# SPDX-License-Identifier: Apache-2.0
"""Checks of what users pass in: what is taken, what is refused, and how it is said."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest

from dynamics import DictTimings, UniformMovementRandomBounce, argument_checks


@pytest.mark.parametrize("value", [2, 2.0, np.float32(2), np.int8(2), Fraction(4, 2)])
def test_any_kind_of_number_is_a_float(value):
    assert argument_checks.number(value, "x") == 2.0
    assert type(argument_checks.number(value, "x")) is float


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (True, TypeError, "x=True: must be a number"),
        ("2", TypeError, "x='2': must be a number"),
        (math.nan, ValueError, "x=nan: must be finite"),
        (10**400, ValueError, "x=1.*: must be finite"),
    ],
)
def test_what_is_no_number(value, error, text):
    with pytest.raises(error, match=text):
        argument_checks.number(value, "x")


def test_whole_numbers():
    assert argument_checks.whole(np.int64(-3), "x") == -3
    assert type(argument_checks.whole(np.int64(-3), "x")) is int
    for value in (True, 1.0, "1", None):
        with pytest.raises(TypeError, match="must be a whole number"):
            argument_checks.whole(value, "x")


def test_as_many_numbers_as_are_wanted():
    assert argument_checks.numbers(np.arange(3), "x", 3, 4) == (0.0, 1.0, 2.0)
    assert argument_checks.numbers((), "x") == ()
    with pytest.raises(ValueError, match="must be 3 or 4 numbers, not 2"):
        argument_checks.numbers((1, 2), "x", 3, 4)
    with pytest.raises(TypeError, match="x='12': must be numbers"):
        argument_checks.numbers("12", "x")


def test_numbers_of_numpy_are_kept_as_plain_ones():
    """So that they can be written to a file."""
    assert type(UniformMovementRandomBounce(seed=np.int64(7)).seed) is int
    ((key, _),) = DictTimings({np.int64(0): 1.0}).times
    assert type(key) is int
