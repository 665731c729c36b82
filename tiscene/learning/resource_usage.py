# SPDX-License-Identifier: Apache-2.0
"""ResourceUsage: what a learner costs. These figures depend on the machine; all others do not."""

from __future__ import annotations

import contextlib
import pickle
import sys
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any


class ResourceUsage:
    """Wall and processor time of a learner's calls, and its memory."""

    def __init__(self) -> None:
        self._wall: Counter[str] = Counter()
        self._cpu: Counter[str] = Counter()
        self._calls: Counter[str] = Counter()

    @contextlib.contextmanager
    def of(self, kind: str) -> Iterator[None]:
        """Measure a block."""
        wall, cpu = time.perf_counter(), time.process_time()
        yield
        self._wall[kind] += time.perf_counter() - wall  # type: ignore[assignment]
        self._cpu[kind] += time.process_time() - cpu  # type: ignore[assignment]
        self._calls[kind] += 1

    def result(self, learner: Any) -> dict[str, Any]:
        """Return seconds and calls by method, the process's peak memory and the learner's stored bytes."""
        return {
            "wall_seconds": dict(self._wall),
            "cpu_seconds": dict(self._cpu),
            "calls": dict(self._calls),
            "peak_memory_bytes": peak_memory(),
            "stored_bytes": stored_bytes(learner),
        }

    def state_dict(self) -> dict[str, Any]:
        """Return the times so far as JSON-ready values."""
        return {"wall": dict(self._wall), "cpu": dict(self._cpu), "calls": dict(self._calls)}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Take the times of `state_dict`."""
        self._wall, self._cpu, self._calls = (Counter(state[name]) for name in ("wall", "cpu", "calls"))


def peak_memory() -> int | None:
    """Return the largest resident memory of this process so far, bytes; None where it is not known."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    largest = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return int(largest if sys.platform == "darwin" else largest * 1024)


def stored_bytes(learner: Any) -> int | None:
    """Return the memory that a learner keeps: as it says, else the size of its pickled state; None: unknown."""
    if hasattr(learner, "stored_bytes"):
        return int(learner.stored_bytes())
    if not hasattr(learner, "state_dict"):
        return None
    return len(pickle.dumps(learner.state_dict()))
