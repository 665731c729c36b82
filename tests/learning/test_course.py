# SPDX-License-Identifier: Apache-2.0
"""Courses of phases, and laps."""

import json
import math
import re

import numpy as np
import pytest

from dynamics import (
    AllTogether,
    DictTimings,
    LinearWaypoints,
    Orbit,
    UniformMovementRandomBounce,
    WaitUntilComplete,
    Waypoint,
)
from tests.learning.small_course import BALL, CHAIR, SMALL, same, scenario
from tiscene.errors import ArgumentError, MissingFile, ObjectNotFound, ScenarioError
from tiscene.learning.course import UNUSED, Course
from tiscene.learning.drift import Drift, Mix, Ramp
from tiscene.learning.laps import lap_times
from tiscene.learning.phase import Phase
from tiscene.learning.supervision import Supervision
from tiscene.learning.supervision_rules import SupervisionRules
from tiscene.learning.teaching_policies import Everything, FirstFrames, LastFrames, OnePixelPerMovingObject
from tiscene.scenario.light_motion import LightMotion
from tiscene.scenario.objects import Object
from tiscene.scenario.scenario import Scenario
from tiscene.scene.camera import Camera
from tiscene.scene.lens_keyframes import LensKeyframes
from tiscene.stream import stage_cache
from tiscene.stream.stream import Stream


@pytest.fixture(scope="module")
def course():
    return Course(
        [
            Phase("watch", BALL, frames=6),
            Phase("taught", CHAIR, frames=4, supervision=OnePixelPerMovingObject()),
            Phase("again", BALL, frames=3, start=2),
            Phase("other scene", scenario("Plant 01", scene="solid_benchmark"), frames=2),
        ],
        tests=[Phase("watch", BALL, frames=2, start=40), Phase("unseen", scenario("Pillow 01"), frames=2)],
        **SMALL,
    )


def test_course_shows_the_frames_of_its_streams(course):
    assert len(course) == 15
    names = list(course.categories.values())[1:]
    settings = {"width": 32, "height": 24, "buffers": SMALL["buffers"], "quality": "fast", "categories": names}
    ball, chair = Stream(BALL, **settings), Stream(CHAIR, **settings)
    for index, stream, k in ((0, ball, 0), (5, ball, 5), (6, chair, 0), (9, chair, 3), (10, ball, 2), (12, ball, 4)):
        frame = course[index]
        assert same(frame, stream[k])
        assert (frame.index, frame.time) == (index, stream[k].time)
        assert repr(frame) == f"<Frame {index} at {frame.time:.3f} s, 32x24: {', '.join(frame)}>"


def test_frames_know_phase_and_boundary(course):
    frames = list(course.seek(4))
    assert [frame.phase for frame in frames] == ["watch"] * 2 + ["taught"] * 4 + ["again"] * 3 + ["other scene"] * 2
    assert [frame.index for frame in frames if frame.boundary] == [6, 10, 13]
    assert [frame.phase_index for frame in frames][:4] == [4, 5, 0, 1]
    assert course.events() == {6: "phase taught", 10: "phase again", 13: "phase other scene"}
    with pytest.raises(StopIteration):
        next(course)
    course.seek(0)


def test_revisited_frames_have_equal_bytes(course):
    assert same(course[2], course[10])
    assert same(course[-1], course[14])
    assert [frame.index for frame in course[3:9:2]] == [3, 5, 7]
    for outside in (15, -16):
        with pytest.raises(IndexError, match=rf"frame {outside} is outside 0\.\.14"):
            course[outside]


def test_category_ids_are_shared_by_name_with_tests(course):
    categories = course.categories
    assert {"ball", "chair", "plant", "pillow"} < set(categories.values())
    assert list(categories) == list(range(len(categories)))
    for index in (0, 6, 13):
        frame = course[index]
        assert frame.categories == categories
        row = frame.objects.by_name("mover")
        assert categories[row.category_id] == row.category
        assert row.category_id in frame.semantic
    assert course.tests.categories == categories
    assert course.tests[0].categories == categories


def test_given_categories_are_kept():
    chosen = Course([Phase("a", BALL, frames=1)], **SMALL, categories=("chair", "ball"))
    assert chosen.categories == {0: "", 1: "chair", 2: "ball"}
    assert set(np.unique(chosen[0].semantic)) == {0, 2}


