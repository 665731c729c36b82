# SPDX-License-Identifier: Apache-2.0
"""Teachers of streams that are edited, sought and indexed; their states; what they refuse."""

import copy
import json
import pickle

import pytest

from dynamics import AllTogether, LinearWaypoints, Waypoint
from tiscene.errors import ArgumentError, ArgumentTypeError, ScenarioError
from tiscene.learning.answers import Answer
from tiscene.learning.course import Course
from tiscene.learning.course_file import FIELDS
from tiscene.learning.phase import Phase
from tiscene.learning.pixel_labels import LABELS
from tiscene.learning.supervision import Supervision
from tiscene.learning.supervision_rules import SupervisionRules
from tiscene.learning.teaching_policies import (
    Everything,
    FocusOfAttention,
    OnePixelPerMovingObject,
    Policy,
    RandomPixels,
    Recorded,
)
from tiscene.scenario.objects import Object
from tiscene.scenario.scenario import Scenario
from tiscene.stream.stream import Stream

SIZE = {"width": 16, "height": 12, "buffers": LABELS}
NOISY = {"policy": RandomPixels(20), "noise": 0.8}


def edited_stream(scenario="object_view", **others):
    return Stream(scenario, frames=6, **SIZE, **others)


@pytest.fixture(scope="module")
def stream():
    return edited_stream()


def taught(stream, **rules):
    """Return a teacher that has labeled all frames; a cube is spawned after the third one."""
    teacher = Supervision(stream, **NOISY, **rules)
    for frame in stream.seek(0):
        list(teacher.offers(frame))
        if frame.index == 2:
            stream.world.spawn("Cube", position=(0, 1, -2))
    return teacher


def test_noisy_labels_stay_when_a_spawn_adds_a_category():
    stream = edited_stream()
    teacher = taught(stream)
    assert "cube" in {row.category for row in teacher.ledger if row.frame > 2}
    assert "cube" not in {row.category for row in teacher.ledger if row.frame <= 2}
    assert len(list(teacher.replay())) == len(teacher.ledger) == 120
    again = Supervision(edited_stream(Scenario.from_json(stream.scenario.to_json())), **NOISY)
    for frame in again._stream:
        list(again.offers(frame))
    assert again.ledger == teacher.ledger


def test_pending_noisy_labels_are_the_same_from_a_state_after_a_spawn():
    stream = edited_stream()
    teacher = taught(stream, delay=9)
    second = Supervision(stream, **NOISY, delay=9)
    second.load_state_dict(json.loads(json.dumps(teacher.state_dict())))
    answers = second.arrived(99)
    assert len(answers) == 120
    assert answers == teacher.arrived(99)


def test_question_without_a_frame_is_of_the_one_passed_last_or_before_the_position(stream):
    teacher = Supervision(stream.seek(0))
    frame = stream[5]
    with pytest.raises(ArgumentError, match="the stream has returned no frame yet; pass the frame, or its index"):
        teacher.ask(1, 1)
    assert teacher.ask(1, 1, frame).frame == teacher.ask(1, 1).frame == 5
    next(stream)
    assert teacher.ask(1, 1).frame == 0
    stream.seek(4)
    assert teacher.ask(1, 1).frame == 3
    stream.seek(0)
    with pytest.raises(ArgumentError, match="has returned no frame yet"):
        Supervision(stream).ask(1, 1)


def test_views_of_other_cameras_are_refused():
    stream = Stream("solid_benchmark", camera=("Left", "Main"), **SIZE)
    teacher, frame = Supervision(stream), stream[0]
    assert teacher.ask(8, 8, frame) == teacher.ask(8, 8, frame.views["Left"]) == Supervision(stream).ask(8, 8, 0)
    for other in (frame.views["Main"], stream.render_view(0, "Right")):
        with pytest.raises(
            ArgumentError, match=r"is the view of '(Main|Right)'; a teacher labels that of the first camera"
        ):
            teacher.ask(8, 8, other)


def test_frames_of_other_streams_are_refused(stream):
    teacher = Supervision(stream)
    larger = Stream("object_view", width=24, height=18, buffers=LABELS)
    longer = Stream("object_view", **SIZE)
    course = Course([Phase("a", "object_view", frames=2)], **SIZE, observed=("depth",))
    for frame in (larger[0], longer[6], course[0]):
        with pytest.raises(ArgumentError, match="is a frame of another stream"):
            teacher.ask(1, 1, frame)
    with pytest.raises(ArgumentError, match="is a frame of another stream"):
        Supervision(course).offers(stream[0])
    with pytest.raises(ArgumentTypeError, match="frame=5: must be a frame of the stream"):
        teacher.offers(5)


