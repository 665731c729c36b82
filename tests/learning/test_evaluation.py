# SPDX-License-Identifier: Apache-2.0
"""Evaluation of learners: order of predicting and learning, metrics, clock, scores."""

import functools
import json
import math
import operator
from pathlib import Path

import numpy as np
import pytest

from tests.learning.small_course import (
    BALL,
    CHAIR,
    SETTINGS,
    Constant,
    NearestAlbedo,
    Oracle,
    make_course,
)
from tiscene.errors import ArgumentError, MissingFile, ScenarioError, UnknownName
from tiscene.learning.clock import Clock
from tiscene.learning.course import Course
from tiscene.learning.drift import Drift, Step
from tiscene.learning.evaluation import evaluate, evaluate_all
from tiscene.learning.learner import make_learner
from tiscene.learning.phase import Phase
from tiscene.learning.pixel_counts import PixelCounts, selected_pixels
from tiscene.learning.results_page import write_page
from tiscene.learning.score import Score, differences
from tiscene.learning.stream_metrics import Adaptation, FocusAccuracy, NearFutureAccuracy, OnlineAccuracy
from tiscene.learning.supervision_rules import SupervisionRules
from tiscene.learning.teaching_policies import Asked, RandomPixels

ROOT = Path(__file__).parents[2]


def test_each_frame_is_predicted_before_it_is_learned(course):
    learner = Constant()
    evaluate(learner, course, [OnlineAccuracy()])
    tested = [("predict", k) for k in range(8)]
    taught = [(kind, k, *rest) for k in range(24) for kind, *rest in (("predict",), ("learn", 3))]
    expected = [*tested, *taught[:24], *tested, *taught[24:], *tested]
    assert learner.calls == [*expected, *(("predict", k) for k in range(24, 28))]


def test_learner_that_knows_everything_has_accuracy_one(course):
    seeing = make_course(observed=("semantic",))
    score = evaluate(Oracle(), seeing, [OnlineAccuracy(), OnlineAccuracy("frame"), FocusAccuracy()])
    assert repr(score) == f"<Score of {score.name}: {', '.join(score)}>"
    assert score["online"]["accuracy"] == score["online_frame"]["class_accuracy"] == score["focus"]["accuracy"] == 1.0
    assert score["tests"]["accuracy"]["R"] == [[1.0] * 3] * 3
    assert score["tests"]["accuracy"]["forgetting"] == 0.0
    assert score["tests"]["accuracy"]["held_out"] == 1.0


def test_learner_is_tested_without_learning(course):
    learner = Oracle()
    taught = make_course(observed=("semantic",), tests=[*course.phases[:2], *course.test_phases[2:]])
    score = evaluate(learner, taught.tests, [OnlineAccuracy()])
    assert score["online"]["by_phase"] == {"ball": 1.0, "chair": 1.0, "plant": 1.0}
    assert {call[0] for call in learner.calls} == {"predict"}
    assert score.labels["given"] == 0


def test_course_decides_which_pixels_count():
    whole = Course(
        [Phase("a", BALL, frames=3)],
        tests=[Phase("a", BALL, frames=1)],
        pixels="frame",
        **SETTINGS,
        observed=("depth",),
    )
    score = evaluate(Constant(), whole, [OnlineAccuracy(), OnlineAccuracy("objects")])
    counts = [(frame.semantic == 0).mean() for frame in whole.seek(0)]
    assert score["online"]["accuracy"] == pytest.approx(np.mean(counts))
    assert score["online_objects"]["accuracy"] == 0.0
    assert score["tests"]["pixels"] == "frame"
    assert Course.from_json(whole.to_json()).pixels == "frame"
    with pytest.raises(ArgumentError, match="pixels='all'"):
        Course([Phase("a", BALL, frames=3)], pixels="all")


