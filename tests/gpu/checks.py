# SPDX-License-Identifier: Apache-2.0
"""Lines of results, and the time of work on a device."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import taichi as ti


@dataclass(frozen=True)
class Check:
    """A line of results.

    Attributes:
        what: what was measured or compared.
        found: the result.
        passed: whether it is as it should be; None for a measurement.
    """

    what: str
    found: str
    passed: bool | None = None


def median(work: Callable[[], Any], runs: int = 20) -> float:
    """Return the median wall time of a function, s, after one run to warm up."""
    work()
    times = []
    for _ in range(runs):
        ti.sync()
        began = time.perf_counter()
        work()
        ti.sync()
        times.append(time.perf_counter() - began)
    return float(np.median(times))
