# SPDX-License-Identifier: Apache-2.0
"""A stream as an IterableDataset of Hugging Face's library `datasets`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import datasets

from dynamics import argument_checks
from tiscene.errors import ArgumentError, ArgumentTypeError, counted
from tiscene.frame.buffers import BUFFERS
from tiscene.stream.loaders.frame_samples import FrameSamples, Sample, frame_range, is_endless
from tiscene.stream.stream_interface import StreamInterface

_ARRAYS = {2: datasets.Array2D, 3: datasets.Array3D, 4: datasets.Array4D}


def iterable_dataset(stream: StreamInterface, frames: range | None, samples: FrameSamples, shards: int) -> Any:
    """Return a `datasets.IterableDataset`.

    Its state_dict is a position among indices, so that continuing renders no frame twice.

    Args:
        stream: the source of frames.
        frames: indices of the frames; None: from the stream's position to its end, if it has one.
        samples: converts frames to samples.
        shards: number of shards for workers and nodes. Shards of a finite stream are consecutive frames; in those of
            an endless stream, frames take turns.

    Raises:
        ArgumentError: invalid `frames` or `shards`.
    """
    indices = frame_range(frames, stream)
    shards = argument_checks.integer(shards, "shards", 1, 2**31)
    if not is_endless(indices) and shards > len(indices):
        raise ArgumentError(f"shards={shards}: the stream has {counted(len(indices), 'frame')}")
    # Objects vary in number, views in name, and other samples are the user's: the library then finds the types itself.
    is_plain = samples.transform is None and not samples.objects and len(stream.scenario.cameras) == 1
    features = _features(stream) if is_plain else None
    indexed = datasets.IterableDataset.from_generator(_indices, gen_kwargs={"shards": _blocks(indices, shards)})
    return indexed.map(_Render(stream, samples), features=features, remove_columns=["index"])


def _blocks(indices: range, shards: int) -> list[tuple[int, int, int]]:
    """Return the start, stop and step of each shard."""
    if is_endless(indices):
        parts = [indices[shard::shards] for shard in range(shards)]
    else:
        count = len(indices)
        parts = [indices[count * shard // shards : count * (shard + 1) // shards] for shard in range(shards)]
    return [(part.start, part.stop, part.step) for part in parts]


def _indices(shards: list[tuple[int, int, int]]) -> Iterator[dict[str, int]]:
    for block in shards:
        for index in range(*block):
            yield {"index": index}


class _Render:
    """Maps an index to a sample."""

    def __init__(self, stream: StreamInterface, samples: FrameSamples) -> None:
        self._stream, self._samples = stream, samples

    def __call__(self, example: dict[str, int]) -> Sample:
        sample: Sample = self._samples(self._stream[example["index"]])
        if not isinstance(sample, dict):
            raise ArgumentTypeError(f"transform returned {type(sample).__name__}: must return a dict of columns")
        return sample


def _features(stream: StreamInterface) -> Any:
    """Return the types of the columns."""
    columns: dict[str, Any] = {"index": datasets.Value("int64"), "time": datasets.Value("float64")}
    for name in stream.buffers:
        buffer = BUFFERS[name]
        shape = buffer.shape(stream.width, stream.height)
        columns[name] = _ARRAYS[len(shape)](shape, buffer.dtype)
    return datasets.Features(columns)
