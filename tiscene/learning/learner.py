# SPDX-License-Identifier: Apache-2.0
"""Learner: what an evaluation asks of a learner; and learners by name."""

from __future__ import annotations

import importlib
import inspect
import os
import sys
from collections.abc import Mapping, Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from dynamics import argument_checks
from tiscene.errors import ArgumentError, ArgumentTypeError, UnknownName
from tiscene.learning.answers import Answer
from tiscene.learning.phase import CourseFrame

# Names of the shipped baselines, and where they are.
BASELINES = {
    "blind": "tiscene.learning.baselines.blind:Blind",
    "ewc": "tiscene.learning.baselines.ewc:ElasticWeightConsolidation",
    "flow": "tiscene.learning.baselines.flow_coherence:FlowCoherence",
    "lwf": "tiscene.learning.baselines.lwf:LearningWithoutForgetting",
    "naive": "tiscene.learning.baselines.naive:Naive",
    "ncm": "tiscene.learning.baselines.nearest_mean:NearestMean",
    "replay": "tiscene.learning.baselines.replay:Replay",
    "shuffled": "tiscene.learning.baselines.shuffled:Shuffled",
    "si": "tiscene.learning.baselines.si:SynapticIntelligence",
}


@runtime_checkable
class Learner(Protocol):
    """A learner of pixel categories.

    It may have more methods, which are called if they exist:

    - `ask(frame)` returns pixels (row, column) whose label it wants; the teacher answers within its budget.
    - `state_dict()` and `load_state_dict(state)`, for checkpoints.
    - `stored_bytes()` returns the memory that it keeps beside its parameters, such as a replay buffer.
    - `end_of_phase()` is called after each phase, if the learner has `sees_phases = True` or the boundaries are shown.
    """

    def predict(self, frame: CourseFrame) -> NDArray[np.integer[Any]]:
        """Return the category id of each pixel of an observation: integers [height, width]."""
        ...

    def learn(self, frame: CourseFrame, answers: Sequence[Answer]) -> None:
        """Learn from an observation and from the labels that have arrived; there may be none.

        Delayed labels are of earlier frames; `answer.frame` is their index.
        """
        ...


def make_learner(name: str, categories: Mapping[int, str], seed: int = 0, **options: Any) -> Learner:
    """Make a learner by name.

    Args:
        name: a baseline, such as "replay", or "module:Class" of a class that takes `categories=` and `seed=`.
        categories: names by category id.
        seed: of the learner's random numbers.
        **options: further arguments of the class.

    Raises:
        UnknownName: there is no such baseline.
        ArgumentError: the module or the class cannot be imported or made.
    """
    if not isinstance(categories, Mapping):
        raise ArgumentTypeError(f"categories={categories!r}: must be names by id, as course.categories")
    argument_checks.text(name, "learner")
    argument_checks.whole(seed, "seed")
    if ":" not in name and name not in BASELINES:
        raise UnknownName("learner", name, BASELINES, hint="Your own: --learner module:Class.")
    module, _, attribute = BASELINES.get(name, name).partition(":")
    if os.getcwd() not in sys.path:  # a command of an installed package does not have it
        sys.path.insert(0, os.getcwd())
    try:
        make = getattr(importlib.import_module(module), attribute)
    except ModuleNotFoundError as error:
        if error.name != module:
            raise
        raise ArgumentError(f"learner {name!r}: there is no module {module!r}") from error
    except AttributeError as error:
        raise ArgumentError(f"learner {name!r}: {module!r} has no {attribute!r}") from error
    try:
        inspect.signature(make).bind(categories=categories, seed=seed, **options)
    except TypeError as error:
        raise ArgumentError(f"learner {name!r}: must take categories= and seed= and the options: {error}") from error
    return check_learner(make(categories=categories, seed=seed, **options), name)


def check_learner(value: Any, name: str = "learner") -> Learner:
    """Return `value`, a learner.

    Raises:
        ArgumentError: it lacks a method.
    """
    if isinstance(value, type) or not isinstance(value, Learner):
        hint = "pass an instance, not the class" if isinstance(value, type) else "it has to have predict and learn"
        raise ArgumentError(f"{name}: {argument_checks.brief(value)} is not a learner; {hint}")
    return value
