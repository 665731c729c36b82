# SPDX-License-Identifier: Apache-2.0
"""Validation of arguments: accepted and rejected values, and messages."""

from __future__ import annotations

import math
import re
import sys
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import pytest

from dynamics import (
    ArgumentError,
    ArgumentTypeError,
    Body,
    DictTimings,
    Keyframes,
    LinearWaypoints,
    LookAt,
    Orbit,
    Still,
    UniformMovementRandomBounce,
    Waypoint,
    argument_checks,
)
from dynamics.colliding_bodies import Mover


@pytest.mark.parametrize("value", [2, 2.0, np.float32(2), np.int8(2), Fraction(4, 2)])
def test_number_accepts_any_real_type_and_returns_float(value):
    assert argument_checks.number(value, "x") == 2.0
    assert type(argument_checks.number(value, "x")) is float


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (True, ArgumentTypeError, "x=True: must be a number"),
        ("2", ArgumentTypeError, "x='2': must be a number"),
        (math.nan, ArgumentError, "x=nan: must be finite"),
        (10**400, ArgumentError, "x=1.*: must be finite"),
    ],
)
def test_number_rejects_other_types_and_non_finite_values(value, error, text):
    with pytest.raises(error, match=text):
        argument_checks.number(value, "x")


def test_whole_accepts_integer_types_only():
    assert argument_checks.whole(np.int64(-3), "x") == -3
    assert type(argument_checks.whole(np.int64(-3), "x")) is int
    for value in (True, 1.0, "1", None, np.zeros(2, int)):
        with pytest.raises(ArgumentTypeError, match="must be a whole number"):
            argument_checks.whole(value, "x")


def test_fields_of_frozen_dataclasses_are_replaced_by_checked_values():
    @dataclass(frozen=True)
    class Placed:
        frame: int
        position: tuple[float, ...] | None = None

        def __post_init__(self) -> None:
            vector = argument_checks.optional(argument_checks.vector)
            argument_checks.set_checked(self, frame=argument_checks.index, position=vector)

    assert Placed(np.int64(2)) == Placed(2, None)
    assert Placed(0, [1, 2, 3]).position == (1.0, 2.0, 3.0)
    for arguments, message in (
        ((-1,), "frame=-1: must be at least 0"),
        ((0, (1, 2)), "position=.*: must be 3 numbers"),
    ):
        with pytest.raises(ArgumentError, match=message):
            Placed(*arguments)


def test_numbers_checks_length_and_type():
    assert argument_checks.numbers(np.arange(3), "x", 3, 4) == (0.0, 1.0, 2.0)
    assert argument_checks.numbers((), "x") == ()
    with pytest.raises(ArgumentError, match="must be 3 or 4 numbers, not 2"):
        argument_checks.numbers((1, 2), "x", 3, 4)
    with pytest.raises(ArgumentTypeError, match="x='12': must be numbers"):
        argument_checks.numbers("12", "x")


@pytest.mark.parametrize("value", [{1, 2, 3}, frozenset({1, 2, 3}), {1: 0, 2: 0, 3: 0}, b"abc", bytearray(b"abc")])
def test_numbers_without_an_order_and_bytes_are_no_vector(value):
    with pytest.raises(ArgumentTypeError, match=r"^x=.*: must be 3 numbers"):
        argument_checks.vector(value, "x")
    with pytest.raises(ArgumentTypeError, match=r"^x.*: must be "):
        argument_checks.vectors(value, "x")


@pytest.mark.parametrize("value", [1e308, -1e39])
def test_vector_that_single_precision_cannot_hold_is_refused(value):
    with pytest.raises(ArgumentError, match=r"must be numbers of at most 3\.4e"):
        argument_checks.vector((0.0, value, 0.0), "x")


@pytest.mark.parametrize("far", [2e9, -3e38])
@pytest.mark.parametrize(
    ("argument", "make"),
    [
        ("waypoints[1].position", lambda at: LinearWaypoints([Waypoint((0, 0, 0)), Waypoint(at)])),
        ("waypoints[0].position", lambda at: Keyframes([0, 1], [Waypoint(at), Waypoint((0, 0, 0))])),
        ("center", Orbit),
        ("target", LookAt),
        ("position of 'a'", lambda at: Mover(Body(Still(), at, name="a"))),
        ("speed", lambda at: UniformMovementRandomBounce(abs(at[1]))),
    ],
)
def test_place_that_collisions_cannot_reach_is_refused_by_argument(argument, make, far):
    """Kernels did not end, or positions were rounded to nothing."""
    with pytest.raises(ArgumentError, match=f"^{re.escape(argument)}=.*: must be .*1e\\+09 m"):
        make((0.0, far, 0.0))


def test_numpy_numbers_are_stored_as_plain_numbers():
    """Plain numbers can be serialized."""
    assert type(UniformMovementRandomBounce(seed=np.int64(7)).seed) is int
    ((key, _),) = DictTimings({np.int64(0): 1.0}).times
    assert type(key) is int


@pytest.mark.parametrize(
    ("value", "high", "expected"),
    [(-1, sys.maxsize, "at least 0"), (10**30, sys.maxsize, f"from 0 to {sys.maxsize}"), (-1, 9, "from 0 to 9")],
)
def test_integer_outside_its_range_is_told_the_bound_that_it_violates(value, high, expected):
    with pytest.raises(ArgumentError, match=f"^x={value}: must be {expected}$"):
        argument_checks.integer(value, "x", 0, high)
