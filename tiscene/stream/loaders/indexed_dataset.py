# SPDX-License-Identifier: Apache-2.0
"""IndexedDataset: samples of frames by number, for map-style loaders of PyTorch and for Grain."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tiscene.errors import ArgumentError
from tiscene.stream.loaders.frame_samples import FrameSamples, frame_range, is_endless
from tiscene.stream.stream_interface import StreamInterface


class IndexedDataset:
    """Samples of frames as NumPy arrays, by number: a map-style data set.

    `torch.utils.data.DataLoader` and `grain.MapDataset.source` take it. It can be pickled, so that workers have a copy.

    Args:
        stream: the source of frames.
        frames: indices of the frames; None: from the stream's position to its end.
        samples: converts frames to samples.

    Raises:
        ArgumentError: the stream is endless and `frames` is None.
    """

    def __init__(self, stream: StreamInterface, frames: range | None, samples: FrameSamples) -> None:
        self.stream = stream
        self.frames = frame_range(frames, stream)
        self.samples = samples
        if is_endless(self.frames):
            raise ArgumentError("an endless stream has no length: pass frames=range(1000), or use stream.torch()")

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, number: int) -> Any:
        return self.samples(self.stream[self.frames[number]])

    def __repr__(self) -> str:
        # Grain compares it with that of a checkpoint, so it does not depend on the stream's position.
        return f"IndexedDataset({', '.join(self.stream.buffers)}; frames={self.frames})"

    def collate(self, samples: Sequence[Any]) -> Any:
        """Join samples to a batch of PyTorch tensors, as `collate_fn` of a DataLoader; see `torch_stream.collate`."""
        from tiscene.stream.loaders.torch_stream import collate

        return collate(samples)