def test_recorded_labels_frames_of_the_course_as_policy_of_its_phases():
    def course(*policies):
        phases = [
            Phase(name, "object_view", frames=2, supervision=each) for name, each in zip("ab", policies, strict=True)
        ]
        return Course(phases, **SIZE, observed=("depth",))

    def ledger(course):
        teacher = Supervision(course)
        for frame in course:
            list(teacher.offers(frame))
        return teacher.ledger

    first = ledger(course(RandomPixels(2), RandomPixels(3)))
    assert len(first) == 10
    for rows in (first, [(row.frame, row.y, row.x) for row in first]):
        assert ledger(course(Recorded(rows), Recorded(rows))) == first
    made = course(Recorded(first), Recorded(first))
    assert Course.from_json(json.loads(json.dumps(made.to_json()))).phases == made.phases
    with pytest.raises(ArgumentError, match=r"pixels_by_frame=\[\(1, 2\)\]: must be rows \(frame, row, column\)"):
        Recorded([(1, 2)])


def test_states_of_other_streams_and_rules_are_refused(stream):
    teacher = Supervision(stream, policy=RandomPixels(3), budget=9)
    frame = stream[0]
    list(teacher.offers(frame))
    state = json.loads(json.dumps(teacher.state_dict()))
    other = Stream("solid_benchmark", frames=6, **SIZE)
    for wrong, differing in (
        (Supervision(other, policy=RandomPixels(3), budget=9), "stream: the state was saved with other scenario, "),
        (Supervision(stream, policy=RandomPixels(3), budget=1), "rules: the state was saved with other budget; "),
        (Supervision(stream, policy=RandomPixels(4), budget=9), "other policy; "),
        (Supervision(stream, policy=RandomPixels(3), budget=9, silent=[(0, 1)]), "other silent; "),
    ):
        with pytest.raises(ArgumentError, match=differing):
            wrong.load_state_dict(state)
        assert (len(wrong.ledger), wrong.remaining >= 0) == (0, True)


def test_damaged_states_are_refused_and_change_nothing(stream):
    teacher = Supervision(stream, policy=RandomPixels(3), delay=2)
    list(teacher.offers(stream[0]))
    state = teacher.state_dict()
    damages = ({"given": "q"}, {"given": [[0, -5]]}, {"pending": [[99, 0, 0, 0, 0]]}, {"pending": [[0, 50, 0, 0, 0]]})
    ledger = {"ledger": state["ledger"] | {"frame": [None] * 3}}
    for damage in (*damages, {"refused": 3}, {"ledger": {}}, ledger):
        with pytest.raises(ArgumentError, match=r"this is not a Supervision.state_dict, or a damaged one"):
            teacher.load_state_dict(state | damage)
    for nothing in ({"version": 1}, None, "state"):
        with pytest.raises(ArgumentError, match=r"this is not a Supervision.state_dict of version 1"):
            teacher.load_state_dict(nothing)
    assert teacher.state_dict() == state


def test_state_of_a_course_is_refused_by_another_course():
    def teacher(frames):
        course = Course(
            [Phase("a", "object_view", frames=frames, supervision=RandomPixels(1))], **SIZE, observed=("depth",)
        )
        return Supervision(course)

    first = teacher(2)
    list(first.offers(first._stream[1]))
    same, other = teacher(2), teacher(3)
    same.load_state_dict(first.state_dict())
    assert same.ledger == first.ledger
    with pytest.raises(ArgumentError, match="stream: the state was saved with other course; make"):
        other.load_state_dict(first.state_dict())


@pytest.mark.parametrize(
    "copied", [copy.deepcopy, lambda each: pickle.loads(pickle.dumps(each))], ids=["copy", "pickle"]
)
def test_courses_and_teachers_are_copied_after_a_frame_was_rendered(copied, stream):
    rules = SupervisionRules(RandomPixels(2), noise=0.5)
    course = Course(
        [Phase("a", "object_view", frames=2, supervision=rules)],
        tests=[Phase("t", "solid_benchmark", frames=1)],
        **SIZE,
        observed=("depth",),
    )
    teacher = Supervision(course)
    given = [answer for frame in course for _, answer in teacher.offers(frame)]
    other = copied(teacher)
    assert list(other.replay()) == given
    again = copied(course)
    assert (again.position, again.digest(), again.categories) == (2, course.digest(), course.categories)
    assert again[1].depth.tobytes() == course[1].depth.tobytes()
    assert copied(course.tests)[0].semantic.tobytes() == course.tests[0].semantic.tobytes()
    teacher = Supervision(stream.seek(1), policy=RandomPixels(2))
    list(teacher.offers(stream[3]))
    other = copied(teacher)
    assert other.ledger == teacher.ledger
    assert (other.present, teacher.present) == (0, 3)
    assert repr(other) == f"<Supervision of {other._stream!r}: 2 labels given>"
    assert list(other.replay()) == list(teacher.replay())


@pytest.mark.parametrize("given", [None, [(1,)], [5], [(float("nan"), 0)], [(1.5, 2.0)], [("a", "b")], [(12, 0)]])
def test_wrong_pixels_of_a_policy_are_refused(stream, given):
    class Wrong(Policy):
        def pixels(self, frame, moment):
            return given

    with pytest.raises(ArgumentError, match=r"Wrong.pixels|pixel \(12, 0\)"):
        list(Supervision(stream, policy=Wrong()).offers(stream[0]))


