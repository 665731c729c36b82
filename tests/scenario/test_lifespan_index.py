# SPDX-License-Identifier: Apache-2.0
"""LifespanIndex: the same answers as a search through all lifespans."""

import random

import pytest

from tiscene.scenario.lifespan_index import LifespanIndex


@pytest.mark.parametrize("seed", range(5))
def test_index_finds_what_a_search_finds(seed):
    random.seed(seed)
    index, lifespans = LifespanIndex(), {}
    for number in range(60):
        first = random.randrange(200)
        last = None if random.random() < 0.3 else first + random.randrange(-1, 150)
        index.add(number, first, last)
        lifespans[number] = first, last
        if random.random() < 0.4:
            removed = random.choice(list(lifespans))
            index.remove(removed, *lifespans.pop(removed))
    for frame in range(-1, 360):
        expected = [
            number for number, (first, last) in lifespans.items() if first <= frame and (last is None or frame <= last)
        ]
        assert index.at(frame) == expected


def test_index_takes_frames_of_any_size():
    index = LifespanIndex()
    index.add(1, 0, 10**30)
    index.add(2, 2**63, 2**64)
    assert index.at(2**63) == [1, 2]
    assert index.at(2**64 + 1) == [1]
    assert index.at(10**30 + 1) == []
