# SPDX-License-Identifier: Apache-2.0
"""Wall and CPU time of a call."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, TypeVar

Result = TypeVar("Result")


def timed(work: Callable[..., Result], *arguments: Any) -> tuple[float, float, Result]:
    """Call a function, and return its wall time and the CPU time of this process, s, and its result."""
    wall, cpu = time.perf_counter(), time.process_time()
    result = work(*arguments)
    return time.perf_counter() - wall, time.process_time() - cpu, result
