# SPDX-License-Identifier: Apache-2.0
"""stream.torch() with PyTorch's loaders: every frame once, in order, with exact state."""

import itertools
import os
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tiscene.errors import ArgumentError
from tiscene.scenario.objects import Object
from tiscene.scenario.scenario import Scenario
from tiscene.stream.stream import Stream

torch = pytest.importorskip("torch")
stateful = pytest.importorskip("torchdata.stateful_dataloader")
pytestmark = pytest.mark.filterwarnings("ignore:'set_vital' is deprecated:UserWarning")  # of torchdata
DataLoader = torch.utils.data.DataLoader

SCENARIO = Scenario("solid_benchmark", [Object("ball", "Ball 01", (0, 1, -3), first_frame=1)])
SETTINGS = {"width": 16, "height": 12, "buffers": ("instance", "depth", "forward_occlusion")}


@pytest.fixture(scope="module")
def stream():
    return Stream(SCENARIO, frames=14, **SETTINGS)


def indices(loader):
    return [batch["index"].tolist() for batch in loader]


def test_samples_are_tensors_of_the_frame_and_batches_stack_them(stream):
    (batch,) = DataLoader(stream.torch(frames=range(3, 6)), batch_size=3)
    assert batch["index"].tolist() == [3, 4, 5]
    assert batch["time"].tolist() == [3 / 25, 4 / 25, 5 / 25]
    for row, index in enumerate((3, 4, 5)):
        for name, array in stream[index].items():
            tensor = batch[name][row]
            assert tensor.dtype == torch.from_numpy(array).dtype
            np.testing.assert_array_equal(tensor.numpy(), array)


def test_frames_go_from_the_position_to_the_end_in_every_epoch(stream):
    dataset = stream.seek(11).torch()
    stream.seek(0)
    assert len(dataset) == 3
    assert [indices(DataLoader(dataset, batch_size=2)) for _ in range(2)] == [[[11, 12], [13]]] * 2
    assert stream.position == 0


def test_endless_stream_has_no_length_and_goes_on():
    dataset = Stream("solid_benchmark", width=8, height=6, buffers=("depth",)).torch()
    with pytest.raises(TypeError, match="endless"):
        len(dataset)
    assert [sample["index"] for sample in itertools.islice(dataset, 5)] == [0, 1, 2, 3, 4]


def batches(items, size):
    return [items[start : start + size] for start in range(0, len(items), size)]


@pytest.mark.parametrize(("chunk", "workers", "world_size"), [(1, 1, 1), (1, 3, 2), (4, 2, 1), (3, 2, 2), (5, 1, 4)])
@pytest.mark.parametrize("drop_last", [False, True])
def test_workers_and_ranks_get_every_frame_once(stream, monkeypatch, chunk, workers, world_size, drop_last):
    from tiscene.stream.loaders import torch_stream

    class Worker:
        num_workers = workers

    by_rank = []
    for rank in range(world_size):
        dataset = stream.torch(
            transform=lambda frame: frame.index, chunk=chunk, rank=rank, world_size=world_size, drop_last=drop_last
        )
        shards = []
        for Worker.id in range(workers):
            monkeypatch.setattr(torch_stream, "get_worker_info", lambda: Worker)
            shards.append(list(dataset))
        by_rank.append(list(itertools.chain(*shards)))
        assert len(dataset) == len(by_rank[-1])
        turns = itertools.zip_longest(*(batches(each, chunk) for each in shards), fillvalue=[])
        order = list(itertools.chain(*itertools.chain(*turns)))  # as a DataLoader takes batches from its workers
        assert order == sorted(order)
    delivered = sorted(itertools.chain(*by_rank))
    if drop_last:
        assert len({len(each) for each in by_rank}) == 1
        assert delivered == list(range(14 - 14 % (chunk * world_size)))
    else:
        assert delivered == list(range(14))


def test_rank_is_that_of_torchrun_and_travels_to_workers(stream, monkeypatch):
    monkeypatch.setenv("RANK", "1")
    monkeypatch.setenv("WORLD_SIZE", "2")
    dataset = stream.torch(frames=range(5))
    assert [sample["index"] for sample in dataset] == [1, 3]
    assert len(dataset) == 2
    state = dataset.__getstate__()
    monkeypatch.delenv("RANK")
    monkeypatch.delenv("WORLD_SIZE")
    assert state["_ranks"] == (1, 2)


def test_rank_is_that_of_the_process_group(stream, tmp_path):
    torch.distributed.init_process_group("gloo", init_method=f"file://{tmp_path}/store", rank=0, world_size=1)
    try:
        assert stream.torch(frames=range(5)).ranks == (0, 1)
    finally:
        torch.distributed.destroy_process_group()


def test_objects_are_the_visible_ones_and_collate_keeps_them_apart():
    stream = Stream(Scenario("object_view", [Object("ball", "Sphere", (0, 1, -1.5), first_frame=1)]), **SETTINGS)
    dataset = stream.torch(frames=range(2), objects=True)
    (batch,) = DataLoader(dataset, batch_size=2, collate_fn=dataset.collate)
    assert batch["depth"].shape == (2, 12, 16)
    for index, objects in enumerate(batch["objects"]):
        rows = [row for row in stream[index].objects if row.visible_pixels]
        assert objects["id"].tolist() == [row.id for row in rows]
        assert objects["category_id"].tolist() == [row.category_id for row in rows]
        assert objects["box"].tolist() == [list(row.visible_box) for row in rows]
        np.testing.assert_allclose(
            objects["position"].reshape(-1), [x for row in rows for x in row.position], rtol=1e-6
        )
    assert len(batch["objects"][1]["id"]) == len(batch["objects"][0]["id"]) + 1


