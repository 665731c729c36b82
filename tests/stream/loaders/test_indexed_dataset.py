# SPDX-License-Identifier: Apache-2.0
"""stream.dataset() with the map-style loaders of PyTorch and Grain."""

import numpy as np
import pytest

from tiscene.errors import ArgumentError
from tiscene.stream.stream import Stream

SETTINGS = {"width": 8, "height": 6, "buffers": ("instance", "depth")}


@pytest.fixture(scope="module")
def stream():
    return Stream("solid_benchmark", frames=10, **SETTINGS)


def test_samples_are_arrays_by_number(stream):
    dataset = stream.dataset(frames=range(2, 10, 3))
    assert len(dataset) == 3
    assert [dataset[number]["index"] for number in (0, 1, 2, -1)] == [2, 5, 8, 8]
    np.testing.assert_array_equal(dataset[1]["depth"], stream[5].depth)
    with pytest.raises(IndexError):
        dataset[3]


def test_endless_stream_needs_frames():
    endless = Stream("solid_benchmark", **SETTINGS)
    with pytest.raises(ArgumentError, match="endless"):
        endless.dataset()
    assert len(endless.dataset(frames=range(5))) == 5


def test_shuffled_loader_of_pytorch_delivers_each_frame_once(stream):
    torch = pytest.importorskip("torch")
    dataset = stream.dataset(objects=True)
    loader = torch.utils.data.DataLoader(dataset, batch_size=4, shuffle=True, collate_fn=dataset.collate)
    batches = list(loader)
    seen = [index for batch in batches for index in batch["index"].tolist()]
    assert sorted(seen) == list(range(10))
    for batch in batches:
        for index, depth, objects in zip(batch["index"], batch["depth"], batch["objects"], strict=True):
            np.testing.assert_array_equal(depth, stream[int(index)].depth)
            assert objects["id"].tolist() == [row.id for row in stream[int(index)].objects if row.visible_pixels]


def test_grain_shuffles_batches_and_continues_from_a_state(stream):
    grain = pytest.importorskip("grain")
    dataset = stream.dataset()
    assert isinstance(dataset, grain.sources.RandomAccessDataSource)
    pipeline = grain.MapDataset.source(dataset).shuffle(seed=3).batch(4).to_iter_dataset()
    whole = list(pipeline)
    assert sorted(np.concatenate([batch["index"] for batch in whole]).tolist()) == list(range(10))
    for batch in whole:
        for index, depth in zip(batch["index"], batch["depth"], strict=True):
            np.testing.assert_array_equal(depth, stream[int(index)].depth)
    iterator = iter(pipeline)
    next(iterator)
    state = iterator.get_state()
    again = iter(pipeline)
    again.set_state(state)
    assert [batch["index"].tolist() for batch in again] == [batch["index"].tolist() for batch in whole[1:]]


def test_grain_loader_checks_that_a_state_is_of_the_same_data(stream):
    grain = pytest.importorskip("grain")

    def loader(source):
        sampler = grain.samplers.IndexSampler(len(source), num_epochs=1)
        return grain.DataLoader(data_source=source, sampler=sampler, worker_count=0)

    iterator = iter(loader(stream.dataset()))
    next(iterator)
    state = iterator.get_state()
    stream.seek(4)
    again = iter(loader(stream.dataset(frames=range(10))))
    stream.seek(0)
    again.set_state(state)
    assert next(again)["index"] == 1
