# SPDX-License-Identifier: Apache-2.0
"""Values of a function are computed once for each object, and end with it."""

from __future__ import annotations

import gc
import weakref

from dynamics.weak_cache import weakly_cached


class Thing:
    """An object with an identity."""


def test_value_is_computed_once_for_each_object() -> None:
    calls: list[Thing] = []

    @weakly_cached
    def number(thing: Thing) -> int:
        """Return a number."""
        calls.append(thing)
        return len(calls)

    one, other = Thing(), Thing()
    assert [number(one), number(other), number(one), number(other)] == [1, 2, 1, 2]
    assert number.__doc__ == "Return a number."


def test_value_ends_with_its_object() -> None:
    made = weakly_cached(lambda thing: Thing())
    thing = Thing()
    value = weakref.ref(made(thing))
    gc.collect()
    assert value() is not None
    del thing
    gc.collect()
    assert value() is None


def test_objects_at_one_address_have_values_of_their_own() -> None:
    numbers = iter(range(100))
    number = weakly_cached(lambda thing: next(numbers))
    found = [(number(thing), id(thing)) for thing in (Thing() for _ in range(100))]
    assert len({value for value, _ in found}) == 100
    assert len({address for _, address in found}) < 100