def test_same_scene_is_read_once(monkeypatch):
    read = []
    load = stage_cache.load
    monkeypatch.setattr(
        stage_cache, "load", lambda path, *args, **named: read.append(path) or load(path, *args, **named)
    )
    scenarios = [scenario(name) for name in ("Ball 01", "Chair 01", "Plant 01", "Pillow 01", "Dish 01", "Book 01")]
    phases = [Phase(f"{row}", each, frames=1) for row, each in enumerate(scenarios)]
    course = Course(phases, **SMALL)
    for index in (0, 5, 1, 4, 2, 3):
        course[index]
    assert len(read) == 1


def test_all_streams_of_a_course_report_their_progress():
    def report(text, done):
        pass

    course = Course([Phase("a", BALL, frames=1), Phase("b", CHAIR, frames=1)], **SMALL, progress=report)
    assert [course.source(k)[0]._progress for k in range(2)] == [report, report]


def test_observation_hides_labels_and_boundaries(course):
    frame = course[6]
    seen = course.observation(frame)
    assert list(seen) == ["depth"]
    assert (seen.phase, seen.boundary, seen.lap, len(seen.objects), seen.events) == ("", False, None, 0, ())
    assert seen.index == frame.index
    shown = Course(course.phases, boundaries="shown", **SMALL).observation(frame)
    assert (shown.phase, shown.boundary) == ("taught", True)


def test_state_resumes_and_refuses_other_courses(course):
    course.seek(7)
    saved = json.loads(json.dumps(course.state_dict()))
    again = Course.from_json(json.loads(json.dumps(course.to_json())))
    again.load_state_dict(saved)
    assert again.position == 7
    assert same(next(again), course[7])
    other = Course(course.phases[:3], **SMALL)
    with pytest.raises(ArgumentError, match="of another course"):
        other.load_state_dict(saved)
    with pytest.raises(ArgumentError, match="not a Course"):
        other.load_state_dict({})


def test_json_keeps_everything(tmp_path):
    drift = [
        Drift("scenario", (BALL, CHAIR), Mix(1, 4, block=1)),
        Drift("illumination", (1.0, 0.25), Ramp(0, 5, steps=3)),
    ]
    rules = SupervisionRules(FirstFrames(2, Everything(3)), budget=5, rate=0.5, noise=0.1, within=3)
    course = Course(
        [Phase("a", BALL, laps=2, supervision=rules, drift=drift), Phase("b", CHAIR, frames=2, evaluate=True, start=3)],
        tests=[Phase("a", BALL, frames=1)],
        boundaries="shown",
        fps=10,
        **SMALL,
    )
    course.save(tmp_path / "course.json")
    loaded = Course.load(tmp_path / "course.json")
    assert loaded.phases == course.phases
    assert loaded.test_phases == course.test_phases
    assert loaded.to_json() == course.to_json()
    assert (loaded.boundaries, loaded.observed, loaded.fps) == ("shown", ("depth",), 10)
    assert len(course.to_json()["scenarios"]) == 2


def test_numbers_of_numpy_are_saved_as_those_of_python():
    def course(whole, number, true):
        drift = Drift("illumination", (number(1.0), number(-0.5)), Ramp(whole(0), whole(2)))
        phase = Phase("a", BALL, frames=whole(3), drift=drift, supervision=SupervisionRules(rate=number(0.5)))
        return Course([phase], **SMALL | {"width": whole(32)}, denoise=true(False))

    assert course(np.int64, np.float32, np.bool_).to_json() == course(int, float, bool).to_json()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": "x"}, "not a course"),
        ({"version": 9}, "version: 9, but this tiscene reads version 1"),
        ({"phazes": []}, "phazes: a course has no such key"),
        ({"phases": [{"name": "a", "scenario": "7", "frames": 1}]}, r"phases\[0\].scenario='7': no such key"),
        ({"phases": [{"name": "a", "scenario": "1", "frame": 1}]}, r"phases\[0\].frame: Phase has no such key"),
        ({"phases": [{"scenario": []}]}, r"phases\[0\].scenario=\[\]: no such key"),
        ({"phases": [{"scenario": "1", "frames": 1}]}, r"phases\[0\].name: is missing"),
        (
            {"phases": [{"name": "a", "scenario": "1", "frames": 1, "drift": ["x"]}]},
            r"phases\[0\]: phase 'a': drift=\('x',\)",
        ),
        (
            {"phases": [{"name": "a", "scenario": "1", "frames": 1, "drift": [{"factor": "scenario"}]}]},
            r"phases\[0\].drift\[0\].values: is missing",
        ),
        *(({name: None}, f"{name}=None: must be") for name in ("phases", "tests", "settings", "scenarios", "observed")),
        (
            {"phases": [{"name": "a", "scenario": "1", "frames": 1, "supervision": {"budget": -1}}]},
            r"phases\[0\].supervision.budget=-1",
        ),
        (
            {"phases": [{"name": "a", "scenario": "1", "frames": 1, "supervision": {"policy": {"type": "Randm"}}}]},
            "unknown type 'Randm'",
        ),
    ],
)
def test_damaged_files_name_the_place(tmp_path, change, message):
    content = Course([Phase("a", BALL, frames=1)], **SMALL).to_json() | change
    (tmp_path / "course.json").write_text(json.dumps(content))
    with pytest.raises((ArgumentError, ScenarioError), match=message) as error:
        Course.load(tmp_path / "course.json")
    assert "course.json" in str(error.value)


