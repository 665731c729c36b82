# SPDX-License-Identifier: Apache-2.0
"""Taichi's worker threads, each bound to a core of its own (Linux).

Most kernels of a frame take a millisecond or two. When Linux wakes two workers at once, it often puts both on one core,
and moves one away after such a time only: on two cores, a kernel of 1.5 ms then takes as long as on one. Bound to
different cores, workers start together. (Intel's Open Image Denoise binds its threads too, by default.)
"""

import contextlib
import os


def running_threads() -> set[int]:
    """Return the numbers of the threads of this process; none on other systems than Linux."""
    try:
        return {int(number) for number in os.listdir("/proc/self/task")}
    except OSError:
        return set()


def bind_workers(started: set[int], workers: int) -> None:
    """Bind worker threads to the cores that this process may use, if there are as many.

    Fewer workers are left as they are: those of several processes would be bound to the same cores. So they are where
    threads cannot be bound.

    Args:
        started: The threads that Taichi has started: those of its compiler, then its workers.
        workers: Number of workers.
    """
    if not started:
        return
    cores = sorted(os.sched_getaffinity(0))
    if workers == len(cores) <= len(started):
        with contextlib.suppress(OSError):
            for thread, core in zip(sorted(started)[-workers:], cores, strict=True):
                os.sched_setaffinity(thread, {core})