def test_several_cameras_are_views():
    stream = Stream("room_01", camera=("Main", "Chest"), width=8, height=6, buffers=("depth",), frames=2)
    dataset = stream.torch()
    (batch,) = DataLoader(dataset, batch_size=2, collate_fn=dataset.collate)
    assert set(batch["views"]) == {"Main", "Chest"}
    np.testing.assert_array_equal(batch["views"]["Chest"]["depth"][1], stream[1].views["Chest"].depth)
    assert torch.equal(batch["depth"], batch["views"]["Main"]["depth"])


def test_transform_makes_the_sample(stream):
    dataset = stream.torch(frames=range(4), transform=lambda frame: (frame.index, float(frame.depth.min())))
    (batch,) = DataLoader(dataset, batch_size=4, collate_fn=dataset.collate)
    assert batch[0].tolist() == [0, 1, 2, 3]


def test_stateful_loader_continues_after_the_last_batch(stream):
    def loader():
        return stateful.StatefulDataLoader(stream.torch(), batch_size=3)

    whole = indices(loader())
    first = loader()
    taken = [batch["index"].tolist() for batch in itertools.islice(first, 2)]
    state = pickle.loads(pickle.dumps(first.state_dict()))
    second = loader()
    second.load_state_dict(state)
    assert taken + indices(second) == whole == [[0, 1, 2], [3, 4, 5], [6, 7, 8], [9, 10, 11], [12, 13]]


def test_state_of_another_stream_or_sharding_is_refused(stream):
    iterator = iter(stream.torch())
    next(iterator)
    state = iterator.state_dict()
    with pytest.raises(ArgumentError, match="chunk: 1 there, 2 here"):
        iter(stream.torch(chunk=2)).load_state_dict(state)
    for damaged in ({"position": 3}, {"version": 1}, {"version": 1, "of": state["of"]}):
        with pytest.raises(ArgumentError, match="not a state"):
            iter(stream.torch()).load_state_dict(damaged)
    other = Stream(SCENARIO, frames=14, seed=1, **SETTINGS)
    with pytest.raises(ArgumentError, match=r"another data set \(seed: 0 there, 1 here\)"):  # and nothing else
        iter(other.torch()).load_state_dict(state)


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ({"frames": 5}, "frames=5"),
        ({"frames": range(10, 20)}, r"0\.\.13"),
        ({"chunk": 0}, "chunk=0"),
        ({"rank": 1}, "both or neither"),
        ({"rank": 2, "world_size": 2}, "rank=2"),
    ],
)
def test_invalid_arguments_are_refused(stream, arguments, match):
    with pytest.raises(ArgumentError, match=match):
        stream.torch(**arguments)


def test_copy_for_a_worker_process_delivers_the_same(stream):
    dataset = stream.torch(frames=range(2, 4))
    for sample, copied in zip(dataset, pickle.loads(pickle.dumps(dataset)), strict=True):
        assert sample["index"] == copied["index"]
        assert torch.equal(sample["depth"], copied["depth"])


@pytest.mark.slow
def test_worker_processes_deliver_in_order_and_resume(stream):
    """Two real workers: batches in the stream's order, and a state from the middle."""
    settings = {"batch_size": 2, "num_workers": 2, "multiprocessing_context": "spawn"}
    dataset = stream.torch(frames=range(9), chunk=2)
    first = stateful.StatefulDataLoader(dataset, **settings)
    batches = iter(first)
    taken = [next(batches) for _ in range(2)]
    state = first.state_dict()
    rest = [batch["index"].tolist() for batch in batches]
    assert [batch["index"].tolist() for batch in taken] + rest == [[0, 1], [2, 3], [4, 5], [6, 7], [8]]
    np.testing.assert_array_equal(taken[1]["depth"][1], stream[3].depth)
    second = stateful.StatefulDataLoader(dataset, **settings)
    second.load_state_dict(state)
    assert indices(second) == rest


RANK = """
import os, signal, sys
import torch
from torchdata.stateful_dataloader import StatefulDataLoader
import tiscene as ts

torch.distributed.init_process_group("gloo")
rank, folder, end = torch.distributed.get_rank(), sys.argv[1], int(sys.argv[2])
stream = ts.Stream("solid_benchmark", width=8, height=6, frames=24, buffers=("depth",))
loader = StatefulDataLoader(stream.torch(chunk=2), batch_size=2)
state = f"{folder}/state{rank}"
if os.path.exists(state):
    loader.load_state_dict(torch.load(state))
for batch in loader:
    torch.distributed.all_reduce(batch["depth"].isfinite().sum())
    with open(f"{folder}/{rank}", "a") as file:
        print(*batch["index"].tolist(), file=file)
    torch.save(loader.state_dict(), state)
    torch.distributed.barrier()
    if rank == 1 and batch["index"][0] > end:
        os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.slow
def test_ranks_of_torchrun_share_a_stream_and_continue_after_one_was_killed(tmp_path):
    program = tmp_path / "rank.py"
    program.write_text(RANK)
    command = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2", str(program)]
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[3])}
    for end, succeeds in (("9", False), ("99", True)):
        done = subprocess.run([*command, str(tmp_path), end], capture_output=True, text=True, env=environment)
        assert (done.returncode == 0) == succeeds, done.stderr
    batches = [(tmp_path / rank).read_text().split("\n")[:-1] for rank in "01"]
    for rank, rows in enumerate(batches):
        assert rows == [f"{first} {first + 1}" for first in range(2 * rank, 24, 4)]
