# SPDX-License-Identifier: Apache-2.0
"""Checkpoints: states at intervals that double, in bounded memory."""

from __future__ import annotations

from dynamics.checkpoints import Checkpoints


def test_interval_doubles_where_there_are_too_many_states() -> None:
    checkpoints = Checkpoints[str](2, 4)
    for number in range(20):
        checkpoints.add(number, str(number))
    assert checkpoints == {0: "0", 8: "8", 16: "16"}
    assert checkpoints.interval == 8


def test_state_between_intervals_is_kept_if_asked_for_and_none_is_replaced() -> None:
    checkpoints = Checkpoints[str](4, 8)
    checkpoints.add(5, "start", always=True)
    checkpoints.add(5, "again", always=True)
    checkpoints.add(6, "between")
    assert checkpoints == {5: "start"}