def test_constant_learner_has_the_share_of_its_category(course):
    ball = next(number for number, name in course.categories.items() if name == "ball")
    score = evaluate(Constant(ball), course, [OnlineAccuracy("frame", window=6), OnlineAccuracy()])
    frames = [course[k] for k in range(28)]
    truth = np.array([(frame.semantic == ball).sum() for frame in frames])
    assert score["online_frame"]["accuracy"] == truth.sum() / (28 * 24 * 18)
    assert score["online_frame"]["curve"][1] == (6, truth[6:12].sum() / (6 * 24 * 18))
    assert score["online"]["by_phase"] == {"ball": 1.0, "chair": 0.0, "exam": 1.0}
    assert score["online"]["by_category"] == {"ball": 1.0, "chair": 0.0}
    assert score["tests"]["accuracy"]["R"] == [[1.0, 0.0, 0.0]] * 3


def test_prequential_accuracy_equals_rivers(course):
    metrics = pytest.importorskip("river.metrics")
    learner = NearestAlbedo()
    score = evaluate(learner, course, [OnlineAccuracy("moving")])
    theirs, per_class, again = metrics.Accuracy(), metrics.MacroRecall(), NearestAlbedo()
    from tiscene.learning.supervision import Supervision

    teacher = Supervision(course)
    for frame in course.seek(0):
        seen = course.observation(frame)
        selected = selected_pixels(frame, "moving")
        for truth, predicted in zip(frame.semantic[selected], again.predict(seen)[selected], strict=True):
            theirs.update(int(truth), int(predicted))
            per_class.update(int(truth), int(predicted))
        if frame.phase != "exam":
            again.learn(seen, [answer for _, answer in teacher.offers(frame)])
    assert score["online_moving"]["accuracy"] == pytest.approx(theirs.get(), abs=1e-12)
    assert 0.1 < theirs.get() < 1.0


def test_confusion_counts_equal_hand_counted():
    counts = PixelCounts(3)
    assert counts.add(np.array([0, 1, 1, 2, 2, 2]), np.array([0, 1, 2, 2, 7, -1])) == (3, 6)
    assert counts.matrix.tolist() == [[1, 0, 0, 0], [0, 1, 1, 0], [0, 0, 1, 2]]
    assert counts.accuracy() == 0.5
    assert counts.class_accuracy() == pytest.approx((1 + 1 / 2 + 1 / 3) / 3)
    again = PixelCounts(3)
    again.load(json.loads(json.dumps(counts.to_json())))
    assert (again.matrix == counts.matrix).all()
    assert PixelCounts(2).accuracy() is PixelCounts(2).class_accuracy() is None


def test_near_future_predicts_before_the_frames_between_are_learned(course):
    learner = Constant()
    score = evaluate(learner, make_course(), [OnlineAccuracy(), NearFutureAccuracy(gap=5, every=4)])
    calls = learner.calls
    start = calls.index(("learn", 8, 3))
    assert calls[start + 1] == ("predict", 13)
    assert score["near_future"]["gap"] == 5
    # Frames 5, 9, ... 25 are foreseen.
    assert [index for index, _ in score["near_future"]["curve"]] == [0, 25]


def test_adaptation_is_computed_by_its_definition():
    course = Course(
        [Phase("a", BALL, frames=40, drift=Drift("scenario", (BALL, CHAIR), Step(20)))], **SETTINGS, observed=("depth",)
    )
    metric = Adaptation(window=4, level=0.5)
    metric.begin(course)
    correct = [8] * 20 + [0] * 6 + [4] * 6 + [10] * 8
    metric.hits = [(index, hits, 10) for index, hits in enumerate(correct)]
    (row,) = metric.result()["events"]
    assert (row["frame"], row["change"]) == (20, "scenario")
    assert row["before"] == 0.8
    assert row["drop"] == 0.8
    assert row["recovery"] == 6  # frames 26 to 29 have 0.4, half of 0.8
    assert row["adaptation"] == 9  # frames 29 to 32 have 0.55, those before 0.4; half of the last 1.0 is 0.5
    metric.hits = [(index, 0, 10) for index in range(40)]
    assert metric.result()["events"][0]["recovery"] == 0


def test_course_without_drift_has_no_adaptation():
    course = Course([Phase("a", BALL, frames=2)], **SETTINGS, observed=("depth",))
    score = evaluate(Constant(), course)
    assert score["adaptation"] == {"pixels": "objects", "events": [], "mean_recovery": None, "recovered": 0}
    assert "tests" not in score


