# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
import taichi as ti

from dynamics.balanced_loops import MIN_RANGE, first_items, iterations, iterations_of_long_items, next_item
from tiscene.device import runtime
from tiscene.device.kernel_types import Ints1


@ti.kernel
def record_workers(count: ti.i32, size: ti.i32, work: Ints1, worker_of: Ints1, visits: Ints1) -> ti.i32:
    """Write the iteration of each item, after as many steps as `work` says, and count its visits."""
    taken = 0
    for iteration in range(iterations(count)):
        item, end = first_items(taken, iteration, count, size)
        while item < end:
            this = item
            item, end = next_item(taken, item, end, count, size)
            x = 1.0
            for _ in range(work[this]):
                x = x * 0.999 + 0.1
            worker_of[this] = iteration
            visits[this] += ti.cast(x > 0.0, ti.i32)
    return iterations(count)


def run(count, size, work=None):
    runtime.start()
    worker_of, visits = np.full(count + 1, -1, np.int32), np.zeros(count + 1, np.int32)
    work = np.zeros(count + 1, np.int32) if work is None else work
    total = record_workers(count, size, work, worker_of, visits)
    assert not visits[count]
    return worker_of[:count], visits[:count], total


@pytest.mark.parametrize("count", [0, 1, 7, 8, 9, 127, 128, 511, 512, 513, 2048, 8191, 16_384, 100_003])
@pytest.mark.parametrize("size", [1, 8, 30])
def test_every_item_is_visited_once(count, size):
    worker_of, visits, total = run(count, size)
    assert (visits == 1).all()
    assert (worker_of < total).all()
    assert (worker_of % MIN_RANGE == 0).all()


@pytest.mark.parametrize(
    ("count", "workers"), [(0, 0), (1, 1), (8, 1), (9, 2), (8192, 32), (16_384, 64), (1 << 20, 128)]
)
def test_short_loops_have_few_workers(count, workers):
    assert run(count, 8)[2] == workers * MIN_RANGE


def test_a_free_thread_takes_the_items_of_a_busy_one():
    work = np.full(2001, 1000, np.int32)
    work[0] = 20_000_000  # ten times as long as all others
    worker_of, _, total = run(2000, 8, work)
    threads = ti.cfg.cpu_max_num_threads
    if threads == 1:
        pytest.skip("one thread")
    thread = worker_of // max(MIN_RANGE, -(-total // threads))
    assert (thread[8:] == thread[0]).mean() < 0.25


@ti.kernel
def record_long_items(work: Ints1, worker_of: Ints1, visits: Ints1):
    """As `record_workers`, for items that take long."""
    count = work.shape[0]
    taken = 0
    for iteration in range(iterations_of_long_items(count)):
        item, end = first_items(taken, iteration, count, 1)
        while item < end:
            x = 1.0
            for _ in range(work[item]):
                x = x * 0.999 + 0.1
            worker_of[item] = iteration
            visits[item] += ti.cast(x > 0.0, ti.i32)
            item, end = next_item(taken, item, end, count, 1)


@pytest.mark.parametrize("count", [1, 2, 127, 129, 1000])
def test_every_long_item_is_visited_once(count):
    runtime.start()
    worker_of, visits = np.full(count, -1, np.int32), np.zeros(count, np.int32)
    record_long_items(np.zeros(count, np.int32), worker_of, visits)
    assert (visits == 1).all()
    assert (worker_of % MIN_RANGE == 0).all()


def test_two_long_items_have_two_threads():
    runtime.start()
    if ti.cfg.cpu_max_num_threads == 1:
        pytest.skip("one thread")
    work, worker_of = np.full(2, 20_000_000, np.int32), np.zeros(2, np.int32)
    for _ in range(50):  # on a busy machine, a thread may start when the other has done both
        record_long_items(work, worker_of, np.zeros(2, np.int32))
        if worker_of[0] != worker_of[1]:
            break
    assert sorted(worker_of.tolist()) == [0, MIN_RANGE]
