# SPDX-License-Identifier: Apache-2.0
"""Caches keep the values used last and no more than they may."""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor

from dynamics.lru_cache import LRUCache


def test_least_recently_used_value_is_dropped_first() -> None:
    cache, made = LRUCache[str, int](2), []
    for key in ("a", "b", "a", "c", "a", "b"):
        assert cache.get(key, lambda key=key: made.append(key) or ord(key)) == ord(key)
        assert len(cache) <= 2
    assert made == ["a", "b", "c", "b"]


def test_values_may_be_none() -> None:
    cache, made = LRUCache[int, None](1), []
    for _ in range(2):
        assert cache.get(0, lambda: made.append(0)) is None
    assert made == [0]


def test_room_is_made_before_a_value_is() -> None:
    cache = LRUCache[int, int](1)
    cache.get(0, lambda: 0)
    assert cache.get(1, lambda: len(cache)) == 0


def test_outdated_values_are_dropped() -> None:
    cache = LRUCache[int, int](3)
    for key in range(3):
        cache.get(key, lambda: 0)
    cache.drop(lambda key: key > 0)
    assert [cache.get(key, lambda: 1) for key in range(3)] == [0, 1, 1]


def test_values_are_dropped_while_others_are_used() -> None:
    """As another thread would use them between two keys."""
    cache = LRUCache[int, int](4)
    for key in range(4):
        cache.get(key, lambda: 0)

    def outdated(key: int) -> bool:
        cache.get(10 + key, lambda: 1)  # drops `key`, the least recently used one
        return key % 2 == 0

    cache.drop(outdated)
    assert [key for key in range(20) if key in cache] == [10, 11, 12, 13]


def test_threads_share_a_cache() -> None:
    cache, interval = LRUCache[int, int](2), sys.getswitchinterval()

    def use(seed: int) -> None:
        for number in range(5000):
            key = (number * seed) % 3
            assert cache.get(key, lambda key=key: 10 * key) == 10 * key

    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(4) as pool:
            list(pool.map(use, (1, 2, 4, 5)))
    finally:
        sys.setswitchinterval(interval)