def test_clock_skips_frames_by_declared_cost(course):
    learner = Constant()
    score = evaluate(learner, course, [OnlineAccuracy()], clock=Clock(cost=2.5))
    learned = [call[1] for call in learner.calls if call[0] == "learn"]
    assert learned == [0, 3, 6, 9, 12, 15, 18, 21]
    assert score.clock == {"cost": 2.5, "skipped": 16}
    assert score.labels["given"] == 24
    busy = Clock(1.25)
    assert [busy.starts(k) for k in range(8)] == [True, False, True, False, True, False, True, False]
    with pytest.raises(ArgumentError, match="cost=-1"):
        Clock(-1)


def test_learner_asks_within_the_budget(course):
    class Curious(Constant):
        def ask(self, frame):
            return [(9, 12)]

    phases = [Phase("asked", BALL, frames=10, supervision=SupervisionRules(Asked(), budget=4))]
    learner = Curious()
    score = evaluate(learner, Course(phases, **SETTINGS, observed=("depth",)), [OnlineAccuracy()])
    assert [call[2] for call in learner.calls if call[0] == "learn"] == [1] * 4 + [0] * 6
    assert score.labels["given"] == 4
    assert score.labels["refused"] == {"budget": 6}


def test_delayed_labels_reach_the_learner_later():
    received = []

    class Waiting(Constant):
        def learn(self, frame, answers):
            received.append((frame.index, [answer.frame for answer in answers]))

    rules = SupervisionRules(RandomPixels(1), delay=2)
    course = Course([Phase("late", BALL, frames=5, supervision=rules)], **SETTINGS, observed=("depth",))
    evaluate(Waiting(), course, [OnlineAccuracy()])
    assert received == [(0, []), (1, []), (2, [0]), (3, [1]), (4, [2])]


def test_several_learners_share_frames_and_have_their_own_scores(course):
    rendered = []

    class Counted(Course):
        def _render(self, index):
            rendered.append(index)
            return super()._render(index)

    counted = Counted(course.phases, **SETTINGS, observed=("albedo",))
    first, second = evaluate_all({"a": Constant(), "b": NearestAlbedo()}, counted)
    assert sorted(rendered) == list(range(28))
    alone = evaluate(NearestAlbedo(), make_course(), name="b")
    assert second.scores["online"] == alone.scores["online"]
    assert first.scores["online"] != second.scores["online"]


def test_differences_name_what_differs(course, tmp_path):
    class Own(OnlineAccuracy):
        def result(self):
            return super().result() | {"counts": np.array([[1, 2]]), "count": np.int64(3)}

    score = evaluate(NearestAlbedo(), course, [Own()])
    score.save(tmp_path / "score.json")
    saved = Score.load(tmp_path / "score.json")
    assert differences(saved, score) == []
    assert (saved["online"]["counts"], saved["online"]["count"]) == ([[1, 2]], 3)
    saved["online"]["accuracy"] += 0.1
    saved.digests[3] = "0"
    lines = differences(saved, score)
    assert lines[0] == "frames: 1 of 28 differ, first 3"
    assert lines[1].startswith("scores.online.accuracy: ")
    (tmp_path / "other.json").write_text("{}")
    with pytest.raises(ArgumentError, match=r"other\.json: not a score"):
        Score.load(tmp_path / "other.json")
    with pytest.raises(MissingFile):
        Score.load(tmp_path / "none.json")


