# SPDX-License-Identifier: Apache-2.0
"""Parallel loops whose items a CPU's threads take as they become free.

Taichi 1.7.4 divides the iterations of a parallel loop among the threads before it starts, whatever `block_dim` is:
each gets one range, of at least 512 iterations. So a loop over 500 packets of rays ran on one thread, and threads
waited for the one with the harder items, or the busier core. In a balanced loop every `MIN_RANGE`th iteration is a
worker, which takes the next few items until there are none::

    taken = 0
    for iteration in range(iterations(count)):
        item, end = first_items(taken, iteration, count, size)
        while item < end:
            this = item
            item, end = next_item(taken, item, end, count, size)
            ...

Other iterations are idle, about 2 ns each; so short loops have few workers, unless an item takes many microseconds.
GPUs have loops of `count` iterations, one for each item.
"""

import taichi as ti

from dynamics.kernel_types import Template

MIN_RANGE = 512  # iterations of a loop that Taichi gives to one thread, at least
WORKERS, MAX_WORKERS = 32, 128  # in short and in long loops
LOG_ITEMS, LOG_MANY_ITEMS = 3, 8  # of each worker up to WORKERS, and beyond


@ti.func
def iterations(count: ti.i32) -> ti.i32:
    """Return the number of iterations of a loop over `count` items."""
    result = count
    if ti.static(ti.cfg.arch != ti.cuda):
        few = ti.min(WORKERS, (count + (1 << LOG_ITEMS) - 1) >> LOG_ITEMS)
        result = MIN_RANGE * ti.math.clamp(count >> LOG_MANY_ITEMS, few, MAX_WORKERS)
    return result


@ti.func
def iterations_of_long_items(count: ti.i32) -> ti.i32:
    """Return the number of iterations of a loop over `count` items that take many microseconds each.

    Such a loop calls `next_item` when it is done with an item: another thread may be free sooner.
    """
    result = count
    if ti.static(ti.cfg.arch != ti.cuda):
        result = MIN_RANGE * ti.min(count, MAX_WORKERS)
    return result


@ti.func
def first_items(taken: Template, iteration: ti.i32, count: ti.i32, size: ti.i32):
    """Return the range of the first items of an iteration, empty if it is idle.

    Args:
        taken: Number of items that were taken, a variable of the kernel, which starts at 0.
        iteration: The iteration.
        count: Number of items.
        size: Number of items that a worker takes at a time.
    """
    item, end = iteration, iteration + 1
    if ti.static(ti.cfg.arch != ti.cuda):
        item, end = 0, 0
        if iteration % MIN_RANGE == 0:
            item = ti.atomic_add(taken, size)
            end = ti.min(item + size, count)
    return item, end


@ti.func
def next_item(taken: Template, item: ti.i32, end: ti.i32, count: ti.i32, size: ti.i32):
    """Return the range of items after `item`; others as `first_items`."""
    following, last = item + 1, end
    if ti.static(ti.cfg.arch != ti.cuda):
        if following == end:
            following = ti.atomic_add(taken, size)
            last = ti.min(following + size, count)
    return following, last
