# SPDX-License-Identifier: Apache-2.0
"""What learners see of a course, and what an evaluation takes from them."""

import warnings
from pathlib import Path

import numpy as np
import pytest

from tests.learning.small_course import BALL, CHAIR, SETTINGS, Constant, make_course
from tiscene.errors import ArgumentError, ArgumentTypeError, ScenarioError
from tiscene.learning.adapters.course_frames import CourseFrames
from tiscene.learning.adapters.river_pairs import river_pairs
from tiscene.learning.course import Course
from tiscene.learning.evaluation import evaluate, evaluate_all
from tiscene.learning.held_out_tests import counterfactuals, held_out
from tiscene.learning.learner import make_learner
from tiscene.learning.phase import Phase
from tiscene.learning.results_page import write_page
from tiscene.learning.score import Score, differences
from tiscene.learning.stream_metrics import FocusAccuracy, NearFutureAccuracy, OnlineAccuracy
from tiscene.learning.supervision_rules import SupervisionRules
from tiscene.learning.teaching_policies import FollowMovingObjects, Policy, RandomPixels
from tiscene.scenario.objects import Object
from tiscene.scenario.scenario import Scenario
from tiscene.stream.stream import Stream


class Seeing(Constant):
    """Keeps the mean of each picture that it sees."""

    def predict(self, frame):
        self.calls.append(("predict", frame.index, frame.albedo.sum()))
        return np.zeros(frame.albedo.shape[:2], int)


class Editing(Seeing):
    """Edits its pictures, and returns one array again and again."""

    answer = np.zeros((18, 24), int)

    def predict(self, frame):
        super().predict(frame)
        frame.albedo[:] = 0
        self.answer[:] = len(self.calls) % 2
        return self.answer


def test_learner_that_edits_its_frames_changes_no_other_learner_digest_or_example():
    metrics = [OnlineAccuracy(), NearFutureAccuracy(gap=2, every=1)]
    alone, beside = Seeing(), Seeing()
    (first,) = evaluate_all({"alone": alone}, make_course(), metrics)
    editing, second = evaluate_all({"editing": Editing(), "beside": beside}, make_course(), metrics)
    assert beside.calls == alone.calls
    assert first.digests == second.digests == editing.digests
    assert {tuple(np.unique(each.prediction)) for each in editing.examples} == {(0,), (1,)}


def test_observation_tells_neither_materials_nor_rooms_nor_where_a_phase_begins():
    buffers = (*SETTINGS["buffers"], "material_coverage")
    settings = SETTINGS | {"buffers": buffers}
    phases = [Phase("a", BALL, frames=3), Phase("b", CHAIR, frames=2)]
    course = Course(phases, **settings, observed=("albedo",), fps=10)
    seen = [course.observation(frame) for frame in course]
    assert [frame.time for frame in seen] == [k / 10 for k in range(5)]
    assert course[3].time == 0.0
    for frame in seen:
        assert list(frame) == ["albedo"]
        assert (frame.materials, frame.room, frame._novelty, len(frame.objects)) == ({}, "", None, 0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        seen[0].albedo[:] = 0.0  # a learner may write to it
    shown = Course(phases, **settings, observed=("albedo", "material_coverage"), fps=10, boundaries="shown")
    frame = shown.observation(shown[3])
    assert (frame.time, frame.phase, frame.materials) == (0.0, "b", shown[3].materials)
    assert frame.materials


def test_labels_that_never_reach_the_learner_are_counted(tmp_path):
    phases = [Phase("late", BALL, frames=5, supervision=SupervisionRules(RandomPixels(1), delay=2))]
    score = evaluate(Constant(), Course(phases, **SETTINGS, observed=("depth",)), [OnlineAccuracy()])
    assert (score.labels["given"], score.labels["undelivered"]) == (5, 2)
    write_page(str(tmp_path / "page.html"), "title", [score])
    assert "5 (2 never arrived)" in (tmp_path / "page.html").read_text("utf-8")
    early = [Phase("late", BALL, frames=5, supervision=RandomPixels(1))]
    assert evaluate(Constant(), Course(early, **SETTINGS, observed=("depth",)), []).labels["undelivered"] == 0


def test_score_is_read_as_it_was_saved(course, tmp_path):
    score = evaluate(Constant(), course, [OnlineAccuracy()])
    score.save(tmp_path / "score.json")
    again = Score.load(tmp_path / "score.json")
    assert differences(score, again) == []
    assert again.to_json()["labels"] == score.to_json()["labels"]
    write_page(tmp_path / "page.html", "title", [score, again])


def test_test_without_pixels_that_count_is_named_and_left_out(tmp_path):
    phases = [Phase("ball", BALL, frames=2, supervision=RandomPixels(1))]
    tests = [Phase("ball", BALL, frames=1), Phase("nothing", Scenario("object_view"), frames=1)]
    with pytest.warns(UserWarning, match=r"test 'nothing': none of its frames shows pixels that count \(pixels='obj"):
        score = evaluate(Constant(1), Course(phases, tests=tests, **SETTINGS, observed=("depth",)), [])
    assert (score["tests"]["accuracy"]["R"], score["tests"]["accuracy"]["held_out"]) == ([[1.0, None]] * 2, None)
    score.save(tmp_path / "score.json")
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        write_page(tmp_path / "page.html", "title", [Score.load(tmp_path / "score.json")])


def test_pages_of_no_scores_or_of_different_courses_are_refused(course, tmp_path):
    score = evaluate(Constant(), course, [])
    without = evaluate(Constant(), Course(course.phases, **SETTINGS, observed=("albedo",)), [])
    with pytest.raises(ArgumentError, match="their courses differ in length or tests"):
        write_page(tmp_path / "page.html", "title", [score, without])
    turned = Course(course.phases[::-1], tests=course.test_phases, **SETTINGS, observed=("albedo",))
    with pytest.raises(ArgumentError, match="change at other frames; call them otherwise than 'learner'"):
        write_page(tmp_path / "page.html", "title", [score, evaluate(Constant(), turned, [])])
    for nothing in ([], score):
        with pytest.raises(ArgumentError, match="must be a list of one or more scores"):
            write_page(tmp_path / "page.html", "title", nothing)
    with pytest.raises(ArgumentError, match=r"title='\\udcff': must be a string .* without lone surrogates"):
        write_page(tmp_path / "page.html", "\udcff", [score])
    assert list(Path(tmp_path).iterdir()) == []


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"metrics": "online"}, "metrics: 'online' is not a metric"),
        ({"metrics": [OnlineAccuracy]}, "metrics: <class .* is not a metric"),
        ({"chekpoint": "x"}, "chekpoint: evaluate has no such argument; did you mean 'checkpoint'"),
        ({"clock": 2.5}, r"clock=2.5: must be a Clock, such as Clock\(cost=2.5\)"),
        ({"checkpoint": 3}, "checkpoint=3: must be the path of a file"),
        ({"checkpoint_every": "a"}, "checkpoint_every='a': must be a number"),
        ({"checkpoint_every": -1}, "checkpoint_every=-1: must not be negative"),
        ({"name": 3}, "name=3: must be a string"),
    ],
)
def test_wrong_arguments_of_evaluations_are_refused(course, options, message):
    with pytest.raises(ArgumentError, match=message):
        evaluate(Constant(), course, **options)


