# SPDX-License-Identifier: Apache-2.0
"""Evaluation of learners: order of predicting and learning, metrics, clock, checkpoints, scores."""

import json
import math
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from dynamics import CatmullWaypoints, Waypoint
from tiscene.errors import ArgumentError, MissingFile, UnknownName
from tiscene.learning.clock import Clock
from tiscene.learning.course import Course
from tiscene.learning.drift import Drift, Step
from tiscene.learning.evaluation import evaluate, evaluate_all
from tiscene.learning.learner import make_learner
from tiscene.learning.phase import Phase
from tiscene.learning.pixel_counts import PixelCounts, selected_pixels
from tiscene.learning.score import differences, read_score
from tiscene.learning.stream_metrics import Adaptation, FocusAccuracy, NearFutureAccuracy, OnlineAccuracy
from tiscene.learning.supervision import SupervisionRules
from tiscene.learning.teaching_policies import Asked, Combined, OnePixelPerMovingObject, RandomPixels
from tiscene.scenario.objects import Object
from tiscene.scenario.scenario import Scenario

ROOT = Path(__file__).parents[2]
SETTINGS = {"width": 24, "height": 18, "buffers": ("semantic", "instance", "part", "depth", "albedo")}


def scenario(template):
    path = [Waypoint((-0.6, 0.9, -2)), Waypoint((0.6, 1.2, -2)), Waypoint((0, 0.6, -2.4))]
    return Scenario("object_view", [Object("mover", template, dynamic=CatmullWaypoints(path, total_time=1.0))])


TAUGHT = SupervisionRules(Combined([OnePixelPerMovingObject(), RandomPixels(2)]))
BALL, CHAIR = scenario("Ball 01"), scenario("Chair 01")


def make_course(**others):
    return Course(
        [
            Phase("ball", BALL, frames=12, supervision=TAUGHT),
            Phase("chair", CHAIR, frames=12, supervision=TAUGHT),
            Phase("exam", BALL, frames=4, evaluate=True, supervision=TAUGHT),
        ],
        tests=[
            Phase("ball", BALL, frames=3, start=13),
            Phase("chair", CHAIR, frames=3, start=13),
            Phase("plant", scenario("Plant 01"), frames=2),
        ],
        **(SETTINGS | {"observed": ("albedo",)} | others),
    )


@pytest.fixture(scope="module")
def course():
    return make_course()


class Constant:
    """Predicts one category, and records its calls."""

    def __init__(self, number=0):
        self.number, self.calls = number, []

    def predict(self, frame):
        self.calls.append(("predict", frame.index))
        return np.full(frame[next(iter(frame))].shape[:2], self.number)

    def learn(self, frame, answers):
        self.calls.append(("learn", frame.index, len(answers)))


class Oracle(Constant):
    """Reads the labels, which it may observe."""

    def predict(self, frame):
        super().predict(frame)
        return frame.semantic


class NearestAlbedo:
    """Predicts the category whose last labels have the nearest albedo; deterministic."""

    def __init__(self, categories=None, seed=0):
        self.seed, self.known = seed, []

    def predict(self, frame):
        colors = frame.albedo.reshape(-1, 3)
        if not self.known:
            return np.zeros(frame.albedo.shape[:2], int)
        known = np.array([color for color, _ in self.known])
        nearest = np.argmin(np.square(colors[:, None] - known).sum(axis=2), axis=1)
        return np.array([number for _, number in self.known])[nearest].reshape(frame.albedo.shape[:2])

    def learn(self, frame, answers):
        self.known = [*self.known, *((frame.albedo[each.pixel], each.category_id) for each in answers)][-40:]

    def state_dict(self):
        return {"known": self.known}

    def load_state_dict(self, state):
        self.known = state["known"]


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