def test_missing_file_is_named(tmp_path):
    with pytest.raises(MissingFile, match="no file"):
        Course.load(tmp_path / "none.json")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Phase("a", BALL), "give either frames= or laps="),
        (lambda: Phase("a", BALL, frames=0), "frames=0: must be at least 1"),
        (lambda: Phase("a", 3, frames=1), "must be a Scenario"),
        (lambda: Phase("a", BALL, frames=1, drift=["x"]), "must be a Drift"),
        (lambda: Course([]), "one phase or more"),
        (lambda: Course([Phase("a", BALL, frames=1)] * 2), "called 'a' already"),
        (lambda: Course([Phase("a", BALL, frames=1)], boundaries="no"), "must be 'hidden' or 'shown'"),
        (lambda: Phase("a", BALL, frames=1, evaluate="yes"), "phase 'a': evaluate='yes'"),
        (lambda: Phase("a", BALL, frames=1, evaluate=True, supervision=LastFrames(1)), "the learner only predicts"),
        (lambda: Course([Phase("a", BALL, frames=1)], widht=3), "widht: Course has no such .*; did you mean 'width'"),
        (lambda: Course([Phase("a", BALL, frames=1)], observed=("hdr",)), "'hdr' is not among buffers="),
        (lambda: Course([Phase("a", BALL, frames=1)], observed="rgb"), "observed='rgb': must be a sequence of buffers"),
        (lambda: Course([Phase("a", BALL, frames=1)], categories="sphere"), "'sphere': must be a sequence of names"),
        (lambda: Course([Phase("a", BALL, frames=1)], seed=-1), "seed=-1: must be from 0 to"),
    ],
)
def test_wrong_courses_are_refused(make, message):
    with pytest.raises(ArgumentError, match=message):
        make()


def test_arguments_that_a_course_does_not_have_say_what_to_do():
    given = {"camera": ("Main", "High"), "variants": {}, "prefetch": 4, "batch": 2, "frames": 3, "supervision": None}
    assert given.keys() == UNUSED.keys()
    for name, value in given.items():
        with pytest.raises(ArgumentError, match=f"{name}=.*: a course has no such argument; {re.escape(UNUSED[name])}"):
            Course([Phase("a", BALL, frames=1)], **{name: value})


def test_teacher_of_a_course_follows_the_phases(course):
    teacher = Supervision(course)
    answers = {frame.index: [answer for _, answer in teacher.offers(frame)] for frame in course.seek(4)}
    assert [index for index, offered in answers.items() if offered] == [6, 7, 8, 9]
    assert {answer.category for offered in answers.values() for answer in offered} == {"chair"}
    remaining = []
    for index in (5, 6):
        teacher.hold(course[index])
        remaining.append(teacher.remaining)
    assert remaining == [0, math.inf]
    course.seek(0)


def test_last_frames_count_from_the_end_of_the_phase():
    phases = [Phase(name, BALL, frames=4, supervision=LastFrames(1)) for name in "ab"]
    course = Course(phases, **SMALL)
    teacher = Supervision(course)
    assert [frame.index for frame in course if list(teacher.offers(frame))] == [3, 7]


