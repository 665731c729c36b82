# SPDX-License-Identifier: Apache-2.0
"""Parallel loops whose work a CPU's threads share evenly.

Taichi 1.7.4 divides the iterations of a parallel loop among the threads before it starts, whatever `block_dim` is:
each gets one range, of at least 512 iterations. So a loop over 500 packets of rays ran on one thread, and the thread
with the simpler half of an image waited for the other. In a balanced loop all parts of the items go to all threads,
and short loops have idle iterations::

    for iteration in range(iterations(count)):
        item = item_of(iteration, count)
        if item < 0:
            continue
        ...

Blocks of neighboring items fill a table row by row; the loop goes through it column by column. An idle iteration takes
about 2 ns. GPUs have loops of `count` iterations in the usual order.
"""

import taichi as ti

LOG_COLUMNS = 4
MAX_LOG_BLOCK = 3  # rays of neighboring packets find the same nodes in the caches
LOG_BLOCKS = 8  # of a loop, at least, before its blocks have several items
LOG_ITERATIONS = 14  # of a short loop, about: enough for 32 threads
MAX_LOG_IDLE = 7


@ti.func
def iterations(count: ti.i32) -> ti.i32:
    """Return the number of iterations of a loop over `count` items."""
    result = count
    if ti.static(ti.cfg.arch != ti.cuda):
        log_block = log_block_size(count)
        result = row_count(count, log_block) << (LOG_COLUMNS + log_block + log_idle(count))
    return result


@ti.func
def item_of(iteration: ti.i32, count: ti.i32) -> ti.i32:
    """Return the item of an iteration of a loop over `count` items; negative if it has none."""
    item = iteration
    if ti.static(ti.cfg.arch != ti.cuda):
        idle = log_idle(count)
        item = -1
        if iteration & ((1 << idle) - 1) == 0:
            log_block = log_block_size(count)
            rows = row_count(count, log_block)
            place = iteration >> idle
            block = place >> log_block
            column = ti.raw_div(block, rows)
            block = ((block - column * rows) << LOG_COLUMNS) + column
            item = (block << log_block) + (place & ((1 << log_block) - 1))
            if item >= count:
                item = -1
    return item


@ti.func
def log_block_size(count: ti.i32) -> ti.i32:
    """Return the logarithm of the number of items in a block."""
    return ti.math.clamp(31 - LOG_BLOCKS - ti.math.clz(count), 0, MAX_LOG_BLOCK)


@ti.func
def row_count(count: ti.i32, log_block: ti.i32) -> ti.i32:
    """Return the number of rows of the table of blocks."""
    log_row = LOG_COLUMNS + log_block
    return (count + ((1 << log_row) - 1)) >> log_row


@ti.func
def log_idle(count: ti.i32) -> ti.i32:
    """Return s so that one of 2^s iterations has an item."""
    return ti.math.clamp(ti.math.clz(count) - (31 - LOG_ITERATIONS), 0, MAX_LOG_IDLE)
