# SPDX-License-Identifier: Apache-2.0
"""Labels of single pixels, and what a teacher answers."""

import json
import math
from dataclasses import dataclass

import numpy as np
import pytest

from dynamics import CatmullWaypoints, Composite, Orbit, Waypoint
from tiscene.errors import ArgumentError
from tiscene.learning.answers import Answer, Pending, Refused
from tiscene.learning.label_ledger import LabelLedger
from tiscene.learning.pixel_labels import LABELS, render_label
from tiscene.learning.supervision import Supervision
from tiscene.learning.teaching_policies import (
    Everything,
    FirstFrames,
    FocusOfAttention,
    FollowMovingObjects,
    LastFrames,
    OnePixelPerMovingObject,
    Policy,
    RandomPixels,
    Recorded,
)
from tiscene.scenario.objects import Object
from tiscene.scenario.scenario import Scenario
from tiscene.scene.camera import Camera
from tiscene.stream.stream import Stream

WIDTH, HEIGHT = 32, 24
LOOP = CatmullWaypoints([Waypoint((-0.6, 0.9, -2)), Waypoint((0.6, 1.2, -2)), Waypoint((0, 0.6, -2.4))], total_time=2.0)
SCENARIO = Scenario(
    "object_view",
    [
        Object("ball", "Ball 01", dynamic=LOOP, collide=False),
        Object("chair", "Chair 01", (-0.5, 0.6, -3), dynamic=Composite((Orbit((0, 0, 0), period=4.0),)), collide=False),
        Object("plant", "Plant 01", (0.9, 0.4, -3), collide=False),
    ],
)


@pytest.fixture(scope="module")
def stream():
    return Stream(SCENARIO, width=WIDTH, height=HEIGHT, buffers=LABELS, frames=60)


@pytest.fixture(scope="module")
def frames(stream):
    return [stream[k] for k in range(12)]


@pytest.mark.parametrize(
    "camera",
    [
        None,
        Camera.look_at((0.4, 1.3, 0.5), (0, 0.8, -2.2), name="Moved"),
        Camera((0, 1, 1), orthographic_height=2.5, name="Orthographic"),
        Camera((0, 1, 0), dynamic=Orbit((0, 1, 0), period=20.0), name="Turning"),
    ],
    ids=["stage", "tilted", "orthographic", "moving"],
)
def test_label_of_one_ray_equals_label_of_rendered_frame(camera):
    stream = Stream(SCENARIO, width=WIDTH, height=HEIGHT, buffers=LABELS, camera=camera)
    for index in (0, 7):
        frame = stream[index]
        for y in range(0, HEIGHT, 3):
            for x in range(index % 3, WIDTH, 3):
                label = render_label(stream, index, y, x)
                assert (label.category_id, label.instance, label.part) == tuple(
                    int(frame[name][y, x]) for name in ("semantic", "instance", "part")
                )
                assert np.float32(label.depth).tobytes() == frame.depth[y, x].tobytes()
    assert len(np.unique(frame.instance)) > 2


def test_ask_names_object_category_and_motion(stream, frames):
    teacher, frame = Supervision(stream), frames[5]
    for name, category, moving in (("ball", "ball", True), ("chair", "chair", True), ("plant", "plant", False)):
        y, x = np.argwhere(frame.instance == frame.objects.by_name(name).id)[0]
        answer = teacher.ask(y, x, frame)
        assert (answer.object, answer.category, answer.moving) == (name, category, moving)
        assert answer.category_id == frame.semantic[y, x]
        assert answer.frame == answer.asked == 5
    assert answer.pixel == (y, x)


def test_ask_of_background_has_no_object():
    stream = Stream(SCENARIO, width=8, height=6, buffers=LABELS, camera=Camera((0, 1, 50), (0, 0, 1, 0)))
    answer = Supervision(stream).ask(0, 0, stream[0])
    assert (answer.category, answer.category_id, answer.instance, answer.object) == ("", 0, 0, "")
    assert math.isinf(answer.depth)


def test_ask_refers_to_frame_that_stream_returned_last(stream, frames):
    stream.seek(3)
    teacher = Supervision(stream)
    next(stream)
    assert teacher.present == 3
    teacher.hold(frames[7])
    assert teacher.present == 7
    next(stream)
    assert teacher.present == 4
    assert teacher.ask(10, 10).frame == 4


def test_frame_held_before_a_restart_is_not_asked_about_after_it(frames):
    stream = Stream(SCENARIO, width=WIDTH, height=HEIGHT, buffers=LABELS, frames=60)
    teacher = Supervision(stream, policy=OnePixelPerMovingObject())
    y, x = np.argwhere(frames[0].instance)[0].tolist()
    teacher.hold(stream[0])
    assert teacher.ask(y, x).instance == frames[0].instance[y, x]
    stream.restart(Scenario("object_view", [Object("box", "Cube", (0, 0.5, -3), scale=0.01)]))
    with pytest.raises(ArgumentError, match="returned no frame yet"):
        teacher.ask(y, x)
    assert teacher.ask(y, x, frame=0).instance == stream[0].instance[y, x] == 0
    assert not list(teacher.offers(stream[0])), "nothing moves in this scenario"


