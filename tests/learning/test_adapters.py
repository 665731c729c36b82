# SPDX-License-Identifier: Apache-2.0
"""Courses in other libraries: Avalanche, river, UNaIVERSE, PyTorch, Grain. Each test uses the library itself."""

import pickle
import sys

import numpy as np
import pytest

from tests.learning.small_course import scenario
from tests.learning.test_accuracy_matrix import LEARNED, R
from tiscene.errors import ArgumentError, MissingExtra
from tiscene.learning.accuracy_matrix import backward_transfer, forward_transfer
from tiscene.learning.adapters.course_frames import CourseFrames
from tiscene.learning.adapters.labeled_patches import labeled_patches, patch_around, patches_of_tests
from tiscene.learning.adapters.river_pairs import color_features, river_pairs
from tiscene.learning.course import Course
from tiscene.learning.held_out_tests import counterfactuals
from tiscene.learning.phase import Phase
from tiscene.learning.supervision_rules import SupervisionRules
from tiscene.learning.teaching_policies import Combined, OnePixelPerMovingObject, RandomPixels
from tiscene.scenario.scenario import Scenario
from tiscene.usd.core.limits import Limits

TAUGHT = SupervisionRules(Combined([OnePixelPerMovingObject(), RandomPixels(1)]))


def make_course(rules=TAUGHT):
    scenarios = {"ball": scenario("Ball 01"), "cube": scenario("Cube")}
    phases = [Phase(name, each, frames=6, supervision=rules) for name, each in scenarios.items()]
    tests = [Phase(name, each, frames=3, start=7) for name, each in scenarios.items()]
    return Course(phases, tests=tests, width=32, height=24, spp=1, categories=("ball", "cube"))


@pytest.fixture(scope="module")
def course():
    return make_course()


@pytest.fixture(scope="module")
def patches(course):
    return list(labeled_patches(course, size=9))


def test_patches_are_the_labeled_pixels_in_order(course, patches):
    assert len(patches) == 2 * 6 * 2
    assert [each.frame for each in patches] == [k for k in range(12) for _ in range(2)]
    assert {each.category for each in patches} == {"", "ball", "cube"}
    for each in patches[::5]:
        frame = course[each.frame]
        assert (each.patch[4, 4] == frame.rgb[each.pixel]).all()
        assert each.category_id == frame.semantic[each.pixel]
        assert each.phase == course.phase_at(each.frame)[0]


def test_patch_is_black_beyond_the_edges():
    picture = np.full((5, 6, 3), 9, np.uint8)
    patch = patch_around(picture, (0, 5), 3)
    assert patch[..., 0].tolist() == [[0, 0, 0], [9, 9, 0], [9, 9, 0]]
    assert (color_features(np.full((5, 5, 3), 51, np.uint8))["red_5"]) == pytest.approx(0.2)


def test_delayed_labels_come_with_the_patches_of_their_frames(course, patches):
    late = list(labeled_patches(make_course(SupervisionRules(TAUGHT.policy, delay=2)), size=9))
    assert [each.arrives - each.frame for each in late] == [2] * len(late)
    by_pixel = {(each.frame, each.pixel): each for each in patches}
    for each in late:
        assert (each.patch == by_pixel[each.frame, each.pixel].patch).all()
    assert 0 < len(late) < len(patches)  # labels of the last frames never arrive


def test_patches_need_odd_sizes_colors_and_tests(course):
    for size, match in ((8, "size=8: must be an odd number"), (9.0, "size=9.0: must be a whole number")):
        with pytest.raises(ArgumentError, match=match):
            next(labeled_patches(course, size=size))
    blind = Course([Phase("a", scenario("Cube"), frames=1)], buffers=("instance",), observed=("instance",))
    with pytest.raises(ArgumentError, match="need the buffer rgb"):
        next(labeled_patches(blind))
    without = Course(course.phases, width=32, height=24)
    with pytest.raises(ArgumentError, match="has no tests"):
        next(patches_of_tests(without))


def test_river_scores_a_course_as_its_own_loop_does(course, patches):
    river = pytest.importorskip("river")
    from river import evaluate, metrics, neighbors

    assert river.__version__
    model = neighbors.KNNClassifier(n_neighbors=1)
    found = evaluate.progressive_val_score(river_pairs(course, size=9), model, metrics.Accuracy())
    expected, again = metrics.Accuracy(), neighbors.KNNClassifier(n_neighbors=1)
    for each in patches:
        features, name = color_features(each.patch), each.category or "background"
        predicted = again.predict_one(features)
        if predicted is not None:
            expected.update(name, predicted)
        again.learn_one(features, name)
    assert found.get() == pytest.approx(expected.get(), abs=0.05)
    assert found.get() > 0.5


def test_river_delays_labels_by_frames(course):
    pytest.importorskip("river")
    from river import base, evaluate, metrics

    class Recorder(base.Classifier):
        def __init__(self):
            self.order = []

        def predict_one(self, x):
            self.order.append(("predict", x["frame"]))

        def learn_one(self, x, y):
            self.order.append(("learn", x["frame"]))

    model = Recorder()
    pairs = river_pairs(course, size=9, frame=True)
    evaluate.progressive_val_score(pairs, model, metrics.Accuracy(), moment="frame", delay=2)
    first = model.order.index(("learn", 0))
    assert ("predict", 2) in model.order[: first + 3]
    assert ("predict", 3) not in model.order[:first]