DAMAGES = (  # a place in a score, what is written there (nothing: it is deleted), and the message
    ("name", 3, "name=3: must be a text"),
    ("frames", None, "frames=None: must be an object"),
    ("frames.digests", (), "frames.digests: is missing"),
    ("frames.digests.1", 7, r"frames.digests\[1\]=7: must be a text"),
    ("labels.ledger", (), "labels.ledger: is missing"),
    ("labels.undelivered", 1.5, "labels.undelivered=1.5: must be a whole number"),
    ("clock.skipped", True, "clock.skipped=True: must be a whole number"),
    ("learner", "naive", "learner='naive': must be an object"),
    ("resources.wall_seconds.predict", [], r"resources.wall_seconds.predict=\[\]: must be a number"),
    ("scores.online.accuracy", "high", "scores.online.accuracy='high': must be a number or null"),
    ("scores.online.curve.0", [1], r"scores.online.curve\[0\]: must have 2 values"),
    ("scores.adaptation.events.0.frame", (), r"scores.adaptation.events\[0\].frame: is missing"),
    ("scores.tests", (), "scores.tests.tests: are not those of the course"),
    ("scores.tests.tests.0", "x", "scores.tests.tests: are not those of the course"),
    ("scores.tests.accuracy.R.1", [0.5], "scores.tests.accuracy.R: must be 3 rows of 3 tests"),
    ("scores.tests.rows", [], "scores.tests.accuracy.R: must be 0 rows of 3 tests"),
    ("course.phases", 3, "phases=3: must be a list"),
)


def test_damaged_scores_name_the_file_and_the_place(course, tmp_path):
    score = evaluate(Constant(), course, [OnlineAccuracy(), Adaptation(window=3)])
    file, text = tmp_path / "damaged.json", json.dumps(score.to_json())
    file.write_text(text[:-9])
    with pytest.raises(ScenarioError, match=r"damaged\.json: line 1, column \d+: not JSON"):
        Score.load(file)
    for place, value, message in DAMAGES:
        content = json.loads(text)
        *parents, last = [int(part) if part.isdecimal() else part for part in place.split(".")]
        inner = functools.reduce(operator.getitem, parents, content)
        if value == ():
            del inner[last]
        else:
            inner[last] = value
        file.write_text(json.dumps(content))
        with pytest.raises(ArgumentError, match=rf"damaged\.json: {message}"):
            Score.load(file)


def test_scores_of_version_0_1_can_be_read(course, tmp_path):
    content = evaluate(Constant(), course, []).to_json()
    del content["labels"]["undelivered"]
    (tmp_path / "score.json").write_text(json.dumps(content))
    write_page(tmp_path / "page.html", "title", [Score.load(tmp_path / "score.json")])


def test_wrong_learners_are_refused(course):
    class Wrong(Constant):
        def predict(self, frame):
            return np.zeros((3, 3))

    with pytest.raises(ArgumentError, match=r"predict returned float64 \[3, 3\]; it must return category ids"):
        evaluate(Wrong(), course, [OnlineAccuracy()])
    for learner, message in ((Constant, "pass an instance"), (3, "it has to have predict and learn")):
        with pytest.raises(ArgumentError, match=message):
            evaluate(learner, course)
    with pytest.raises(ArgumentError, match="two metrics share a name"):
        evaluate(Constant(), course, [OnlineAccuracy(), OnlineAccuracy()])
    with pytest.raises(ArgumentError, match="give one learner"):
        evaluate_all({}, course)


def test_learners_are_made_by_name():
    made = make_learner("tests.learning.small_course:NearestAlbedo", {0: ""}, seed=3)
    assert made.seed == 3
    with pytest.raises(UnknownName, match="Did you mean 'naive'"):
        make_learner("naiv", {})
    with pytest.raises(ArgumentError, match="there is no module 'nowhere'"):
        make_learner("nowhere:Learner", {})
    with pytest.raises(ArgumentError, match="has no 'Learner'"):
        make_learner("json:Learner", {})
    with pytest.raises(ArgumentError, match="must take categories= and seed="):
        make_learner("tests.learning.small_course:Constant", {})
    for wrong, message in (({"name": 3}, "learner=3: must be a string"), ({"seed": "0"}, "seed='0': must be a whole")):
        with pytest.raises(ArgumentError, match=message):
            make_learner(**{"name": "naive", "categories": {}} | wrong)


def test_resources_are_measured(course):
    score = evaluate(NearestAlbedo(), course, [OnlineAccuracy()])
    assert score.resources["calls"] == {"predict": 28 + 3 * 8, "learn": 24}
    assert score.resources["peak_memory_bytes"] > 1e7
    assert score.resources["stored_bytes"] > 40 * 12
    assert not any(map(math.isnan, score.resources["wall_seconds"].values()))
