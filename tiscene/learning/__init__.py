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
    score_layout       what the JSON file of a score has
"""

from __future__ import annotations

from dynamics.lazy_names import lazy_names

_MODULES = {
    "tiscene.learning.answers": ("Answer", "Pending", "Refused"),
    "tiscene.learning.accuracy_matrix": ("average_accuracy", "backward_transfer", "forgetting", "forward_transfer"),
    "tiscene.learning.clock": ("Clock",),
    "tiscene.learning.held_out_tests": ("counterfactuals", "held_out"),
    "tiscene.learning.course": ("Course",),
    "tiscene.learning.drift": ("Cycle", "Drift", "Mix", "Ramp", "Schedule", "Step"),
    "tiscene.learning.evaluation": ("evaluate", "evaluate_all"),
    "tiscene.learning.laps": ("lap_times",),
    "tiscene.learning.learner": ("Learner", "make_learner"),
    "tiscene.learning.phase": ("CourseFrame", "Phase"),
    "tiscene.learning.results_page": ("write_page",),
    "tiscene.learning.score": ("Score", "differences"),
    "tiscene.learning.stream_metrics": (
        "Adaptation",
        "FocusAccuracy",
        "Metric",
        "NearFutureAccuracy",
        "OnlineAccuracy",
    ),
    "tiscene.learning.suite_names": ("load_course", "suites"),
    "tiscene.learning.supervision": ("Supervision",),
    "tiscene.learning.supervision_rules": ("SupervisionRules",),
    "tiscene.learning.teaching_policies": (
        *("Asked", "Combined", "Everything", "FirstFrames", "FocusOfAttention", "FollowMovingObjects", "LastFrames"),
        *("Moment", "OnePixelPerMovingObject", "Policy", "RandomPixels", "Recorded"),
    ),
}
__getattr__, __dir__, __all__ = lazy_names(__name__, _MODULES)