def two(first, second, timings=None, **others):
    paths = [LinearWaypoints([Waypoint((0, 0, 0)), Waypoint((1, 0, 0))], total_time=time) for time in (first, second)]
    objects = [Object(name, "Cube", dynamic=path) for name, path in zip("ab", paths, strict=True)]
    return Scenario("object_view", objects, timings=timings or AllTogether(0.0), **others)


def test_lap_is_common_multiple_of_all_loops():
    assert lap_times(two(2.0, 3.0)).frames(1, 25) == 150
    assert lap_times(two(2.0, 3.0), of="a").frames(1, 25) == 50
    assert lap_times(two(3.3, 1.1)).frames(2, 30) == 198
    turning = two(2.0, 4.0, camera=Camera(dynamic=Orbit(period=5.0)))
    assert lap_times(turning).frames(1, 10) == 200
    assert lap_times(turning, of="camera").frames(1, 10) == 50
    blinking = two(2.0, 4.0, lights=[LightMotion("Lamp", times=(0, 6), intensity=(1, 0), repeat=True)])
    assert lap_times(blinking).frames(1, 10) == 120


def test_laps_begin_after_the_wait():
    times = lap_times(two(2.0, 2.0, AllTogether(0.5)))
    assert times.frames(2, 10) == 45
    assert [times.lap(k, 10) for k in (0, 4, 5, 24, 25, 44, 45)] == [0, 0, 0, 0, 1, 1, 2]


def test_laps_of_turns():
    assert lap_times(two(2.0, 3.0, WaitUntilComplete(0.5))).frames(1, 10) == 60
    # In each cycle of 2.5 s, a does half of its loop of 2 s: it is back after two cycles.
    assert lap_times(two(2.0, 1.5, DictTimings({"a": 1.0, "b": 1.5}))).frames(1, 10) == 50


def test_scenarios_without_laps_say_why():
    bouncing = Scenario("object_view", [Object("ball", "Ball 01", dynamic=UniformMovementRandomBounce())])
    for without, message in ((bouncing, "'ball' never returns"), (Scenario("object_view"), "does not move")):
        with pytest.raises(ScenarioError, match=message):
            lap_times(without)
    with pytest.raises(ScenarioError, match="never returns"):
        lap_times(two(1.0, 2.0, WaitUntilComplete(0.5, repeat=False)))
    zooming = Camera(lens=LensKeyframes((0, 2), vertical_fov=(1.0, 0.5)))
    with pytest.raises(ScenarioError, match="'camera' never returns"):
        lap_times(two(1.0, 2.0, camera=zooming))
    with pytest.raises(ObjectNotFound, match="no object 'c'"):
        lap_times(two(1.0, 2.0), of="c")


def test_frames_repeat_after_a_lap():
    course = Course([Phase("laps", scenario(total_time=0.6), laps=2)], fps=10, **SMALL)
    frames = list(course)
    assert [frame.lap for frame in frames] == [0] * 6 + [1] * 6
    for first, second in zip(frames[:6], frames[6:], strict=True):
        assert same(first, second)
    assert not same(frames[0], frames[3])


def test_phase_lasts_its_laps_wherever_it_starts():
    body = scenario(total_time=0.6)
    starts = {"first": 0, "second": 6, "within a lap": 8, "fourth": 18}
    phases = [Phase(name, body, laps=1, start=start) for name, start in starts.items()]
    phases += [
        Phase("two", body, laps=2, start=6, step=5),
        Phase("waits", two(0.6, 0.6, AllTogether(0.5)), laps=1, start=2),
    ]
    course = Course(phases, fps=10, **SMALL)
    assert np.diff(course.starts).tolist() == [6, 6, 6, 6, 3, 9]


def test_lap_of_loops_that_never_meet_again_is_refused():
    objects = [
        Object(name, "Ball 01", dynamic=Orbit((0, 1, -2), period=period))
        for name, period in (("a", 1.0001), ("b", 0.9999))
    ]
    both = Scenario("object_view", objects)
    with pytest.raises(
        ScenarioError, match=r"phase 'long': a lap has .* \('a' 1 s, 'b' 1 s\); give frames=, or lap_of="
    ):
        Course([Phase("long", both, laps=1)], **SMALL, fps=10007)
    assert len(Course([Phase("short", both, laps=1, lap_of="a")], **SMALL)) == 26
