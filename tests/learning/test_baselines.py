# SPDX-License-Identifier: Apache-2.0
"""Baselines on drawn pictures: colored squares on gray, with a few labels each."""

import contextlib
import pickle
import sys

import numpy as np
import pytest

from tiscene.errors import MissingExtra
from tiscene.frame.frame import FrameCamera
from tiscene.learning.learner import BASELINES, Learner, make_learner
from tiscene.learning.phase import CourseFrame
from tiscene.learning.supervision import Answer
from tiscene.scene.camera import Camera

CATEGORIES = {0: "", 1: "red", 2: "green", 3: "blue"}
COLORS = {1: (220, 30, 30), 2: (30, 200, 60), 3: (40, 60, 220)}
SIZE, SIDE = 24, 8
NETWORKS = ["naive", "replay", "ewc", "si", "lwf", "flow"]


@pytest.fixture(autouse=True)
def _torch(request):
    name = request.node.callspec.params.get("name") if hasattr(request.node, "callspec") else None
    if name != "blind":
        torch = pytest.importorskip("torch")
        torch.set_num_threads(1)


def drawn(index, category):
    """Return a frame with a square of a category that moves to the right by 1 px per frame, and its true ids."""
    x, y = index % (SIZE - SIDE), 5 + index // (SIZE - SIDE) % 8
    rgb = np.full((SIZE, SIZE, 3), 128, np.uint8)
    truth = np.zeros((SIZE, SIZE), int)
    rgb[y : y + SIDE, x : x + SIDE] = COLORS[category]
    truth[y : y + SIDE, x : x + SIDE] = category
    flow = np.zeros((SIZE, SIZE, 2), np.float32)
    flow[truth > 0] = (1, 0)
    camera = FrameCamera(Camera(), SIZE, SIZE)
    frame = CourseFrame(index, index / 25, camera, {"rgb": rgb, "forward_flow": flow})
    return frame, truth


