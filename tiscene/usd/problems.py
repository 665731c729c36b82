"""What is wrong with a stage, and what of it is left out: collected while it is read, told once at the end."""

from __future__ import annotations

import warnings
from typing import Any

from tiscene.errors import StageError, StageWarning

_PATHS_NAMED = 5  # prims that one line of the warning names before it says how many more there are
_PROBLEMS_TOLD = 100


class Report:
    """Problems (the stage cannot be rendered) and omissions (it can, but not as its author meant it)."""

    def __init__(self, stage: str) -> None:
        """stage: how messages call the file."""
        self.stage = stage
        self._problems: dict[str, None] = {}  # ordered, and each line once: instances share their prototype's faults
        self._omissions: dict[str, dict[str, None]] = {}

    def problem(self, path: Any, what: str, text: str) -> None:
        """Something that makes the stage unusable: `</Room/Lamp> mesh: 3 faces refer to point 412, ...`."""
        self._problems[f"<{path}> {what}: {text}"] = None

    def omission(self, path: Any, text: str) -> None:
        """Something that is not drawn, or not quite as authored. Prims with the same text share a line."""
        self._omissions.setdefault(text, {})[str(path)] = None

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
