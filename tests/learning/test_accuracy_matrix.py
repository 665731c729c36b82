# SPDX-License-Identifier: Apache-2.0
"""ACC, BWT, FWT and forgetting against values computed by hand; `test_adapters.py` compares with Avalanche's."""

import numpy as np
import pytest

from tiscene.learning.accuracy_matrix import (
    average_accuracy,
    backward_transfer,
    forgetting,
    forward_transfer,
    held_out_accuracy,
)

# Rows: untrained, after phases 1 to 3; columns: three tests, one for each phase.
R = np.array([[0.1, 0.2, 0.3], [0.9, 0.3, 0.25], [0.5, 0.8, 0.35], [0.6, 0.4, 0.7]])
LEARNED = (1, 2, 3)


def test_scores_equal_values_computed_by_hand():
    assert average_accuracy(R, LEARNED) == pytest.approx((0.6 + 0.4 + 0.7) / 3)
    assert backward_transfer(R, LEARNED) == pytest.approx(((0.6 - 0.9) + (0.4 - 0.8)) / 2)
    assert forward_transfer(R, LEARNED) == pytest.approx(((0.3 - 0.2) + (0.35 - 0.3)) / 2)
    assert forgetting(R, LEARNED) == pytest.approx(((0.9 - 0.6) + (0.8 - 0.4)) / 2)


def test_forgetting_counts_from_the_best_accuracy():
    later = np.array([[0.0, 0.0], [0.5, 0.1], [0.8, 0.6], [0.4, 0.9]])
    assert forgetting(later, (1, 3)) == pytest.approx(0.8 - 0.4)
    assert backward_transfer(later, (1, 3)) == pytest.approx(0.4 - 0.5)


def test_tests_of_no_phase_count_as_held_out_only():
    assert average_accuracy(R, (1, None, 3)) == pytest.approx((0.6 + 0.7) / 2)
    assert held_out_accuracy(R, (1, None, 3)) == pytest.approx(0.4)
    assert backward_transfer(R, (1, None, 3)) == pytest.approx(0.6 - 0.9)
    assert held_out_accuracy(R, LEARNED) is None


def test_tests_without_pixels_are_left_out():
    unknown = R * [1, np.nan, 1]
    assert average_accuracy(unknown, LEARNED) == pytest.approx((0.6 + 0.7) / 2)
    assert backward_transfer(unknown, LEARNED) == pytest.approx(0.6 - 0.9)
    assert average_accuracy(R * np.nan, LEARNED) is None


def test_single_phase_has_neither_transfer_nor_forgetting():
    single = np.array([[0.1], [0.9]])
    assert average_accuracy(single, (1,)) == 0.9
    assert backward_transfer(single, (1,)) is forward_transfer(single, (1,)) is forgetting(single, (1,)) is None
