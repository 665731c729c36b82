# SPDX-License-Identifier: Apache-2.0
"""Prefix sums of counts, for compactions whose order does not depend on threads."""

import taichi as ti

from tiscene.device import runtime
from tiscene.device.kernel_types import Template

SCAN_BLOCKS = 128  # whose counts a GPU sums up in parallel


def scans_in_blocks() -> bool:
    """Return what to pass as `in_blocks` of `exclusive_scan` on the running device."""
    return runtime.running() == "cuda"


@ti.func
def exclusive_scan(counts: Template, length: ti.i32, in_blocks: Template):
    """Replace counts[0 .. length) by their exclusive prefix sums, followed by the total.

    Its loops are parallel where a kernel calls it outside of loops, which it must.

    Args:
        counts: i32 [length + 1 + SCAN_BLOCKS] or longer.
        length: Number of counts.
        in_blocks: Compile-time: scan in SCAN_BLOCKS blocks, of which one thread scans the totals only. A GPU thread
            takes milliseconds for all; a CPU has the result sooner than it starts its threads.
    """
    scanned = length  # counts that one thread scans; with blocks, those of their totals
    first = 0
    block_size = (length + SCAN_BLOCKS - 1) // SCAN_BLOCKS
    if ti.static(in_blocks):
        scanned = SCAN_BLOCKS
        first = length + 1
        for block in range(SCAN_BLOCKS):
            total = 0
            for k in range(block * block_size, ti.min(length, (block + 1) * block_size)):
                total += counts[k]
            counts[length + 1 + block] = total
    ti.loop_config(serialize=True)
    for _ in range(1):
        total = 0
        for k in range(first, first + scanned):
            count = counts[k]
            counts[k] = total
            total += count
        counts[length] = total
    if ti.static(in_blocks):
        for block in range(SCAN_BLOCKS):
            total = counts[length + 1 + block]
            for k in range(block * block_size, ti.min(length, (block + 1) * block_size)):
                count = counts[k]
                counts[k] = total
                total += count
