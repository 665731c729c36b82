# SPDX-License-Identifier: Apache-2.0
"""StageReport: problems and omissions collected while a stage is read, raised or warned about once at the end.

A problem is a part of the stage that is broken and left out: a prim that contradicts itself, a file that is missing. An
omission is content that is approximated or not supported. Both end in one StageWarning. Problems end in a StageError
where nothing is left to render, or where the caller asked for it (`strict`).
"""

from __future__ import annotations

import contextlib
import re
import sys
import warnings
from collections.abc import Iterator, Sequence
from typing import Any

from pxr import Tf, Usd

from tiscene.errors import StageError, StageWarning, TisceneError
from tiscene.usd.core.limits import Limits, ReadingBudget, RootFolder

_INTERNAL_NAMESPACE = re.compile(r"\bpxrInternal\w*::")
_GRAMMAR_RULE = re.compile(r"\bparse error matching .*?(?= at ')")  # a C++ type of up to 500 letters
_SESSION_LAYER = re.compile(r",?@anon:0x[0-9a-f]+:[^@]*@")  # its name has an address
_NUMBER = re.compile(r"\b[0-9][0-9,]*\b")
COMPOSITION = "composition"  # subject of problems of missing or unreadable files
UNDRAWN = "are not drawn"  # ends the omission of prims of a type
_MAX_PATHS = 5  # prims listed per line
_MAX_PROBLEMS = 100  # problems listed by an error
_MAX_DIAGNOSTICS = 20  # lines of USD's diagnostics per failure; a damaged file can give a million


def error_lines(error: Tf.ErrorException) -> list[str]:
    """Return USD's reasons for a failure, one line each."""
    lines = [one_line(diagnostic) for diagnostic in error.args[:_MAX_DIAGNOSTICS]]
    reasons = [line for line in lines if not line.startswith("Failed to open layer")]  # follows each of the reasons
    return list(dict.fromkeys(reasons or lines)) or ["USD gave no reason"]


def one_line(error: Any) -> str:
    """Return the text of a USD diagnostic, or of an exception, on one line.

    The `str` of a diagnostic fails where it quotes bytes of a file that are not UTF-8.
    """
    try:
        text = " ".join(str(getattr(error, "commentary", error)).split())
        text = _GRAMMAR_RULE.sub("syntax error", _INTERNAL_NAMESPACE.sub("", text))
        return _SESSION_LAYER.sub("", text)
    except UnicodeDecodeError:
        return "USD's message about it is not valid UTF-8; the file is probably damaged"


def _listed(paths: Sequence[str], most: int) -> str:
    """Return paths of prims as text, at most so many of them and the number of the others."""
    more = f" and {len(paths) - most} more" if len(paths) > most else ""
    return ", ".join(f"<{path}>" for path in paths[:most]) + more


def _mistyped(prim: Usd.Prim) -> str:
    """Return which attributes of a prim are authored with another type than that of its schemas; "" if none are."""
    faults = []
    definition = prim.GetPrimDefinition()
    for attribute in prim.GetAuthoredAttributes():
        schema = definition.GetAttributeDefinition(attribute.GetName())
        if schema:
            expected = schema.GetTypeName()
            found = {spec.typeName for spec in attribute.GetPropertyStack(Usd.TimeCode.Default())}
            faults += [f"{attribute.GetName()} is {each}, expected {expected}" for each in found if each != expected]
    return "; ".join(sorted(faults))


def outer_level() -> int:
    """Return the `stacklevel` by which the caller warns at the line that called tiscene."""
    frame, level = sys._getframe(1), 1
    while frame.f_back is not None and frame.f_globals.get("__name__", "").partition(".")[0] == "tiscene":
        frame, level = frame.f_back, level + 1
    return level