def test_wrong_arguments_of_teachers_and_policies_are_refused(stream):
    for wrong in (None, "object_view", [1, 2]):
        with pytest.raises(ArgumentTypeError, match="must be a Stream or a Course"):
            Supervision(wrong)
    with pytest.raises(ArgumentTypeError, match="silent=3: must be intervals"):
        Supervision(stream, silent=3)
    with pytest.raises(ArgumentTypeError, match="index='a'"):
        Supervision(stream).arrived("a")
    with pytest.raises(ArgumentTypeError, match=r"fixations\[0\]='a': must be 2 numbers"):
        FocusOfAttention("ab", 1)
    with pytest.raises(ArgumentTypeError, match="pixels_by_frame=None"):
        Recorded(None)


def test_everything_labels_the_middle_where_the_step_is_larger_than_the_image(stream):
    answers = list(Supervision(stream, policy=Everything(100)).offers(stream[0]))
    assert [pixel for pixel, _ in answers] == [(6, 8)]
    assert isinstance(answers[0][1], Answer)
    assert len(list(Supervision(stream, policy=Everything(10)).offers(stream[0]))) == 2


def test_files_of_policies_name_no_private_class():
    assert "LastFrames" in FIELDS["policy"]
    assert not [name for name in FIELDS["policy"] if name.startswith("_")]

    class Own(Policy):
        pass

    with pytest.raises(ScenarioError, match=r"phases\[0\].supervision.policy=.*: cannot be .*; make Own a dataclass"):
        Course([Phase("a", "object_view", frames=2, supervision=Own())], **SIZE, observed=("depth",)).to_json()


def test_pixels_of_a_policy_are_drawn_by_the_seed_of_the_rules(stream):
    frame = stream[0]
    first, again, other = (
        [pixel for pixel, _ in Supervision(stream, policy=RandomPixels(5), seed=seed).offers(frame)]
        for seed in (1, 1, 2)
    )
    assert first == again
    assert first != other


def test_noise_in_a_course_is_never_background():
    scenario = Scenario("object_view", [Object("a", "Cube", (0, 1, -2)), Object("b", "Ball 01", (0.5, 1, -2))])
    course = Course([Phase("a", scenario, frames=1)], **SIZE, observed=("depth",))
    answers = [answer for _, answer in Supervision(course, policy=Everything(), noise=1.0).offers(course[0])]
    assert {answer.category for answer in answers if answer.instance} >= {"ball", "cube"}
    assert all(answer.category_id for answer in answers)


def test_motion_of_an_object_is_that_at_the_frame_of_the_question():
    way = LinearWaypoints([Waypoint((0, 1, -2)), Waypoint((0.5, 1, -2))], total_time=4.0)
    scenario = Scenario("object_view", [Object("a", "Cube", dynamic=way, scale=2.0)], timings=AllTogether(0.1))
    stream = edited_stream(scenario)
    teacher = Supervision(stream)
    answers = [teacher.ask(6, 8, stream[index]) for index in (0, 5, 0)]
    assert [(answer.object, answer.moving) for answer in answers] == [("a", False), ("a", True), ("a", False)]


def test_loaded_state_forgets_the_frame_that_was_held(stream):
    teacher = Supervision(stream.seek(3))
    teacher.hold(stream[5])
    assert teacher.present == 5
    teacher.load_state_dict(teacher.state_dict())
    assert teacher.present == 2


def test_question_about_a_frame_that_was_edited_since_is_answered_anew():
    stream = edited_stream(Scenario("object_view", [Object("a", "Cube", (0, 1, -2), scale=2.0)]))
    teacher, frame = Supervision(stream), next(stream.seek(3))
    assert teacher.ask(6, 8, frame).object == "a"
    stream.seek(3).world.despawn("a")
    assert teacher.ask(6, 8, 3).object != "a"
    next(stream)
    assert teacher.present == 3
    assert teacher.ask(6, 8).object != "a"


def test_held_frame_still_answers_after_an_edit_of_later_ones(monkeypatch):
    stream = edited_stream(Scenario("object_view", [Object("a", "Cube", (0, 1, -2), scale=2.0)]))
    teacher = Supervision(stream)
    teacher.hold(next(stream))
    stream.world.despawn("a")
    monkeypatch.setattr(stream, "render_view", None)
    assert teacher.ask(6, 8).object == "a"


def test_moving_objects_of_a_frame_are_those_after_its_last_edit():
    stream = edited_stream(Scenario("object_view", [Object("a", "Cube", (0, 1, -2), scale=2.0)]))
    teacher = Supervision(stream, policy=OnePixelPerMovingObject())
    assert not list(teacher.offers(next(stream.seek(3))))
    stream.seek(3).world.move("a", (0.2, 1, -2))
    assert len(list(teacher.offers(next(stream)))) == 1
