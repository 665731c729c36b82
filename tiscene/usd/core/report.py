# SPDX-License-Identifier: Apache-2.0
"""What is wrong with a stage, and what of it is left out: collected while it is read, told once at the end."""

from __future__ import annotations

import contextlib
import re
import warnings
from collections.abc import Iterator
from typing import Any

from pxr import Tf

from tiscene.errors import StageError, StageWarning
from tiscene.usd.core.limits import Limits, Root, Spent

_INTERNAL = re.compile(r"\bpxrInternal\w*::")
_PATHS_NAMED = 5  # prims that one line of the warning names before it says how many more there are
_PROBLEMS_TOLD = 100
_LINES_TOLD = 20  # of what USD says of one failure


def error_lines(error: Tf.ErrorException) -> list[str]:
    """What USD says of a failure, one line each."""
    lines = [one_line(diagnostic) for diagnostic in error.args[:_LINES_TOLD]]  # damaged files give a million
    reasons = [line for line in lines if not line.startswith("Failed to open layer")]  # said after each of them
    return list(dict.fromkeys(reasons or lines)) or ["USD gave no reason"]


def one_line(error: Any) -> str:
    """The text of an error or diagnostic of USD, whose `str` can fail on bytes that are no UTF-8."""
    try:
        return _INTERNAL.sub("", " ".join(str(getattr(error, "commentary", error)).split()))
    except UnicodeDecodeError:
        return "USD's message about it is not valid UTF-8, so that the file is likely damaged"


class StageReport:
    """Problems (the stage cannot be rendered) and omissions (it can, but not as its author meant it)."""

    def __init__(self, stage: str, plays: bool = True, root: Root | None = None, spent: Spent | None = None) -> None:
        """stage: how messages call the file. plays: whether it is read to be played, not for one moment.

        root: where its files must be. spent: what reading it has taken.
        """
        self.stage = stage
        self.root = root or Root(None)
        self.spent = spent or Spent(stage, Limits())
        self.plays = plays
        self._problems: dict[str, None] = {}  # ordered, and each line once: instances share their prototype's faults
        self._omissions: dict[str, dict[str, None]] = {}

    def problem(self, path: Any, what: str, text: str) -> None:
        """Something that makes the stage unusable: `</Room/Lamp> mesh: 3 faces refer to point 412, ...`."""
        self._problems[f"<{path}> {what}: {text}"] = None

    @contextlib.contextmanager
    def guard(self, path: Any) -> Iterator[None]:
        """Turn what USD or numpy raise at the values of a damaged file into a problem of the prim at `path`."""
        try:
            yield
        except StageError:
            raise
        except Tf.ErrorException as error:
            for line in error_lines(error):
                self.problem(path, "cannot be read", line)
        except (TypeError, ValueError, OverflowError, MemoryError, RuntimeError) as error:
            self.problem(path, "cannot be read", f"{type(error).__name__}: {one_line(error)}")

    def omission(self, path: Any, text: str) -> None:
        """Something that is not drawn, or not quite as authored. Prims with the same text share a line."""
        self._omissions.setdefault(text, {})[str(path)] = None

    def frozen(self, path: Any, what: str) -> None:
        """Something that changes over time, and is drawn as it is at the time that is read."""
        if self.plays:
            self.omission(path, f"{what} has time samples, and is drawn as it is at the time read")

    def raise_problems(self) -> None:
        """Raise StageError if there is any problem."""
        if self._problems:
            problems = list(self._problems)
            if len(problems) > _PROBLEMS_TOLD:
                problems = [*problems[:_PROBLEMS_TOLD], f"... and {len(problems) - _PROBLEMS_TOLD} more"]
            raise StageError(self.stage, problems)

    def warn(self) -> None:
        """Give one StageWarning that names everything left out, if anything is."""
        if not self._omissions:
            return
        lines = []
        for text, paths in self._omissions.items():
            named = ", ".join(f"<{path}>" for path in list(paths)[:_PATHS_NAMED])
            more = f" and {len(paths) - _PATHS_NAMED} more" if len(paths) > _PATHS_NAMED else ""
            lines.append(f"  {text}: {named}{more}")
        message = f"{self.stage} is not drawn quite as authored:\n" + "\n".join(lines)
        warnings.warn(StageWarning(message), stacklevel=3)