@pytest.mark.slow
def test_score_is_recomputed_by_another_process_from_a_checkpoint(tmp_path):
    """Half of the course here, the rest in another process: the same score as without interruption."""
    whole = evaluate(NearestAlbedo(), make_course())
    make_course().save(tmp_path / "course.json")
    program = """
import sys
sys.path.insert(0, {root!r})
from tests.learning.test_evaluation import NearestAlbedo
from tiscene.learning.course import Course
from tiscene.learning.evaluation import evaluate
class Stopping(NearestAlbedo):
    def learn(self, frame, answers):
        super().learn(frame, answers)
        if frame.index == 17:
            raise KeyboardInterrupt
try:
    evaluate(Stopping(), Course.load({course!r}), checkpoint={file!r})
except KeyboardInterrupt:
    print("stopped")
"""
    names = {"root": str(ROOT), "course": str(tmp_path / "course.json"), "file": str(tmp_path / "state")}
    done = subprocess.run([sys.executable, "-c", program.format(**names)], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "stopped"
    learned = []

    class Continuing(NearestAlbedo):
        def learn(self, frame, answers):
            learned.append(frame.index)
            super().learn(frame, answers)

    resumed = evaluate(Continuing(), make_course(), checkpoint=tmp_path / "state")
    assert learned == list(range(12, 24))  # from the end of the first phase on
    assert not (tmp_path / "state").exists()
    first, second = whole.to_json(), resumed.to_json()
    first["learner"] = second["learner"] = {}
    assert differences(first, second) == []
    assert first["labels"] == second["labels"]


def test_differences_name_what_differs(course, tmp_path):
    score = evaluate(NearestAlbedo(), course, [OnlineAccuracy()])
    score.save(tmp_path / "score.json")
    saved = read_score(tmp_path / "score.json")
    assert differences(saved, json.loads(json.dumps(score.to_json()))) == []
    saved["scores"]["online"]["accuracy"] += 0.1
    saved["frames"]["digests"][3] = "0"
    lines = differences(saved, score.to_json())
    assert lines[0] == "frames: 1 of 28 differ, first 3"
    assert lines[1].startswith("scores.online.accuracy: ")
    (tmp_path / "other.json").write_text("{}")
    with pytest.raises(ArgumentError, match=r"other\.json: not a score"):
        read_score(tmp_path / "other.json")
    with pytest.raises(MissingFile):
        read_score(tmp_path / "none.json")


def test_evaluation_interrupted_in_its_first_frames_continues_without_testing_again(course, tmp_path):
    def run(stop_at, **others):
        def progress(text, done, total):
            seen.append(text)
            if text.startswith("phase") and done == stop_at:
                raise KeyboardInterrupt

        seen, file = [], tmp_path / "state"
        try:
            evaluate(NearestAlbedo(), course, checkpoint=file, progress=progress, **others)
        except KeyboardInterrupt:
            assert file.exists()
        return seen

    assert run(2).count("tests after untrained") == 6 + 2
    assert run(4, checkpoint_every=0) == ["phase ball"] * 5
    assert run(None).count("phase ball") == 8
    assert not (tmp_path / "state").exists()


def test_checkpoints_of_others_are_refused(course, tmp_path):
    def untouched(*_):
        raise AssertionError("is refused before anything is predicted")

    with pytest.raises(ArgumentError, match="needs a learner with state_dict"):
        evaluate(Constant(), course, [OnlineAccuracy()], checkpoint=tmp_path / "a", progress=untouched)
    (tmp_path / "b").write_bytes(b"nothing")
    with pytest.raises(ArgumentError, match="cannot be read"):
        evaluate(NearestAlbedo(), course, checkpoint=tmp_path / "b")
    (tmp_path / "c").write_bytes(pickle.dumps({"version": 1, "course": "other", "runs": {}}))
    with pytest.raises(ArgumentError, match="of another course"):
        evaluate(NearestAlbedo(), course, checkpoint=tmp_path / "c")


def test_checkpoints_of_other_metrics_or_another_clock_are_refused(course, tmp_path):
    def stop(text, done, total):
        if done == 6:
            raise KeyboardInterrupt

    metrics, file = [OnlineAccuracy(), NearFutureAccuracy(2)], {"checkpoint": tmp_path / "state"}
    with pytest.raises(KeyboardInterrupt):
        evaluate(NearestAlbedo(), course, metrics, **file, progress=stop)
    for others, clock in ((metrics[:1], 0), (metrics[::-1], 0), ([metrics[0], NearFutureAccuracy(3)], 0), (metrics, 2)):
        with pytest.raises(ArgumentError, match="of other metrics or of another clock; delete it"):
            evaluate(NearestAlbedo(), course, others, clock=Clock(clock), **file)
    evaluate(NearestAlbedo(), course, metrics, **file)


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
    made = make_learner("tests.learning.test_evaluation:NearestAlbedo", {0: ""}, seed=3)
    assert made.seed == 3
    with pytest.raises(UnknownName, match="Did you mean 'naive'"):
        make_learner("naiv", {})
    with pytest.raises(ArgumentError, match="there is no module 'nowhere'"):
        make_learner("nowhere:Learner", {})
    with pytest.raises(ArgumentError, match="has no 'Learner'"):
        make_learner("json:Learner", {})
    with pytest.raises(ArgumentError, match="must take categories= and seed="):
        make_learner("tests.learning.test_evaluation:Constant", {})


def test_resources_are_measured(course):
    score = evaluate(NearestAlbedo(), course, [OnlineAccuracy()])
    assert score.resources["calls"] == {"predict": 28 + 3 * 8, "learn": 24}
    assert score.resources["peak_memory_bytes"] > 1e7
    assert score.resources["stored_bytes"] > 40 * 12
    assert not any(map(math.isnan, score.resources["wall_seconds"].values()))