class StageReport:
    """Problems (broken parts, which are left out) and omissions (parts that are not rendered exactly as authored).

    Args:
        stage: name of the file in messages.
        root: the folder that files must be in; None: no restriction.
        budget: what reading has used of its limits; None: a new one with the default limits.
        strict: whether any problem refuses the stage.

    Attributes:
        reads_animation: whether time samples are read as animation, not at one time code only.
    """

    def __init__(
        self,
        stage: str,
        root: RootFolder | None = None,
        budget: ReadingBudget | None = None,
        strict: bool = False,
    ) -> None:
        self.stage = stage
        self.reads_animation = True
        self.root = root or RootFolder(None)
        self.budget = budget or ReadingBudget(stage, Limits())
        self.strict = strict
        # By subject and text, ordered; each path once: instances share the faults of their prototype.
        self._problems: dict[tuple[str, str], dict[str, None]] = {}
        self._refused = False
        self._omissions: dict[str, dict[str, None]] = {}
        self._heard: set[tuple[str, str]] | None = None  # within `over_times`: paths, with texts without their numbers

    @contextlib.contextmanager
    def over_times(self) -> Iterator[None]:
        """Add the first only of texts that differ in their numbers alone, since one prim is read at many times."""
        self._heard = set()
        try:
            yield
        finally:
            self._heard = None

    def _is_heard(self, path: Any, text: str) -> bool:
        """Return whether a text, but for its numbers, has been added within `over_times`."""
        if self._heard is None:
            return False
        key = str(path), _NUMBER.sub("", text)
        is_heard = key in self._heard
        self._heard.add(key)
        return is_heard

    def problem(self, path: Any, subject: str, text: str) -> None:
        """Add a problem: `</Room/Lamp> mesh: 3 faces refer to point 412, ...`. The caller leaves the part out.

        Prims with the same problem share a line, which begins with the first of them.

        Args:
            path: path of the prim.
            subject: what of the prim is wrong and left out, such as "mesh".
            text: the problem.
        """
        if not self._is_heard(path, text):
            self._problems.setdefault((subject, text), {})[str(path)] = None

    def refuse(self, path: Any, subject: str, text: str) -> None:
        """Add a problem that refuses the stage, whatever is left of it; arguments as of `problem`."""
        self.problem(path, subject, text)
        self._refused = True

    @contextlib.contextmanager
    def guard(self, where: Any) -> Iterator[None]:
        """Turn exceptions of USD and NumPy, as damaged values cause them, into a problem of a prim.

        Args:
            where: the prim, whose attributes of another type than its schema's are named, or a path.
        """
        path = where.GetPath() if isinstance(where, Usd.Prim) else where
        try:
            yield
        except TisceneError:
            raise
        except Tf.ErrorException as error:
            for line in error_lines(error):
                self.problem(path, "cannot be read", line)
        except (
            TypeError,
            ValueError,
            ArithmeticError,
            MemoryError,
            RuntimeError,
            AttributeError,
            LookupError,
        ) as error:
            mistyped = _mistyped(where) if isinstance(where, Usd.Prim) else ""
            text = mistyped or f"a value has another type or size than USD says ({one_line(error)})"
            self.problem(path, "cannot be read", text)

    def omission(self, path: Any, text: str, target: Any = None) -> None:
        """Add content that is left out or approximated. Prims with the same text share a line of the warning.

        Args:
            path: path of the prim.
            text: what is done to it instead.
            target: what a relationship or a connection at the path points to, if the text is about that.
        """
        if self._is_heard(path, text):
            return
        self._omissions.setdefault(text, {})[f"{path}" if target is None else f"{path}> to <{target}"] = None

    def omits(self, path: Any) -> bool:
        """Return whether there is an omission of a prim or of one below it."""
        return any(f"{each}/".startswith(f"{path}/") for paths in self._omissions.values() for each in paths)

    def frozen(self, path: Any, subject: str) -> None:
        """Add animation that is not played: the subject keeps its value at the time read."""
        if self.reads_animation:
            self.omission(path, f"{subject} has time samples, and is drawn as it is at the time read")

    def raise_refused(self) -> None:
        """Raise StageError if a problem refuses the stage."""
        if self._refused:
            raise StageError(self.stage, self._listed_problems())

    def raise_problems(self, anything_left: bool = False) -> None:
        """Raise StageError if there is a problem, unless something is left to render and the report is not strict.

        Args:
            anything_left: whether the stage can be rendered without its broken parts.
        """
        if self._problems and (self.strict or self._refused or not anything_left):
            raise StageError(self.stage, self._listed_problems(), self._advice(anything_left))

    def _advice(self, anything_left: bool) -> str:
        """Return how to go on after a refusal."""
        if self._refused:
            return ""
        if anything_left:
            return "strict reading refuses the stage for this; without it, the other parts are rendered"
        lines = ["Without these parts nothing is left to draw."]
        undrawn = [text for text in self._omissions if text.endswith(UNDRAWN)]
        if undrawn:
            lines.append(f"Of the rest, {'; '.join(undrawn)}.")
        if any(subject == COMPOSITION for subject, _ in self._problems):
            lines.append(
                "Put the missing files where the stage looks for them: relative paths begin at the folder of the file "
                "that names them. If a variant does not need them, choose it (variants=, --variant)."
            )
        if any(subject != COMPOSITION for subject, _ in self._problems):
            lines.append("Mend the prims named above in the program that wrote the stage.")
        return " ".join(lines)

    def warn(self, problems: bool = True) -> None:
        """Give one StageWarning that lists all problems and omissions, if any, at the line that called tiscene.

        Args:
            problems: whether to list the problems too.
        """
        lines = [f"  {problem}; left out" for problem in self._listed_problems()] if problems else []
        for text, paths in self._omissions.items():
            lines.append(f"  {text}: {_listed(list(paths), _MAX_PATHS)}")
        if lines:
            message = f"{self.stage} is not drawn quite as authored:\n" + "\n".join(lines)
            warnings.warn(StageWarning(message), stacklevel=outer_level())

    def _listed_problems(self) -> list[str]:
        """Return a line for each kind of problem, at most _MAX_PROBLEMS of them."""
        problems = []
        for (subject, text), paths in self._problems.items():
            first, *others = paths
            also = f"; also {_listed(others, _MAX_PATHS - 1)}" if others else ""
            problems.append(f"<{first}> {subject}: {text}{also}")
        if len(problems) > _MAX_PROBLEMS:
            problems = [*problems[:_MAX_PROBLEMS], f"... and {len(problems) - _MAX_PROBLEMS} more"]
        return problems
