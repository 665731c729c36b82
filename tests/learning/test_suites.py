# SPDX-License-Identifier: Apache-2.0
"""Shipped suites, tests with one factor changed, the results page, and `tiscene evaluate`."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from dynamics import AllTogether, CatmullWaypoints, Waypoint
from tests.learning.small_course import scenario
from tiscene.cli.main import main
from tiscene.errors import ArgumentError, ExportError, UnknownName
from tiscene.learning.course import Course
from tiscene.learning.drift import Drift, Step
from tiscene.learning.evaluation import evaluate_all
from tiscene.learning.held_out_tests import counterfactuals, held_out
from tiscene.learning.phase import Phase
from tiscene.learning.results_page import mean_and_deviation, mean_and_range, percent, write_page
from tiscene.learning.results_page import test_curve as accuracy_of_test
from tiscene.learning.score import Score
from tiscene.learning.suite_names import load_course, suites
from tiscene.learning.svg_chart import line_chart, line_styles
from tiscene.learning.teaching_policies import OnePixelPerMovingObject
from tiscene.scenario.objects import Object
from tiscene.scenario.scenario import Scenario

ROOT = Path(__file__).parents[2]
PATH = [Waypoint((-0.6, 0.9, -2)), Waypoint((0.6, 1.2, -2)), Waypoint((0, 0.6, -2.4))]
BALL = Scenario("object_view", [Object("ball", "Ball 01", dynamic=CatmullWaypoints(PATH, total_time=1.0))])
SETTINGS = {"width": 24, "height": 18, "buffers": ("semantic", "instance", "part", "depth"), "observed": ("depth",)}


@pytest.fixture(scope="module")
def course():
    phases = [Phase("a", BALL, frames=5, supervision=OnePixelPerMovingObject()), Phase("b", BALL, frames=4, start=9)]
    return Course(phases, tests=[Phase("a", BALL, frames=2, start=30)], **SETTINGS)


@pytest.mark.parametrize("name", sorted(set(suites()) - {"solids", "room", "home"}))
def test_suite_has_phases_tests_and_labels(name):
    suite = load_course(name)
    assert Course.from_json(suite.to_json()).phases == suite.phases
    assert len(suite.phases) >= 3
    assert all(phase.supervision is not None for phase in suite.phases)
    tested = {phase.name for phase in suite.test_phases}
    assert len(tested & {phase.name for phase in suite.phases}) >= 2
    assert tested - {phase.name for phase in suite.phases}  # held out
    assert suite.boundaries == "hidden"
    assert suite.observed == ("rgb", "forward_flow")


def test_suites_without_grade_are_medium():
    assert suites()["solids"] == suites()["solids-medium"]
    with pytest.raises(UnknownName, match="Did you mean 'solids'"):
        load_course("solid")


def test_held_out_frames_are_later_frames_of_the_same_scenario(course):
    (first, second) = held_out(course.phases, frames=3, start=65, step=2)
    assert (first.name, first.start, first.step, first.supervision) == ("a", 65, 2, None)
    assert second.scenario == BALL


@pytest.mark.parametrize(
    ("phase", "options", "count"),
    [
        (Phase("a", BALL, frames=5), {"start": 52}, 3),  # a lap has 25 frames
        (Phase("a", BALL, frames=5), {"start": 52, "fps": 24}, 1),  # 52 is 4, 53 is 5
        (Phase("a", BALL, laps=1, start=3), {}, 4),
        (Phase("a", scenario(timings=AllTogether(0.4)), frames=20, start=4), {"start": 34}, 3),  # laps begin at 10
        (Phase("a", Scenario("object_view"), frames=1002), {}, 2),
        (Phase("a", Scenario("object_view"), frames=1002, step=2), {"step": 2}, 4),
    ],
)
def test_held_out_frames_that_were_shown_are_counted_in_a_warning(phase, options, count):
    with pytest.warns(UserWarning, match=f"test 'a': its phase has shown {count} of its 4 frames"):
        held_out([phase], frames=4, **options)


def test_held_out_frames_that_were_never_shown_raise_no_warning(recwarn):
    drift = Drift("illumination", (0.0, -1.0), Step(2))
    for phase in (
        Phase("a", BALL, frames=5),
        Phase("a", scenario(total_time=1.0001), frames=900),
        Phase("a", BALL, frames=50, drift=drift),
        Phase("a", Scenario("object_view"), frames=600, step=2),
    ):
        held_out([phase], frames=4, start=1005, step=2)
    assert not recwarn


def test_counterfactuals_change_one_factor_and_keep_the_motion(course):
    tests = counterfactuals(course.phases[:1], {"speed": [2.0], "illumination": [-1.0]}, frames=3)
    assert [test.name for test in tests] == ["a | speed 2.0", "a | illumination -1.0"]
    shown = Course(tests, **SETTINGS)
    slow, fast, dim = course[2], shown[1], shown[5]
    assert fast.objects.by_name("ball").position == slow.objects.by_name("ball").position  # at twice the speed
    assert (dim.instance == slow.instance).all()
    with pytest.raises(ArgumentError, match="name one factor"):
        counterfactuals(course.phases, {}, frames=1)
    with pytest.raises(UnknownName, match="Did you mean 'illumination'"):
        counterfactuals(course.phases, {"ilumination": [1]}, frames=1)


class Ones:
    """Predicts the first category."""

    def __init__(self, categories=None, seed=0):
        pass

    def predict(self, frame):
        return np.ones(frame.depth.shape, int)

    def learn(self, frame, answers):
        pass


def test_page_shows_every_learner_and_escapes_names(course, tmp_path):
    scores = evaluate_all({"<one>": Ones(), "two": Ones()}, course)
    write_page(tmp_path / "page.html", "A & B", scores)
    text = (tmp_path / "page.html").read_text()
    assert "<h1>A &amp; B</h1>" in text
    assert "&lt;one&gt;" in text
    assert "<one>" not in text
    assert text.count("<h3>&lt;one&gt;</h3>") == 1  # its matrix
    assert text.count("<polyline") == 6  # online, whole frame and the test; nothing is 50 frames ahead
    assert text.count("data:image/png") == 3  # true and two predictions of one test
    (tmp_path / "file").write_text("")
    with pytest.raises(ExportError):
        write_page(tmp_path / "file" / "page.html", "A", scores)


def test_figures_have_mean_and_spread():
    assert mean_and_deviation([0.5, 0.7]) == pytest.approx((0.6, 0.1 * 2**0.5))
    assert percent([0.5, 0.7]) == "60.0 ± 14.1"
    assert percent([0.25]) == "25.0"
    assert percent([0.5, None]) == percent([]) == "–"


def test_curve_of_a_test_has_a_point_after_each_phase(course):
    (score,) = evaluate_all({"one": Ones()}, course)
    curve = accuracy_of_test(score.scores, course, "a")
    assert curve == [(0, 1.0), (5, 1.0), (9, 1.0)]  # before the first phase, after "a", after "b"


def test_curves_of_seeds_have_mean_and_range():
    lines, bands = mean_and_range({"a": [[(0, 0.2), (5, 0.4)], [(0, 0.6)]], "b": [[(0, 0.5)]]})
    assert lines == {"a": [(0, pytest.approx(0.4)), (5, 0.4)], "b": [(0, 0.5)]}
    assert bands == {"a": [(0, 0.2, 0.6), (5, 0.4, 0.4)]}


def test_chart_places_points_by_frame_and_fraction():
    chart = line_chart({"a": [(0, 0.0), (10, 1.0)]}, end=10, marks={5: "x<y"}, colors=line_styles(["a"]), label="A")
    assert 'points="44.0,236.0 836.0,34.0"' in chart
    assert "x&lt;y" in chart
    band = line_chart(
        {"a": [(0, 0.5)]}, end=10, marks={}, colors=line_styles(["a"]), label="A", bands={"a": [(0, 0.0, 1.0)]}
    )
    assert 'points="44.0,236.0 44.0,34.0"' in band


def test_command_writes_scores_and_page_and_verifies_them(course, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    course.save("course.json")
    learner = "tests.learning.test_suites:Ones"
    assert main(["evaluate", "course.json", "--learner", learner, "--seeds", "2", "-o", "out"]) == 0
    assert capsys.readouterr().out.strip() == "out/index.html"
    files = sorted(path.name for path in Path("out").iterdir())
    assert files == ["index.html", *(f"tests.learning.test_suites_Ones-seed{seed}.json" for seed in (0, 1))]
    score = Path("out", files[1])
    assert Score.load(score)["online"]["accuracy"] == 1.0
    assert main(["evaluate", str(score), "--verify"]) == 0
    assert capsys.readouterr().out.strip() == str(score)
    changed = json.loads(score.read_text())
    changed["scores"]["online"]["accuracy"] = 0.5
    score.write_text(json.dumps(changed))
    assert main(["evaluate", str(score), "--verify"]) == 2
    assert "scores.online.accuracy: 0.5 and 1.0" in capsys.readouterr().err


class SavedOnes(Ones):
    """Has no state."""

    def state_dict(self):
        return {}

    def load_state_dict(self, state):
        pass


class InterruptedOnes(SavedOnes):
    """Is interrupted at the third frame."""

    def learn(self, frame, answers):
        if frame.index == 2:
            raise KeyboardInterrupt


def test_interrupted_command_says_whether_it_will_continue(course, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    course.save("course.json")
    command = ["evaluate", "course.json", "--learner", "tests.learning.test_suites:InterruptedOnes", "-o", "out"]
    assert main(command) == 130
    assert "nothing was saved. With --checkpoint, the same command would continue" in capsys.readouterr().err
    assert main([*command, "--checkpoint"]) == 130
    assert "out/checkpoint.pickle has the state. The same command continues from there" in capsys.readouterr().err
    assert (
        main(["evaluate", "course.json", "--learner", "tests.learning.test_suites:Ones", "--checkpoint", "-o", "new"])
        == 2
    )
    assert "a checkpoint needs a learner with state_dict" in capsys.readouterr().err


def test_checkpoint_is_kept_until_the_scores_are_written(course, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    course.save("course.json")
    command = ["evaluate", "course.json", "--learner", "tests.learning.test_suites:SavedOnes", "-o", "out"]

    def full(*_):
        raise ExportError("disk full")

    with monkeypatch.context() as broken:
        broken.setattr(Score, "save", full)
        assert main([*command, "--checkpoint"]) == 2
    assert (tmp_path / "out" / "checkpoint.pickle").exists()
    monkeypatch.setattr(SavedOnes, "learn", None)  # nothing is learned again
    assert main([*command, "--checkpoint"]) == 0
    assert [file.name for file in sorted((tmp_path / "out").iterdir())] == [
        "index.html",
        "tests.learning.test_suites_SavedOnes-seed0.json",
    ]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nothing"], "no suite 'nothing'"),
        (["none.json"], "no file 'none.json'"),
        (["course.json", "--learner", "nobody"], "no learner 'nobody'"),
        (["course.json", "--seeds", "0"], "--seeds 0: must be at least 1"),
        (["course.json", "--verify"], "not a score"),
    ],
)
def test_command_explains_mistakes(course, tmp_path, capsys, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    course.save("course.json")
    assert main(["evaluate", *arguments]) == 2
    assert message in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["course.json"]


@pytest.mark.slow
@pytest.mark.parametrize("regime", ["request", "early", "late"])
def test_example_of_regimes_runs(tmp_path, regime):
    program = [sys.executable, ROOT / "examples/supervision_regimes.py", "--laps", "1", "--labels", "9"]
    options = ["--learner", "blind", "--regime", regime, "--output", tmp_path / "out"]
    done = subprocess.run([*program, *options], capture_output=True, text=True, check=True)
    assert f"blind, {regime}" in done.stdout
    assert (tmp_path / "out/index.html").exists()