def test_what_is_no_course_or_no_mapping_of_learners_is_refused(course):
    stream = Stream("object_view", width=8, height=6)
    with pytest.raises(ArgumentTypeError, match=r"course=<Stream .* must be a Course"):
        evaluate(Constant(), stream)
    with pytest.raises(ArgumentTypeError, match="must be a Course"):
        next(river_pairs(stream))
    with pytest.raises(ArgumentTypeError, match="must be a Course"):
        CourseFrames(stream)
    scenario = Scenario("object_view", [Object(f"cube{k}", "Cube") for k in range(20)])
    with pytest.raises(ArgumentTypeError, match=r"^course=Scenario\(.{60,90}\.\.\.: must be a Course"):  # not all of it
        evaluate(Constant(), scenario)
    with pytest.raises(ArgumentTypeError, match="must be learners by name"):
        evaluate_all([Constant()], course)
    with pytest.raises(ArgumentTypeError, match=r"categories=.*: must be names by id"):
        make_learner("naive", ["a", "b"])
    with pytest.raises(ArgumentError, match=r"phases=Phase.*: must be a sequence of Phase"):
        held_out(course.phases[0], frames=2)
    with pytest.raises(ArgumentTypeError, match=r"illumination=-2.0: must be a list of values"):
        counterfactuals(course.phases, {"illumination": -2.0}, frames=2)


@pytest.mark.parametrize("asked", [None, (3, 4), [(1, 2, 3)], [(1.5, 2)]])
def test_wrong_questions_of_a_learner_are_refused(course, asked):
    class Asking(Constant):
        def ask(self, frame):
            return asked

    with pytest.raises(ArgumentTypeError, match="mine: ask"):
        evaluate(Asking(), course, [], name="mine")


@pytest.mark.parametrize("number", [-7, 10**6])
def test_predictions_of_ids_that_the_course_does_not_have_are_refused(course, number):
    last = len(course.categories) - 1
    with pytest.raises(ArgumentError, match=f"predict returned ids from {number} to .*; category ids are 0 to {last}"):
        evaluate(Constant(number), course, [])


def test_wrong_policies_of_an_evaluation_are_refused(course):
    class Wrong(Policy):
        def pixels(self, frame, moment):
            return None

    taught = Course([Phase("a", BALL, frames=1, supervision=Wrong())], **SETTINGS, observed=("depth",))
    with pytest.raises(ScenarioError, match="make Wrong a dataclass"):  # before a frame is rendered
        evaluate(Constant(), taught)
    assert FocusAccuracy().focus == FollowMovingObjects()
    with pytest.raises(ArgumentTypeError, match=r"Wrong.pixels=None"):
        evaluate(Constant(), course, [FocusAccuracy(Wrong())])
