# SPDX-License-Identifier: Apache-2.0
"""Memory stays flat over restarts of a stream. Measured in a process of its own, so that no other test counts."""

import sys

import pytest

from tests.stress.steady_state import SCENES, SMALL_SCENES, run_one

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="memory is read from /proc")


def test_memory_is_flat_over_12_restarts_of_three_small_scenes():
    assert len(set(SMALL_SCENES)) == 3
    outcome = run_one("restarts", "small scenes", steps=12, warm_up=6, growth=0.02)
    assert outcome.held, outcome.figures


@pytest.mark.slow
def test_memory_after_200_restarts_over_three_scenes_is_within_10_percent_of_the_first_ten():
    # 9 and 201: both measurements are made in the same scene.
    assert len(set(SCENES)) == 3
    outcome = run_one("restarts", "scenes", steps=201, warm_up=9, growth=0.10)
    print(outcome.figures)
    assert outcome.held, outcome.figures
