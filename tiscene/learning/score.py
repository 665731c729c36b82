# SPDX-License-Identifier: Apache-2.0
"""Score: the results of an evaluation, with all that is needed to compute them again."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import tiscene
from tiscene.errors import ArgumentError
from tiscene.learning.course import Course
from tiscene.learning.score_layout import check_score
from tiscene.learning.task_matrix import Example
from tiscene.scenario import serialization

FORMAT, VERSION = "tiscene.score", 1


@dataclass(frozen=True, eq=False, repr=False)
class Score(Mapping[str, Any]):
    """The results of one learner on one course: a mapping from a metric's name to its values.

    Attributes:
        name: name of the learner.
        learner: what makes it again: "learner" (a name or "module:Class"), "seed", "options".
        course: the course.
        scores: values by metric; "tests" has the accuracy matrix and what is made of it.
        labels: number of labels by phase, refusals, and the digest of the ledger.
        clock: the learner's cost in frames, and the frames that it missed.
        resources: time and memory. They depend on the machine; everything else does not.
        digests: of every frame's buffers.
        examples: frames of the tests after the last phase.
    """

    name: str
    learner: Mapping[str, Any]
    course: Course
    scores: Mapping[str, Any]
    labels: Mapping[str, Any]
    clock: Mapping[str, Any]
    resources: Mapping[str, Any]
    digests: Sequence[str]
    examples: Sequence[Example] = ()

    def __repr__(self) -> str:
        return f"<Score of {self.name}: {', '.join(self)}>"

    def __getitem__(self, name: str) -> Any:
        return self.scores[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.scores)

    def __len__(self) -> int:
        return len(self.scores)

    def to_json(self) -> dict[str, Any]:
        """Return everything but the examples as JSON values."""
        return {
            "format": FORMAT,
            "version": VERSION,
            "tiscene": tiscene.__version__,
            "name": self.name,
            "learner": _plain(self.learner),
            "course": self.course.to_json(),
            "categories": list(self.course.categories.values())[1:],
            "scores": _plain(self.scores),
            "labels": dict(self.labels),
            "clock": dict(self.clock),
            "resources": dict(self.resources),
            "frames": {
                "count": len(self.digests),
                "digest": hashlib.sha256("".join(self.digests).encode()).hexdigest(),
                "digests": list(self.digests),
            },
        }

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the score as a JSON file.

        Raises:
            ExportError: the file cannot be written.
        """
        serialization.write(path, self.to_json())

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Score:
        """Read a saved score. It has no examples.

        Raises:
            MissingFile: there is no such file.
            ArgumentError, ScenarioError: it is not a score of this version, or damaged; the message names the place.
        """

        def make(content: Any) -> Score:
            if not isinstance(content, Mapping) or (content.get("format"), content.get("version")) != (FORMAT, VERSION):
                raise ArgumentError(f'not a score: it should be an object with "format": "{FORMAT}", version {VERSION}')
            check_score(content)
            course = Course.from_json(content["course"])
            tests = content["scores"].get("tests", {"tests": []})["tests"]
            if tests != [phase.name for phase in course.test_phases]:
                raise ArgumentError("scores.tests.tests: are not those of the course; the file is damaged")
            parts = {name: content[name] for name in ("name", "learner", "scores", "labels", "clock", "resources")}
            return cls(**parts, course=course, digests=content["frames"]["digests"])

        return serialization.read(path, make)


def _plain(value: Any) -> Any:
    """Return a value with NumPy's arrays and numbers, such as a user's own metrics have, as JSON values."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return {name: _plain(each) for name, each in value.items()}
    return [_plain(each) for each in value] if isinstance(value, list | tuple) else value


def differences(first: Score, second: Score) -> list[str]:
    """Compare two scores in everything that does not depend on the machine.

    Returns:
        A line for each difference; none if the second recomputes the first.
    """
    found = []
    for name, one, other in (
        ("course", first.course.digest(), second.course.digest()),
        ("learner", _plain(first.learner), _plain(second.learner)),
        ("clock", first.clock, second.clock),
    ):
        if one != other:
            found.append(f"{name}: differs")
    digests = zip(first.digests, second.digests, strict=False)
    changed = [index for index, (one, other) in enumerate(digests) if one != other]
    if changed or len(first.digests) != len(second.digests):
        where = f", first {changed[0]}" if changed else ""
        found.append(f"frames: {len(changed)} of {len(first.digests)} differ{where}")
    if first.labels["ledger"] != second.labels["ledger"]:
        found.append("labels: the ledgers differ")
    return found + _different("scores", _plain(first.scores), _plain(second.scores))


def _different(path: str, first: Any, second: Any) -> list[str]:
    if isinstance(first, Mapping) and isinstance(second, Mapping):
        names = dict.fromkeys((*first, *second))
        return [line for name in names for line in _different(f"{path}.{name}", first.get(name), second.get(name))]
    if isinstance(first, list) and isinstance(second, list) and len(first) == len(second):
        pairs = enumerate(zip(first, second, strict=True))
        return [line for row, (a, b) in pairs for line in _different(f"{path}[{row}]", a, b)]
    return [] if first == second else [f"{path}: {first!r} and {second!r}"]