@pytest.mark.filterwarnings("ignore")
def test_avalanche_trains_and_evaluates_on_a_course(course):
    pytest.importorskip("avalanche")
    import torch
    from avalanche.models import SimpleMLP
    from avalanche.training.supervised import LwF, Naive

    from tiscene.learning.adapters.avalanche_benchmark import avalanche_benchmark

    benchmark = pickle.loads(pickle.dumps(avalanche_benchmark(course, size=9)))  # as spawned workers get it
    assert [len(each.dataset) for each in benchmark.train_stream] == [12, 12]
    assert [sorted(set(each.dataset.targets)) for each in benchmark.train_stream] == [[0, 1], [0, 2]]
    assert [each.classes_seen_so_far for each in benchmark.train_stream] == [[0, 1], [0, 1, 2]]
    assert [each.task_labels for each in benchmark.train_stream] == [[0], [0]]
    assert len(benchmark.test_stream) == 2
    picture, target, *_ = benchmark.train_stream[0].dataset[0]
    first = next(labeled_patches(course, 9))
    assert np.allclose(picture.numpy().transpose(1, 2, 0), first.patch / 255.0)
    assert target == first.category_id
    torch.manual_seed(0)
    model = SimpleMLP(num_classes=3, input_size=3 * 9 * 9)
    strategy = Naive(model=model, optimizer=torch.optim.Adam(model.parameters()), train_mb_size=4, train_epochs=10)
    strategy.train(benchmark.train_stream[0], shuffle=False)
    results = strategy.eval(benchmark.test_stream)
    accuracy = [value for name, value in results.items() if name.startswith("Top1_Acc_Exp")]
    assert accuracy[0] > accuracy[1]  # it has learned the ball, not the cube
    distilling = LwF(  # reads task labels, as most strategies do that keep old outputs
        model=model,
        optimizer=torch.optim.Adam(model.parameters()),
        criterion=torch.nn.CrossEntropyLoss(),
        alpha=1.0,
        temperature=2.0,
    )
    for experience in benchmark.train_stream:
        distilling.train(experience)


@pytest.mark.filterwarnings("ignore")
def test_transfer_equals_avalanches():
    evaluation = pytest.importorskip("avalanche.evaluation.metrics")
    theirs, transfer = evaluation.BWT(), evaluation.ForwardTransfer()
    for test, phase in enumerate(LEARNED):
        theirs.update(test, float(R[phase, test]), initial=True)
        transfer.update(test, float(R[0, test]), initial=True)
    for test, phase in enumerate(LEARNED):
        if phase < len(R) - 1:
            theirs.update(test, float(R[-1, test]))
        if phase > 1:
            transfer.update(test, float(R[phase - 1, test]))
    assert backward_transfer(R, LEARNED) == pytest.approx(np.mean(list(theirs.result().values())))
    assert forward_transfer(R, LEARNED) == pytest.approx(np.mean(list(transfer.result().values())))


@pytest.mark.filterwarnings("ignore")
def test_avalanche_trains_a_head_for_each_task(course):
    pytest.importorskip("avalanche")
    import torch
    from avalanche.models import SimpleMLP, as_multitask
    from avalanche.training.supervised import Naive

    from tiscene.learning.adapters.avalanche_benchmark import avalanche_benchmark

    dark = counterfactuals(course.phases, {"illumination": [-0.5]}, frames=2)
    tested = Course(course.phases, tests=[*reversed(course.test_phases), *dark], **course.settings)
    benchmark = avalanche_benchmark(tested, size=9, task_labels=True)
    assert [each.task_labels for each in benchmark.train_stream] == [[0], [1]]
    assert [each.task_labels for each in benchmark.test_stream] == [[1], [0], [0], [1]]  # that of the phase
    torch.manual_seed(0)
    model = as_multitask(SimpleMLP(num_classes=3, input_size=3 * 9 * 9), "classifier")
    strategy = Naive(model=model, optimizer=torch.optim.Adam(model.parameters()), train_mb_size=4, train_epochs=10)
    for experience in benchmark.train_stream:
        strategy.train(experience)
    assert model.classifier.active_units == {0: [0, 1], 1: [0, 2]}
    results = strategy.eval(benchmark.test_stream)
    accuracy = [value for name, value in results.items() if name.startswith("Top1_Acc_Exp")]
    assert accuracy == [1.0] * 4  # neither task forgets the other


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    ("task_labels", "match"),
    [
        (False, "the policy chooses no pixels"),
        (True, "with task_labels=True, it needs the name of a phase that has labels: ball, cube"),
    ],
)
def test_avalanche_refuses_a_test_without_pixels_or_task(course, task_labels, match):
    """Left out, it would give its number to the next test."""
    pytest.importorskip("avalanche")
    from tiscene.learning.adapters.avalanche_benchmark import avalanche_benchmark

    still = Phase("still", Scenario("object_view"), frames=1)
    tests = Course(course.phases, tests=[still, *course.test_phases], **course.settings)
    with pytest.raises(ArgumentError, match=f"test 'still': {match}"):
        avalanche_benchmark(tests, size=9, task_labels=task_labels)


