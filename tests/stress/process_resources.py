# SPDX-License-Identifier: Apache-2.0
"""Memory, open files and threads of a process, from /proc."""

from __future__ import annotations

import gc
import os
from dataclasses import dataclass


@dataclass(frozen=True)
class Resources:
    """What a process holds.

    Attributes:
        resident: Resident memory, bytes.
        files: Number of open file descriptors.
        threads: Number of threads.
    """

    resident: int
    files: int
    threads: int


def resources(pid: int | None = None) -> Resources:
    """Return what a process holds; None: this process, after a garbage collection."""
    if pid is None:
        gc.collect()
        pid = os.getpid()
    with open(f"/proc/{pid}/statm") as statm:
        pages = int(statm.read().split()[1])
    files = len(os.listdir(f"/proc/{pid}/fd"))
    return Resources(pages * os.sysconf("SC_PAGE_SIZE"), files, len(os.listdir(f"/proc/{pid}/task")))
