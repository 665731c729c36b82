# SPDX-License-Identifier: Apache-2.0
"""stream.huggingface() with the library `datasets`."""

import itertools
import pickle
import sys

import numpy as np
import pytest

from tiscene.errors import ArgumentError, ArgumentTypeError
from tiscene.stream.stream import Stream

datasets = pytest.importorskip("datasets")

SETTINGS = {"width": 8, "height": 6, "buffers": ("instance", "depth", "forward_occlusion", "coverage")}


@pytest.fixture(scope="module", autouse=True)
def offline(tmp_path_factory):
    datasets.config.HF_DATASETS_OFFLINE = True
    datasets.config.HF_DATASETS_CACHE = tmp_path_factory.mktemp("datasets")


@pytest.fixture(scope="module")
def stream():
    return Stream("solid_benchmark", frames=10, **SETTINGS)


def test_examples_are_frames_with_typed_columns(stream):
    dataset = stream.huggingface()
    assert isinstance(dataset, datasets.IterableDataset)
    assert dataset.features["depth"] == datasets.Array2D((6, 8), "float32")
    assert dataset.features["coverage"].shape == (6, 8, 6, 2)
    examples = list(dataset)
    assert [example["index"] for example in examples] == list(range(10))
    for name, array in stream[4].items():
        np.testing.assert_array_equal(examples[4][name], array)


def test_format_of_pytorch_gives_tensors(stream):
    torch = pytest.importorskip("torch")
    example = next(iter(stream.huggingface(frames=range(3, 5)).with_format("torch")))
    assert example["depth"].dtype == torch.float32
    np.testing.assert_array_equal(example["depth"], stream[3].depth)


def test_state_continues_without_rendering_frames_twice(stream, monkeypatch):
    dataset = stream.huggingface(shards=2)
    taken = [example["index"] for example in itertools.islice(dataset, 6)]
    iterator = iter(dataset)
    for _ in range(6):
        next(iterator)
    state = pickle.loads(pickle.dumps(dataset.state_dict()))
    again = stream.huggingface(shards=2)
    again.load_state_dict(state)
    rendered = []
    render = Stream.__getitem__
    monkeypatch.setattr(Stream, "__getitem__", lambda self, index: rendered.append(index) or render(self, index))
    assert taken + [example["index"] for example in again] == list(range(10))
    assert rendered == [6, 7, 8, 9]


@pytest.mark.parametrize("frames", [range(10), range(9, -1, -1), range(1, 10, 2)])
def test_nodes_and_shards_get_every_frame_once(stream, frames):
    from datasets.distributed import split_dataset_by_node

    dataset = stream.huggingface(frames=frames, shards=4)
    assert dataset.num_shards == 4
    parts = [split_dataset_by_node(dataset, rank, 2) for rank in range(2)]
    seen = [[example["index"] for example in part] for part in parts]
    assert sorted(itertools.chain(*seen)) == sorted(frames)
    assert all(seen)
    assert [example["index"] for example in dataset] == list(frames)


def test_shards_of_an_endless_stream_take_turns():
    dataset = Stream("solid_benchmark", width=8, height=6, buffers=("depth",)).huggingface(shards=2)
    second = dataset.shard(2, 1)
    assert [example["index"] for example in itertools.islice(second, 3)] == [1, 3, 5]


def test_shards_of_an_endless_range_keep_its_step():
    stream = Stream("solid_benchmark", width=8, height=6, buffers=("depth",))
    second = stream.huggingface(frames=range(0, sys.maxsize, 10), shards=2).shard(2, 1)
    assert [example["index"] for example in itertools.islice(second, 3)] == [10, 30, 50]


def test_transform_and_objects_reach_the_examples(stream):
    dataset = stream.huggingface(frames=range(2), transform=lambda frame: {"nearest": float(frame.depth.min())})
    assert list(dataset) == [{"nearest": float(stream[index].depth.min())} for index in range(2)]
    (example,) = stream.huggingface(frames=range(1), objects=True)
    assert example["objects"]["id"].tolist() == [row.id for row in stream[0].objects if row.visible_pixels]


def test_transform_that_returns_no_columns_is_named(stream):
    with pytest.raises(ArgumentTypeError, match="transform returned int: must return a dict of columns"):
        next(iter(stream.huggingface(transform=lambda frame: frame.index)))


@pytest.mark.parametrize("shards", [0, 11])
def test_invalid_shards_are_refused(stream, shards):
    with pytest.raises(ArgumentError, match="shards"):
        stream.huggingface(shards=shards)