def test_ask_answers_about_past_and_future_frames_without_rendering(stream, frames):
    label_only = Stream(SCENARIO, width=WIDTH, height=HEIGHT, buffers=("depth",), frames=60)
    teacher = Supervision(label_only, within=5)
    teacher.hold(label_only[5])
    for index in (0, 5, 10):
        assert teacher.ask(11, 16, index).instance == frames[index].instance[11, 16]
    assert teacher.ask(11, 16, 11) == Refused("too far")
    assert Supervision(label_only).ask(11, 16, 60) == Refused("no such frame")
    assert teacher.refused == {"too far": 1}


def test_refused_is_false_and_answer_is_true(stream, frames):
    assert not Refused("budget")
    assert Supervision(stream).ask(0, 0, frames[0])


def test_budget_refuses_after_it_is_spent(stream, frames):
    teacher = Supervision(stream, budget=2)
    answers = [teacher.ask(5, x, frames[0]) for x in range(3)]
    assert [isinstance(each, Answer) for each in answers] == [True, True, False]
    assert answers[2] == Refused("budget")
    assert teacher.remaining == 0
    assert len(teacher.ledger) == 2


def test_rate_accumulates_unused_labels(stream, frames):
    teacher = Supervision(stream, rate=0.5)
    given = [sum(bool(teacher.ask(5, x, frames[k])) for x in range(3)) for k in (0, 1, 2, 3, 7)]
    assert given == [0, 1, 0, 1, 2]  # in all at most (k + 1) / 2


def test_per_category_counts_true_categories(stream, frames):
    frame = frames[5]
    teacher = Supervision(stream, per_category=2, noise=1.0)
    places = np.argwhere(frame.instance == frame.objects.by_name("ball").id)[:3]
    assert [bool(teacher.ask(y, x, frame)) for y, x in places] == [True, True, False]
    y, x = np.argwhere(frame.instance == frame.objects.by_name("plant").id)[0]
    assert teacher.ask(y, x, frame)


def test_every_keeps_distance_between_frames_with_labels(stream, frames):
    teacher = Supervision(stream, every=3)
    assert [bool(teacher.ask(5, 5, frames[k])) for k in (1, 1, 2, 3, 4, 5)] == [True, True, False, False, True, False]


def test_silent_intervals_refuse(stream, frames):
    teacher = Supervision(stream, policy=RandomPixels(2), silent=[(2, 4)])
    assert [len(list(teacher.offers(frames[k]))) for k in range(5)] == [2, 2, 0, 0, 2]
    assert teacher.ask(0, 0, frames[3]) == Refused("silent")


def test_delayed_answers_arrive_once(stream, frames):
    teacher = Supervision(stream, delay=3)
    pending = teacher.ask(5, 5, frames[2])
    assert pending == Pending(2, (5, 5), 5)
    assert teacher.arrived(4) == []
    (answer,) = teacher.arrived(5)
    assert (answer.frame, answer.asked, answer.instance) == (2, 2, frames[2].instance[5, 5])
    assert teacher.arrived(6) == []


def test_noise_replaces_expected_fraction_and_keeps_its_answers(stream, frames):
    teacher = Supervision(stream, policy=Everything(), noise=0.3, seed=4)
    answers = [answer for _, answer in teacher.offers(frames[0])]
    truth = frames[0].semantic.ravel()
    wrong = np.array([answer.category_id for answer in answers]) != truth
    count = len(truth)
    assert abs(wrong.sum() - 0.3 * count) < 4 * math.sqrt(count * 0.3 * 0.7)
    assert all(stream.categories[answer.category_id] == answer.category for answer in answers)
    assert [answer.instance for answer in answers] == frames[0].instance.ravel().tolist()
    again = Supervision(stream, noise=0.3, seed=4)
    assert [again.ask(*answer.pixel, frames[0]) for answer in reversed(answers)] == answers[::-1]
    other = Supervision(stream, noise=0.3, seed=5)
    assert [other.ask(*answer.pixel, frames[0]) for answer in answers] != answers


def test_one_pixel_per_moving_object(stream, frames):
    teacher = Supervision(stream, policy=OnePixelPerMovingObject())
    for frame in frames[1:5]:
        offers = list(teacher.offers(frame))
        assert [answer.object for _, answer in offers] == ["ball", "chair"]
        assert all(frame.instance[pixel] == answer.instance for pixel, answer in offers)
    assert len({pixel for frame in frames for pixel, _ in teacher.offers(frame)}) > 5


def test_focus_of_attention_follows_given_fixations(stream, frames):
    teacher = Supervision(stream, policy=FocusOfAttention([(0.5, 0.25), (1.0, 1.0)], hold=2))
    pixels = [pixel for frame in frames[:5] for pixel, _ in teacher.offers(frame)]
    assert pixels == [(12, 8), (12, 8), (23, 31), (23, 31), (12, 8)]


