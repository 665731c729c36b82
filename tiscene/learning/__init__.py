# SPDX-License-Identifier: Apache-2.0
"""Continual learning on streams: supervision of pixels, courses of phases, drift, and evaluation.

::

    pixel_labels       labels of single pixels, with one ray each
    teaching_policies  which pixels a teacher labels unasked
    label_ledger       labels that were given
    answers            what a teacher says to a question
    supervision_rules  SupervisionRules: what a teacher may say
    supervision        Supervision: a teacher with a budget
    laps               laps of closed paths
    drift              factors that change with the frame number: Step, Ramp, Mix, Cycle
    phase              Phase: a part of a course, and its frames
    course             Course: phases one after another
    course_file        courses as JSON
    stream_pool        streams of several scenarios that share stages
    learner            interface of learners, and learners by name
    clock              Clock: a stream that does not wait
    learner_run        one learner on its way through a course
    evaluation         evaluate: predict, then learn, and tests between the phases
    stream_metrics     accuracy while a learner learns: online, near future, focus of attention, adaptation
    accuracy_matrix    ACC, BWT, FWT and forgetting
    task_matrix        counts of tests after each phase
    pixel_counts       confusion matrices of pixels
    resource_usage     time and memory
    held_out_tests     held-out tests, and tests with one factor changed
    adapters           courses for Avalanche, river and Gymnasium
    baselines          learners to compare with
    results_page       results as an HTML page
    svg_chart          line charts of the page
    suite_names        benchmark suites by name
    score              Score: results, and how to compute them again
"""

from __future__ import annotations

from typing import Any

from dynamics.lazy_names import import_name

_NAMES = {
    "answers": ("Answer", "Pending", "Refused"),
    "accuracy_matrix": ("average_accuracy", "backward_transfer", "forgetting", "forward_transfer"),
    "clock": ("Clock",),
    "held_out_tests": ("counterfactuals", "held_out"),
    "course": ("Course",),
    "drift": ("Cycle", "Drift", "Mix", "Ramp", "Schedule", "Step"),
    "evaluation": ("evaluate", "evaluate_all"),
    "laps": ("lap_times",),
    "learner": ("Learner", "make_learner"),
    "phase": ("CourseFrame", "Phase"),
    "results_page": ("write_page",),
    "score": ("Score", "differences", "read_score"),
    "stream_metrics": ("Adaptation", "FocusAccuracy", "Metric", "NearFutureAccuracy", "OnlineAccuracy"),
    "suite_names": ("load_course", "suites"),
    "supervision": ("Supervision",),
    "supervision_rules": ("SupervisionRules",),
    "teaching_policies": (
        *("Asked", "Combined", "Everything", "FirstFrames", "FocusOfAttention", "FollowMovingObjects", "LastFrames"),
        *("Moment", "OnePixelPerMovingObject", "Policy", "RandomPixels", "Recorded"),
    ),
}
_MODULES = {name: f"{__name__}.{module}" for module, names in _NAMES.items() for name in names}
__all__ = sorted(_MODULES)  # imported at first use


def __getattr__(name: str) -> Any:
    return import_name(__name__, _MODULES, name)


def __dir__() -> list[str]:
    return __all__
