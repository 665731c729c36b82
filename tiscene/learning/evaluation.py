# SPDX-License-Identifier: Apache-2.0
"""Evaluation of learners on a course: predict, then learn, frame by frame; tests between the phases.

Several learners take the same course at once, so that each frame is rendered once. A learner that is deterministic has
the same scores in every run, also if the evaluation is interrupted and continues from a checkpoint.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dynamics import argument_checks
from tiscene.errors import ArgumentError, ArgumentTypeError, export_errors
from tiscene.files import write_atomically
from tiscene.learning.clock import Clock
from tiscene.learning.course import Course, check_course
from tiscene.learning.learner import Learner
from tiscene.learning.learner_run import LearnerRun
from tiscene.learning.phase import CourseFrame
from tiscene.learning.pixel_counts import selected_pixels
from tiscene.learning.score import Score
from tiscene.learning.stream_metrics import Adaptation, FocusAccuracy, Metric, NearFutureAccuracy, OnlineAccuracy

VERSION = 1
MAGIC = b"tiscene evaluation\n"  # begin of a checkpoint
OPTIONS = ("name", "clock", "checkpoint", "checkpoint_every", "keep_checkpoint", "progress", "described")
Progress = Callable[[str, int, int], None]


def default_metrics() -> tuple[Metric, ...]:
    """Return the metrics of an evaluation for which none are given."""
    return OnlineAccuracy(), OnlineAccuracy("frame"), NearFutureAccuracy(), FocusAccuracy(), Adaptation()


def evaluate(learner: Learner, course: Course, metrics: Iterable[Metric] | None = None, **options: Any) -> Score:
    """Evaluate a learner on a course.

    Args:
        learner: has `predict(frame)`, which returns a map of category ids, and `learn(frame, answers)`.
        course: phases, in which it learns, and tests.
        metrics: None: online accuracy of objects and of whole frames, near-future accuracy, accuracy at a focus of
            attention, adaptation to drift.
        **options: name (of the learner), and clock (a Clock), checkpoint (a file), checkpoint_every (s),
            keep_checkpoint, progress and described, as of `evaluate_all`.

    Returns:
        All scores, and what is needed to compute them again.

    Raises:
        ArgumentError: an argument is invalid, or a prediction has the wrong shape or type.
    """
    argument_checks.known_names(options, OPTIONS, "evaluate")
    return evaluate_all({options.pop("name", "learner"): learner}, course, metrics, **options)[0]


def evaluate_all(
    learners: Mapping[str, Learner],
    course: Course,
    metrics: Iterable[Metric] | None = None,
    *,
    clock: Clock | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    checkpoint_every: float = 30.0,
    keep_checkpoint: bool = False,
    progress: Progress | None = None,
    described: Mapping[str, Mapping[str, Any]] | None = None,
) -> list[Score]:
    """Evaluate several learners on one course, frame by frame.

    Args:
        learners: by name.
        course: phases, in which they learn, and tests.
        metrics: None: `default_metrics()`.
        clock: how many frames learning from one takes; None: the stream waits.
        checkpoint: file to write the state of the evaluation to, and to continue from if it exists. The learners need
            `state_dict` and `load_state_dict`. It is written after the tests, and between them after
            `checkpoint_every`. Such a file is a pickle: do not open one from a source that you do not trust. It is
            deleted at the end.
        checkpoint_every: time between checkpoints, s.
        keep_checkpoint: keep it at the end, until the scores are written; the same call then returns them at once.
        progress: called with a text, the number of frames that are done, and of all.
        described: of each learner, what makes it again ("learner", "seed", "options"), for the score.

    Returns:
        One score per learner, in their order.

    Raises:
        ArgumentError: an argument is invalid, or a prediction has the wrong shape or type.
        ScenarioError: the course cannot be written to a file, such as one with a policy that is no dataclass.
    """
    check_course(course).digest()  # one that cannot be written fails now, not when the score is saved
    if not isinstance(learners, Mapping):
        raise ArgumentTypeError(f"learners={learners!r}: must be learners by name, such as {{'mine': learner}}")
    chosen = default_metrics() if metrics is None else _check_metrics(metrics)
    if not isinstance(clock, Clock | None):
        raise ArgumentTypeError(f"clock={clock!r}: must be a Clock, such as Clock(cost=2.5)")
    if not isinstance(checkpoint, str | os.PathLike | None):
        raise ArgumentTypeError(f"checkpoint={checkpoint!r}: must be the path of a file")
    argument_checks.not_negative(checkpoint_every, "checkpoint_every")
    runs = [LearnerRun(name, learner, course, chosen, clock or Clock()) for name, learner in learners.items()]
    if not runs:
        raise ArgumentError("learners={}: give one learner or more")
    return _Evaluation(runs, course, progress, dict(described or {})).run(
        None if checkpoint is None else Path(checkpoint), checkpoint_every, keep_checkpoint
    )


class _Evaluation:
    """Several runs through one course, which share its frames."""

    def __init__(
        self, runs: Sequence[LearnerRun], course: Course, progress: Progress | None, described: dict[str, Any]
    ) -> None:
        self.runs, self.course, self.described = runs, course, described
        self.tests = course.tests
        self.progress = progress or (lambda *_: None)
        self.next_frame = 0
        self.digests: list[str] = []
        self._kept: dict[int, CourseFrame] = {}  # frames that were rendered ahead
        self._tested = False

    def run(self, path: Path | None, every: float, keep: bool) -> list[Score]:
        if path is not None:
            for run in self.runs:
                if not hasattr(run.learner, "state_dict") or not hasattr(run.learner, "load_state_dict"):
                    raise ArgumentError(f"{run.name}: a checkpoint needs a learner with state_dict and load_state_dict")
            if path.exists():
                self._load(path)
        total = len(self.course)
        saved = time.monotonic()  # when the last checkpoint was written
        if not self._tested:
            self._test(0)
            if path is not None:
                saved = self._save(path)
        for index in range(self.next_frame, total):
            number, _ = self.course.phase_at(index)
            self.progress(f"phase {self.course.phases[number].name}", index, total)
            self._step(index)
            self.next_frame = index + 1
            if ends := self.next_frame == self.course.starts[number + 1]:
                self._end_phase(number)
            if path is not None and (ends or time.monotonic() >= saved + every):
                saved = self._save(path)
        self.progress("done", total, total)
        scores = [self._score(run) for run in self.runs]
        if path is not None and not keep:
            path.unlink(missing_ok=True)
        return scores

    def _frame(self, index: int) -> CourseFrame:
        if index not in self._kept:
            self._kept[index] = self.course[index]
        return self._kept[index]

    def _step(self, index: int) -> None:
        frame = self._frame(index)
        self.digests.append(_digest(frame))
        for run in self.runs:
            run.step(frame)
        ahead = {(each.gap, each.every) for each in self.runs[0].metrics if each.gap}
        for gap, every in sorted(ahead):
            if index % every == 0 and index + gap < len(self.course):
                future = self._frame(index + gap)
                for run in self.runs:
                    for metric in run.metrics:
                        if (metric.gap, metric.every) == (gap, every):
                            run.foresee(metric, future)
        del self._kept[index]

    def _end_phase(self, number: int) -> None:
        if not self.course.phases[number].evaluate:
            for run in self.runs:
                run.end_phase()
            self._test(number + 1)

    def _test(self, row: int) -> None:
        """Test all runs on all tests; row 0 is before the first phase."""
        self._tested = True
        if self.tests is None:
            return
        name = "untrained" if row == 0 else self.course.phases[row - 1].name
        for run in self.runs:
            run.matrix.begin_row(row, name)
        for frame in self.tests.seek(0):
            self.progress(f"tests after {name}", self.next_frame, len(self.course))
            selected = selected_pixels(frame, run.matrix.pixels)
            for run in self.runs:
                run.matrix.add(frame, run.predict(self.tests.observation(frame)), selected)
        if row == 0:
            self.runs[0].matrix.warn_of_empty_tests()

    def _save(self, path: Path) -> float:
        """Write a checkpoint, and return the time, in seconds of `time.monotonic`."""
        state = {
            "version": VERSION,
            "course": self.course.digest(),
            "next_frame": self.next_frame,
            "digests": self.digests,
            "runs": {run.name: run.state_dict() for run in self.runs},
        }
        with export_errors(path):
            write_atomically(path, MAGIC + pickle.dumps(state))
        return time.monotonic()

    def _load(self, path: Path) -> None:
        if path.is_dir():
            raise ArgumentError(f"checkpoint {str(path)!r}: is a folder; name a file")
        content = path.read_bytes()
        if not content.startswith(MAGIC):  # a file of the user is neither unpickled nor overwritten
            raise ArgumentError(f"checkpoint {str(path)!r}: is not a checkpoint of an evaluation; name another file")
        try:
            state = pickle.loads(content[len(MAGIC) :])
            is_state = state["version"] == VERSION
        except Exception as error:  # a damaged pickle raises anything
            raise ArgumentError(f"checkpoint {str(path)!r}: cannot be read ({error}); delete it") from error
        if (
            not is_state
            or state["course"] != self.course.digest()
            or list(state["runs"]) != [r.name for r in self.runs]
        ):
            raise ArgumentError(f"checkpoint {str(path)!r}: is of another course or of other learners; delete it")
        if any(state["runs"][run.name].get("options") != run.options for run in self.runs):
            raise ArgumentError(f"checkpoint {str(path)!r}: is of other metrics or of another clock; delete it")
        for run in self.runs:
            run.load_state_dict(state["runs"][run.name])
        self.next_frame, self.digests, self._tested = state["next_frame"], state["digests"], True

    def _score(self, run: LearnerRun) -> Score:
        ledger = run.teacher.ledger
        by_phase: dict[str, int] = {}
        for row in ledger:
            phase = self.course.phases[self.course.phase_at(row.asked)[0]].name
            by_phase[phase] = by_phase.get(phase, 0) + 1
        scores: dict[str, Any] = {metric.name: metric.result() for metric in run.metrics}
        if self.tests is not None:
            scores["tests"] = run.matrix.result()
        labels = {
            "given": len(ledger),
            "undelivered": run.undelivered,
            "by_phase": by_phase,
            "refused": dict(run.teacher.refused),
            "ledger": ledger.digest(),
        }
        made = {"learner": f"{type(run.learner).__module__}:{type(run.learner).__qualname__}"}
        return Score(
            name=run.name,
            learner=dict(self.described.get(run.name, made)),
            course=self.course,
            scores=scores,
            labels=labels,
            clock={"cost": float(run.clock.cost), "skipped": run.clock.skipped},
            resources=run.usage.result(run.learner),
            digests=list(self.digests),
            examples=run.matrix.examples,
        )


def _check_metrics(metrics: Any) -> tuple[Metric, ...]:
    chosen = tuple(metrics) if isinstance(metrics, Iterable) and not isinstance(metrics, str) else (metrics,)
    for each in chosen:
        if not isinstance(each, Metric):
            raise ArgumentTypeError(f"metrics: {each!r} is not a metric; pass a list such as [OnlineAccuracy()]")
    return chosen


def _digest(frame: CourseFrame) -> str:
    """Return the first half of the SHA-256 of a frame's buffers."""
    digest = hashlib.sha256()
    for name in sorted(frame):
        digest.update(name.encode())
        digest.update(np.ascontiguousarray(frame[name]).tobytes())
    return digest.hexdigest()[:32]
