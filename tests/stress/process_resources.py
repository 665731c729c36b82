# SPDX-License-Identifier: Apache-2.0
"""Memory, open files and threads of a process, from /proc."""

from __future__ import annotations

import gc
import os
from dataclasses import dataclass
from pathlib import Path


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
    files = len(os.listdir(f"/proc/{pid}/fd"))
    return Resources(resident_memory(pid), files, len(os.listdir(f"/proc/{pid}/task")))


def resident_memory(pid: int | str = "self") -> int:
    """Return the resident memory of a process, bytes."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
