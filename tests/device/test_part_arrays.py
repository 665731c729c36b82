# SPDX-License-Identifier: Apache-2.0
"""PartArray: parts that it holds are not copied again."""

import numpy as np
import pytest

from tiscene.device import runtime
from tiscene.device.part_arrays import ArrayPart, PartArray


@pytest.fixture(autouse=True)
def started():
    runtime.start()


class Source:
    """Rows [n, 2], and how often they were asked for."""

    def __init__(self, length, seed):
        self.values = np.random.default_rng(seed).random((length, 2)).astype(np.float32)
        self.asked = 0

    def rows(self):
        self.asked += 1
        return self.values

    def part(self, number=0):
        return ArrayPart(self, number, len(self.values), self.rows)


def contents(array, sources):
    return array.array.to_numpy()[: sum(len(each.values) for each in sources)]


def test_common_first_parts_are_copied_once_and_the_others_replaced():
    stage, stage_end, chair, ball = (Source(length, length) for length in (5, 7, 3, 9))
    array = PartArray(np.float32, 2)
    for scene in ([stage, stage_end, chair], [stage, stage_end, ball], [stage, stage_end], [stage, stage_end, chair]):
        array.write([each.part() for each in scene])
        np.testing.assert_array_equal(contents(array, scene), np.concatenate([each.values for each in scene]))
    assert [each.asked for each in (stage, stage_end, chair, ball)] == [1, 1, 2, 1]


def test_part_is_copied_again_where_its_number_or_a_part_before_it_differs():
    first, second = Source(4, 0), Source(4, 1)
    array = PartArray(np.float32, 2)
    array.write([first.part(), second.part()])
    array.write([first.part(), second.part(number=1)])
    array.write([second.part(), first.part()])
    np.testing.assert_array_equal(contents(array, [second, first]), np.concatenate([second.values, first.values]))
    assert (first.asked, second.asked) == (2, 3)


def test_parts_that_an_interrupted_write_has_replaced_are_copied_again():
    first, second, other = (Source(4, seed) for seed in range(3))
    array = PartArray(np.float32, 2)
    array.write([first.part(), second.part()])

    def interrupted():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        array.write([first.part(), other.part(), ArrayPart(object(), 0, 4, interrupted)])
    array.write([first.part(), second.part()])
    np.testing.assert_array_equal(contents(array, [first, second]), np.concatenate([first.values, second.values]))


def test_array_has_a_row_without_parts_and_keeps_what_it_has():
    array = PartArray(np.int32)
    assert array.array.shape == (1,)
    array.write([ArrayPart(self := object(), 0, 2, lambda: np.array([3, 4]))])
    assert array.write([]).to_numpy().tolist() == [3, 4]
    assert array.nbytes == 8
    array.write([ArrayPart(self, 0, 2, lambda: pytest.fail("copied again"))])
