# SPDX-License-Identifier: Apache-2.0
"""TorchStream: a stream as an IterableDataset of PyTorch, shared by workers and ranks, with a state.

Ranks and workers take turns: rank by rank, then worker by worker, `chunk` frames each. No frame is lost or delivered
twice. With `chunk` equal to the batch size, the batches of a DataLoader are in the stream's order.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch.utils.data import IterableDataset, default_collate, get_worker_info

from dynamics import argument_checks
from tiscene.errors import ArgumentError
from tiscene.stream.loaders.frame_samples import FrameSamples, frame_range, is_endless
from tiscene.stream.saved_state import differences
from tiscene.stream.stream_interface import StreamInterface

STATE_VERSION = 1


class TorchStream(IterableDataset):  # type: ignore[misc]  # mypy does not read torch
    """Samples of the frames of a stream as tensors, for `torch.utils.data.DataLoader`.

    Args:
        stream: the source of frames.
        frames: indices of the frames; None: from the stream's position to its end, if it has one.
        samples: converts frames to samples.
        chunk: number of consecutive frames that a worker renders in its turn.
        drop_last: leave out the last frames where ranks would get unequal numbers of them.
        rank: of this process among those that train together; None: of `torch.distributed`, else RANK of torchrun.
        world_size: number of those processes; None: as `rank`.
    """

    def __init__(
        self,
        stream: StreamInterface,
        frames: range | None,
        samples: FrameSamples,
        *,
        chunk: int,
        drop_last: bool,
        rank: int | None,
        world_size: int | None,
    ) -> None:
        super().__init__()
        self.stream = stream
        self.frames = frame_range(frames, stream)
        self.samples = samples
        self.chunk = argument_checks.integer(chunk, "chunk", 1, 2**31)
        self.drop_last = bool(drop_last)
        if (rank is None) != (world_size is None):
            raise ArgumentError(f"rank={rank}, world_size={world_size}: pass both or neither")
        self._ranks: tuple[int, int] | None = None
        if rank is not None and world_size is not None:
            world_size = argument_checks.integer(world_size, "world_size", 1, 2**31)
            self._ranks = argument_checks.integer(rank, "rank", 0, world_size - 1), world_size

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "_ranks": self.ranks}  # torch.distributed does not run in workers

    @property
    def ranks(self) -> tuple[int, int]:
        """Rank of this process, and the number of ranks."""
        if self._ranks is not None:
            return self._ranks
        if torch.distributed.is_available() and torch.distributed.is_initialized():
            return torch.distributed.get_rank(), torch.distributed.get_world_size()
        return int(os.environ.get("RANK", 0)), int(os.environ.get("WORLD_SIZE", 1))

    def __len__(self) -> int:
        """Return the number of frames of this rank."""
        if is_endless(self.frames):
            raise TypeError("an endless stream has no length; make it with frames=N")
        rank, world_size = self.ranks
        return _share(self._usable(), self.chunk, rank, world_size)

    def _usable(self) -> int:
        """Return how many frames are delivered on all ranks together."""
        count = len(self.frames)
        return count - count % (self.ranks[1] * self.chunk) if self.drop_last else count

    def __iter__(self) -> TorchStreamIterator:
        rank, world_size = self.ranks
        worker = get_worker_info()
        worker_id, workers = (worker.id, worker.num_workers) if worker is not None else (0, 1)
        return TorchStreamIterator(self, worker_id * world_size + rank, world_size * workers)

    def collate(self, samples: Sequence[Any]) -> Any:
        """Join samples to a batch, as `collate_fn` of a DataLoader; see `torch_stream.collate`."""
        return collate(samples)


class TorchStreamIterator(Iterator[Any]):
    """The samples of one shard, with a state.

    `torchdata.stateful_dataloader.StatefulDataLoader` saves and restores it in each worker.

    Args:
        dataset: the data set.
        shard: which part of its frames this iterator delivers.
        shards: number of parts.
    """

    def __init__(self, dataset: TorchStream, shard: int, shards: int) -> None:
        self._dataset = dataset
        self._shard, self._shards = shard, shards
        self._frames = dataset.frames[: dataset._usable()]
        self._delivered = 0

    def __next__(self) -> Any:
        turn, place = divmod(self._delivered, self._dataset.chunk)
        number = (turn * self._shards + self._shard) * self._dataset.chunk + place
        if number >= len(self._frames):
            raise StopIteration
        frame = self._dataset.stream[self._frames[number]]
        self._delivered += 1
        return as_tensors(self._dataset.samples(frame))

    def state_dict(self) -> dict[str, Any]:
        """Return the position and what it belongs to, as JSON-ready values below 1 kB."""
        return {"version": STATE_VERSION, "delivered": self._delivered, "of": self._identity()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue where `state_dict` was taken.

        Raises:
            ArgumentError: the state is of another stream, other frames, or another number of workers or ranks.
        """
        is_state = isinstance(state, Mapping) and isinstance(state.get("of"), Mapping) and "delivered" in state
        if not is_state or state.get("version") != STATE_VERSION:
            raise ArgumentError(f"this is not a state of stream.torch() (version {STATE_VERSION})")
        if different := ", ".join(differences(state["of"], self._identity()).values()):
            raise ArgumentError(
                f"the state is of another data set ({different}). Make the stream and loader as they were."
            )
        self._delivered = state["delivered"]

    def _identity(self) -> dict[str, Any]:
        frames = self._dataset.frames
        return {
            "shard": self._shard,
            "shards": self._shards,
            "chunk": self._dataset.chunk,
            "frames": [frames.start, None if is_endless(frames) else frames.stop, frames.step],
            "settings": self._dataset.stream.settings(),
        }


def _share(count: int, chunk: int, rank: int, world_size: int) -> int:
    """Return how many of `count` frames one of `world_size` ranks gets, if they take turns with `chunk` frames each."""
    rounds, rest = divmod(count, chunk * world_size)
    return rounds * chunk + min(max(rest - rank * chunk, 0), chunk)


def as_tensors(sample: Any) -> Any:
    """Return a sample with tensors in place of NumPy arrays; they share memory. Other values stay as they are."""
    if isinstance(sample, np.ndarray):
        return torch.from_numpy(sample)
    if isinstance(sample, dict):
        return {name: as_tensors(value) for name, value in sample.items()}
    return sample


def collate(samples: Sequence[Any]) -> Any:
    """Join samples to a batch.

    Args:
        samples: samples of `stream.torch()` or `stream.dataset()`, or whatever their `transform` returns.

    Returns:
        For dicts: a dict of tensors with one more axis in front, and under `objects` a list with one entry a sample,
        since frames have different numbers of objects. For other samples: as `torch.utils.data.default_collate`.
    """
    if not isinstance(samples[0], dict):
        return default_collate(samples)
    nested = {"objects", "views"} & samples[0].keys()
    batch = default_collate([{name: value for name, value in each.items() if name not in nested} for each in samples])
    if "objects" in nested:
        batch["objects"] = [as_tensors(each["objects"]) for each in samples]
    if "views" in nested:
        batch["views"] = {name: collate([each["views"][name] for each in samples]) for name in samples[0]["views"]}
    return batch