@pytest.mark.filterwarnings("ignore")
def test_unaiverse_streams_show_frames_and_labels_in_step(course):
    pytest.importorskip("unaiverse")
    from unaiverse.clock import clock
    from unaiverse.streams.streamproxy import StreamProxy

    from tiscene.learning.adapters.unaiverse_streams import UNLABELED, unaiverse_streams

    pictures, targets = unaiverse_streams(course)
    assert len(pictures) == len(targets) == 12
    stdin, stdtar = StreamProxy(), StreamProxy()
    stdin.bind({"agent:pictures": pictures})
    stdtar.bind({"agent:targets": targets})
    expected = list(labeled_patches(course, 9))
    for k in range(12):
        clock.next_cycle()
        (picture,), (target,) = stdin.get(requested_by="agent"), stdtar.get(requested_by="agent")
        assert (np.asarray(picture) == course[k].rgb).all()
        assert pictures.get_tag() == targets.get_tag() == k
        labels = targets.props.check_and_preprocess(target, targets=True)
        assert labels.shape == (1, 24, 32)
        found = {(int(y), int(x)): int(labels[0, y, x]) for _, y, x in (labels != UNLABELED).nonzero()}
        assert found == {each.pixel: each.category_id for each in expected if each.frame == k}
    clock.next_cycle()
    assert pictures[12, None] == (None, -1)


@pytest.mark.filterwarnings("ignore")
def test_unaiverse_streams_begin_anew_for_each_reader(course):
    pytest.importorskip("unaiverse")
    from tiscene.learning.adapters.unaiverse_streams import UNLABELED, unaiverse_streams

    _, targets = unaiverse_streams(make_course(SupervisionRules(RandomPixels(1), budget=2)))
    labeled = {who: [int((targets[k, who][0] != UNLABELED).sum()) for k in range(6)] for who in ("a", "b")}
    assert labeled["a"] == labeled["b"] == [1, 1, 0, 0, 0, 0]
    assert (targets[1, "a"][0] == targets[1, "b"][0]).all()
    with pytest.raises(ArgumentError, match="set delay=0"):
        unaiverse_streams(make_course(SupervisionRules(RandomPixels(1), delay=2)))


def test_unaiverse_streams_name_the_extra_that_is_missing(course, monkeypatch):
    from tiscene.learning.adapters.unaiverse_streams import unaiverse_streams

    monkeypatch.setitem(sys.modules, "unaiverse", None)
    monkeypatch.setitem(sys.modules, "unaiverse.streams", None)
    with pytest.raises(MissingExtra, match=r"tiscene\[unaiverse\]"):
        unaiverse_streams(course)


def phase_and_depth(frame):
    return {"phase": frame.phase, "depth": frame.depth}


def test_torch_loads_a_course_and_continues_from_a_state(course):
    pytest.importorskip("torch")
    from torch.utils.data import DataLoader

    frames = CourseFrames(course)
    batches = list(DataLoader(frames.torch(frames=range(4, 8), transform=phase_and_depth), batch_size=2))
    assert [each["phase"] for each in batches] == [["ball", "ball"], ["cube", "cube"]]
    assert (batches[1]["depth"][0].numpy() == course[6].depth).all()
    samples = iter(frames.torch(chunk=1))
    for _ in range(3):
        next(samples)
    resumed = iter(frames.torch(chunk=1))
    resumed.load_state_dict(samples.state_dict())
    assert next(resumed)["index"] == 3
    with pytest.raises(ArgumentError, match="of another data set"):
        iter(CourseFrames(make_course(SupervisionRules(RandomPixels(2)))).torch()).load_state_dict(samples.state_dict())


def test_course_frames_are_equal_in_a_worker(course):
    there = pickle.loads(pickle.dumps(CourseFrames(course))).dataset()
    assert len(there) == 12
    assert (there[7]["rgb"] == course[7].rgb).all()


def test_worker_keeps_the_device_and_limits_of_a_course_and_drops_its_progress_callback():
    limits = Limits(prims=1000)
    made = Course(make_course().phases, width=32, height=24, arch="cpu", limits=limits, progress=lambda *_: None)
    there = pickle.loads(pickle.dumps(CourseFrames(made))).course
    assert {name: there.settings.get(name) for name in ("arch", "limits", "progress")} == {
        "arch": "cpu",
        "limits": limits,
        "progress": None,
    }
    assert there.digest() == made.digest()


def test_grain_shuffles_a_course(course):
    grain = pytest.importorskip("grain")
    data = grain.MapDataset.source(CourseFrames(course).dataset(transform=phase_and_depth)).shuffle(seed=1)
    phases = [data[row]["phase"] for row in range(4)]
    assert set(phases) <= {"ball", "cube"}
