# SPDX-License-Identifier: Apache-2.0
"""`tiscene evaluate`: evaluate learners on a course, or verify a saved score."""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from tiscene.cli.terminal import note, progress, total_shown
from tiscene.errors import ArgumentError, counted, export_errors
from tiscene.learning.clock import Clock
from tiscene.learning.course import Course
from tiscene.learning.evaluation import evaluate_all
from tiscene.learning.learner import BASELINES, Learner, make_learner
from tiscene.learning.results_page import write_page
from tiscene.learning.score import Score, differences
from tiscene.learning.suite_names import load_course


def run(args: argparse.Namespace) -> None:
    """Evaluate, write a score per run and a page, and print the page. With --verify, compare with a saved score."""
    if args.verify:
        verify(args.course)
        return
    names = list(BASELINES) if args.learner == ["all"] else args.learner or ["naive"]
    seeds = range(args.seeds)
    if not seeds:
        raise ArgumentError(f"--seeds {args.seeds}: must be at least 1")
    course = load_course(args.course)
    learners = make_learners(course, names, list(seeds))
    folder = Path(args.output or f"tiscene-evaluation-{Path(args.course).stem}")
    with export_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
    checkpoint = folder / "checkpoint.pickle" if args.checkpoint else None
    page = folder / "index.html"
    try:
        scores = evaluated(course, learners, args.cost, checkpoint)
        for score in scores:
            score.save(folder / f"{_file_name(score.name)}-seed{score.learner['seed']}.json")
        write_page(page, f"{', '.join(names)} on {args.course}", scores)
    except KeyboardInterrupt:
        note(_how_to_continue(checkpoint))
        raise
    if checkpoint is not None:
        checkpoint.unlink(missing_ok=True)
    print(page)


def make_learners(course: Course, names: Sequence[str], seeds: Sequence[int]) -> dict[tuple[str, int], Learner]:
    """Make the learners of a course, by name and seed."""
    return {(name, seed): make_learner(name, course.categories, seed) for name in names for seed in seeds}


def evaluated(
    course: Course, learners: Mapping[tuple[str, int], Learner], cost: float = 0.0, checkpoint: Path | None = None
) -> list[Score]:
    """Evaluate learners on one course, all at once."""
    keys = {f"{name}, seed {seed}": (name, seed) for name, seed in learners}
    described = {key: {"learner": name, "seed": seed, "options": {}} for key, (name, seed) in keys.items()}
    with progress("reading scenes", len(course)) as step:
        show = total_shown(step)
        scores = evaluate_all(
            {key: learners[of] for key, of in keys.items()},
            course,
            clock=Clock(cost),
            checkpoint=checkpoint,
            keep_checkpoint=True,
            progress=lambda text, done, total: show(done, text),
            described=described,
        )
    return [replace(score, name=str(score.learner["learner"])) for score in scores]


def verify(path: str) -> None:
    """Compute a saved score again, and print in what it differs.

    Raises:
        ArgumentError: it differs.
    """
    saved = Score.load(path)
    learner = saved.learner
    if not {"learner", "seed"} <= learner.keys():
        raise ArgumentError(
            f"{path}: does not say how its learner is made; only scores of this command can be verified"
        )
    learners = make_learners(saved.course, [learner["learner"]], [learner["seed"]])
    (score,) = evaluated(saved.course, learners, saved.clock["cost"])
    if found := differences(saved, score):
        shown = "\n".join(f"  {line}" for line in found[:20])
        raise ArgumentError(f"{path}: {counted(len(found), 'difference')} between the file and this run:\n{shown}")
    note(f"{counted(len(score.digests), 'frame')}, all labels and all scores are equal.")
    print(path)


def _how_to_continue(checkpoint: Path | None) -> str:
    """Return what the user of an interrupted evaluation has to know."""
    if checkpoint is None:
        return "Interrupted: nothing was saved. With --checkpoint, the same command would continue."
    if not checkpoint.exists():
        return "Interrupted before the first checkpoint. The same command starts again."
    return f"Interrupted: {checkpoint} has the state. The same command continues from there."


def _file_name(name: str) -> str:
    return re.sub(r"[^\w.-]+", "_", name)
