# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
import taichi as ti

from tiscene.device import runtime
from tiscene.device.balanced_loops import item_of, iterations
from tiscene.device.kernel_types import Ints1

MIN_RANGE = 512  # iterations of a loop that Taichi 1.7.4 gives to one thread


@ti.kernel
def record_iterations(count: ti.i32, iteration_of: Ints1, visits: Ints1) -> ti.i32:
    """Write the iteration of each item, and count its visits; return the number of iterations."""
    for iteration in range(iterations(count)):
        item = item_of(iteration, count)
        if item >= 0:
            iteration_of[item] = iteration
            visits[item] += 1
    return iterations(count)


def run(count):
    runtime.start()
    iteration_of, visits = np.full(count + 1, -1, np.int32), np.zeros(count + 1, np.int32)
    total = record_iterations(count, iteration_of, visits)
    assert not visits[count]
    return iteration_of[:count], visits[:count], total


@pytest.mark.parametrize("count", [0, 1, 7, 16, 17, 127, 128, 129, 511, 512, 513, 2047, 2048, 3700, 16_384, 100_003])
def test_every_item_is_visited_once(count):
    iteration_of, visits, total = run(count)
    assert (visits == 1).all()
    assert (iteration_of < total).all()
    assert len(np.unique(iteration_of)) == count


@pytest.mark.parametrize("threads", [2, 4, 16])
@pytest.mark.parametrize("count", [256, 344, 732, 3700, 16_384, 59_200])
def test_threads_share_every_part_of_the_items(count, threads):
    iteration_of, _, total = run(count)
    thread = iteration_of // max(MIN_RANGE, -(-total // threads))
    for part in np.array_split(thread, 2 if count < 2048 else 8):
        assert np.bincount(part, minlength=threads).max() <= 1.3 * len(part) / threads + 1