def answers(frame, truth, count=4):
    """Return labels of random pixels, half of them on the square."""
    rng = np.random.default_rng(frame.index)
    inside, outside = np.argwhere(truth > 0), np.argwhere(truth == 0)
    chosen = [*rng.permutation(inside)[: count // 2], *rng.permutation(outside)[: count // 2]]
    return [
        Answer("", int(truth[y, x]), 1, "", 0, 1.0, True, frame=frame.index, pixel=(int(y), int(x))) for y, x in chosen
    ]


def taught(learner, category, frames, start=0):
    for index in range(start, start + frames):
        frame, truth = drawn(index, category)
        learner.learn(frame, answers(frame, truth))
    return learner


def accuracy(learner, category):
    """Return the accuracy on the square, in frames that were not learned."""
    shown = [drawn(index, category) for index in range(1000, 1060, 7)]
    right = [(learner.predict(frame)[truth > 0] == category).mean() for frame, truth in shown]
    return np.mean(right)


@pytest.mark.parametrize("name", [*NETWORKS, "ncm"])
def test_learner_learns_a_category_from_few_labels(name):
    learner = make_learner(name, CATEGORIES, seed=1)
    assert isinstance(learner, Learner)
    before = accuracy(learner, 2)
    taught(learner, 2, 60)
    assert before < 0.7
    assert accuracy(learner, 2) > (0.75 if name == "flow" else 0.9)  # flow trains its last layer alone


@pytest.mark.parametrize("name", BASELINES)
def test_state_continues_with_equal_predictions(name):
    learner = taught(make_learner(name, CATEGORIES, seed=3), 1, 6)
    if name == "shuffled":
        learner.end_of_phase()
    if name in ("ewc", "si", "lwf"):
        learner.end_of_phase()
    state = pickle.loads(pickle.dumps(learner.state_dict()))
    other = make_learner(name, CATEGORIES, seed=4)
    other.load_state_dict(state)
    for each in (learner, other):
        taught(each, 3, 4, start=6)
    frame, _ = drawn(30, 3)
    assert (learner.predict(frame) == other.predict(frame)).all()
    if hasattr(learner, "network"):
        weights = zip(learner.network.parameters(), other.network.parameters(), strict=True)
        assert all((a == b).all() for a, b in weights)


@pytest.mark.parametrize("name", ["naive", "replay", "shuffled"])
def test_equal_seeds_give_equal_learners(name):
    predictions = []
    for seed in (5, 5, 6):
        learner = taught(make_learner(name, CATEGORIES, seed=seed), 2, 8)
        predictions.append(next(iter(learner.network.parameters())).detach().numpy().copy())
    assert (predictions[0] == predictions[1]).all()
    assert (predictions[0] != predictions[2]).any()


def test_naive_forgets_and_replay_does_not():
    kept = {}
    for name in ("naive", "replay"):
        learner = taught(make_learner(name, CATEGORIES, seed=2), 1, 60)
        taught(learner, 2, 80, start=60)
        assert accuracy(learner, 2) > 0.8
        kept[name] = accuracy(learner, 1)
    assert kept["replay"] > 0.9
    assert kept["naive"] < 0.5


@pytest.mark.parametrize("name", ["ewc", "si", "lwf"])
def test_consolidation_slows_the_change_of_the_network(name):
    """The penalty keeps predictions of the old task nearer to what they were than fine-tuning does."""
    learners = {each: taught(make_learner(each, CATEGORIES, seed=2), 1, 40) for each in ("naive", name)}
    learners[name].end_of_phase()
    frame, _ = drawn(500, 1)
    from tiscene.learning.baselines.pixel_network import pictures

    before = {each: learner.network(pictures([frame.rgb])).detach() for each, learner in learners.items()}
    for each in learners.values():
        taught(each, 2, 40, start=40)
    after = {each: learner.network(pictures([frame.rgb])).detach() for each, learner in learners.items()}
    change = {each: (after[each].softmax(1) - before[each].softmax(1)).abs().mean().item() for each in learners}
    assert change[name] < change["naive"]
    assert learners[name].stored_bytes() > 0


def test_ewc_has_the_penalty_of_its_definition():
    import torch

    learner = taught(make_learner("ewc", CATEGORIES, seed=2), 1, 10)
    assert learner.penalty(None) == 0.0
    learner.end_of_phase()
    assert learner.penalty(None).item() == 0.0
    with torch.no_grad():
        for weights in learner.network.parameters():
            weights += 0.1
    expected = 0.5 * learner.strength * sum(0.01 * fisher.sum().item() for fisher in learner.fisher)
    assert learner.penalty(None).item() == pytest.approx(expected, rel=1e-3)
    assert expected > 0.0


def test_reservoir_keeps_each_picture_with_equal_probability():
    from tiscene.learning.baselines.pixel_network import LabeledPicture

    count = np.zeros(40)
    learner = make_learner("replay", CATEGORIES, capacity=10)
    for seed in range(300):
        learner.rng, learner.seen, learner.reservoir = np.random.default_rng(seed), 0, []
        for number in range(40):
            learner.keep([LabeledPicture(np.zeros((1, 1, 3), np.uint8), np.array([[0, 0, number]]))])
        for each in learner.reservoir:
            count[each.labels[0, 2]] += 1
    assert len(learner.reservoir) == 10
    assert abs(count - 75).max() < 4.5 * np.sqrt(300 * 0.25 * 0.75)


def test_late_labels_train_on_the_picture_that_they_are_of():
    late, prompt = (make_learner("naive", CATEGORIES, seed=1) for _ in range(2))
    (first, truth), (second, _) = drawn(0, 1), drawn(1, 2)
    labels = answers(first, truth)
    prompt.learn(first, labels)
    late.learn(first, [])
    late.learn(second, labels)
    assert all((a == b).all() for a, b in zip(late.network.parameters(), prompt.network.parameters(), strict=True))


@pytest.mark.parametrize("name", ["naive", "ncm"])
def test_labels_arrive_up_to_128_frames_late(name):
    """Both keep the pictures of as many frames, so that a delay is as hard for one as for the other."""
    frame, truth = drawn(0, 1)
    for late, learned in ((127, True), (128, False)):
        learner = make_learner(name, CATEGORIES, seed=1)
        known = learner.sums if name == "ncm" else learner.network.head.bias.detach().numpy()
        before = known.copy()
        for index in range(late):
            learner.learn(drawn(index, 1)[0], [])
        expected = pytest.warns(UserWarning, match="labels of frame 0 are not learned: only the last 128 pictures")
        with contextlib.nullcontext() if learned else expected:
            learner.learn(drawn(late, 2)[0], answers(frame, truth))
        assert (known != before).any() == learned


@pytest.mark.parametrize("name", ["blind"])
def test_blind_learner_repeats_labels_and_ignores_pictures(name):
    learner = make_learner(name, CATEGORIES)
    frame, truth = drawn(3, 1)
    assert not learner.predict(frame).any()
    learner.learn(frame, answers(frame, truth, count=40))
    other, _ = drawn(3, 2)
    assert (learner.predict(frame) == learner.predict(other)).all()
    assert (learner.predict(frame)[truth > 0] == 1).mean() > 0.8


def test_flow_learner_learns_features_without_labels():
    """Along flow, features become more alike than those of other pixels."""
    from tiscene.learning.baselines.pixel_network import pictures

    learner = make_learner("flow", CATEGORIES, seed=1)

    def coherence():
        (first, truth), (second, _) = drawn(4, 1), drawn(5, 1)
        features = learner.network.features(pictures([first.rgb, second.rgb])).detach().numpy()
        features /= np.linalg.norm(features, axis=1, keepdims=True) + 1e-9
        y, x = np.nonzero(truth)
        followed = (features[0][:, y, x] * features[1][:, y, x + 1]).sum(axis=0).mean()
        others = (features[0][:, y, x] * features[1][:, :1, :1].reshape(-1, 1)).sum(axis=0).mean()
        return followed - others

    before = coherence()
    head = learner.network.head.weight.detach().clone()
    for index in range(40):
        learner.learn(drawn(index, 1)[0], [])
    assert coherence() > before + 0.1
    assert (learner.network.head.weight == head).all()


def test_flow_learner_names_the_missing_buffer():
    learner = make_learner("flow", CATEGORIES)
    frame, _ = drawn(0, 1)
    blind = CourseFrame(0, 0.0, frame.camera, {"rgb": frame.rgb})
    with pytest.raises(ValueError, match="needs the buffer forward_flow"):
        learner.learn(blind, [])


@pytest.mark.parametrize("name", BASELINES)
def test_learner_names_the_extra_that_is_missing(name, monkeypatch):
    for module in [each for each in sys.modules if each.startswith("tiscene.learning.baselines.")]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, "torch", None)
    if name == "blind":
        make_learner(name, CATEGORIES)
        return
    with pytest.raises(MissingExtra, match=r"tiscene\[torch\]"):
        make_learner(name, CATEGORIES)