def test_focus_follows_one_moving_object_after_the_other(stream, frames):
    teacher = Supervision(stream, policy=FollowMovingObjects(hold=3))
    names = [answer.object for frame in frames[:9] for _, answer in teacher.offers(frame)]
    assert names == ["ball"] * 3 + ["chair"] * 3 + ["ball"] * 3


@pytest.mark.parametrize(("policy", "spoken"), [(FirstFrames(2), [0, 1]), (LastFrames(55), range(5, 12))])
def test_policies_of_a_part_are_silent_elsewhere(stream, frames, policy, spoken):
    teacher = Supervision(stream, policy=policy)
    assert [frame.index for frame in frames if list(teacher.offers(frame))] == list(spoken)
    for frame in frames:
        assert bool(teacher.ask(0, 0, frame)) == (frame.index in spoken)


def test_user_writes_a_policy(stream, frames):
    @dataclass(frozen=True)
    class Corner(Policy):
        def pixels(self, frame, moment):
            return [(0, 0)] if moment.index % 2 else []

    teacher = Supervision(stream, policy=Corner())
    assert [pixel for frame in frames[:4] for pixel, _ in teacher.offers(frame)] == [(0, 0), (0, 0)]


def test_state_resumes_to_the_byte(stream, frames):
    def teacher():
        return Supervision(stream, policy=RandomPixels(3), budget=20, delay=2, noise=0.2, per_category=9)

    def run(teacher, numbers):
        received = []
        for k in numbers:
            list(teacher.offers(frames[k]))
            received += teacher.arrived(k)
        return received

    whole = teacher()
    received = run(whole, range(10))
    first, second = teacher(), teacher()
    start = run(first, range(4))
    second.load_state_dict(json.loads(json.dumps(first.state_dict())))
    assert start + run(second, range(4, 10)) == received
    assert json.dumps(second.state_dict()) == json.dumps(whole.state_dict())
    assert second.ledger.digest() == whole.ledger.digest()


def test_ledger_replays_and_is_recorded_policy(stream, frames):
    teacher = Supervision(stream, policy=RandomPixels(3), noise=0.5)
    answers = [answer for frame in frames for _, answer in teacher.offers(frame)]
    assert list(teacher.replay()) == answers
    recorded = Recorded([(row.asked, row.y, row.x) for row in teacher.ledger])
    again = Supervision(stream, policy=recorded, noise=0.5)
    assert [answer for frame in frames for _, answer in again.offers(frame)] == answers
    assert again.ledger == teacher.ledger
    other = Supervision(Stream(SCENARIO, width=WIDTH, height=HEIGHT, buffers=LABELS, camera=Camera((0, 1, 2))))
    other.ledger = LabelLedger(teacher.ledger.to_json())
    with pytest.raises(ArgumentError, match="the ledger has"):
        list(other.replay())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"budget": -1}, "budget=-1: must be at least 0"),
        ({"noise": 1.5}, "noise=1.5: must be a fraction from 0 to 1"),
        ({"every": 0}, "every=0: must be at least 1"),
        ({"rate": -0.5}, "rate=-0.5: must not be negative"),
        ({"policy": RandomPixels}, r"an instance, not the class"),
        ({"silent": [(5, 2)]}, r"silent\[0\]=\(5, 2\): must be two frames with 0 <= first < first after"),
        ({"silent": [(0, 2), (4, 4)]}, r"silent\[1\]=\(4, 4\)"),
        ({"silent": [(0, 2.5)]}, r"silent\[0\]=2.5: must be a whole number"),
        ({"silent": (5, 9)}, r"silent\[0\]=5: must be two frames"),
        ({"bugdet": 3}, "bugdet: Supervision has no such argument; did you mean 'budget'"),
    ],
)
def test_wrong_rules_are_refused(stream, arguments, message):
    with pytest.raises(ArgumentError, match=message):
        Supervision(stream, **arguments)


def test_labels_are_offered_one_by_one(stream, frames):
    teacher = Supervision(stream, policy=Everything())
    offers = teacher.offers(frames[3])
    assert (teacher.present, len(teacher.ledger)) == (3, 0)
    next(offers)
    assert len(teacher.ledger) == 1


def test_wrong_questions_and_states_are_refused(stream, frames):
    teacher = Supervision(stream)
    with pytest.raises(ArgumentError, match=r"pixel \(24, 0\): the image is 24 x 32 px"):
        teacher.ask(24, 0, frames[0])
    for question, name in (((1.5, 0), "y"), ((0, 2.5), "x"), ((0, 0, 1.0), "frame")):
        with pytest.raises(ArgumentError, match=f"{name}=.*: must be a whole number"):
            teacher.ask(*question)
    with pytest.raises(ArgumentError, match="not a Supervision"):
        teacher.load_state_dict({"version": 0})
    with pytest.raises(ArgumentError, match="all of one length"):
        LabelLedger({"asked": [1]})
    endless = Stream(SCENARIO, width=WIDTH, height=HEIGHT, buffers=LABELS)
    with pytest.raises(ArgumentError, match="LastFrames: the stream has no end"):
        list(Supervision(endless, policy=LastFrames(3)).offers(endless[0]))
