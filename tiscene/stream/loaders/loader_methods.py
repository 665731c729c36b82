# SPDX-License-Identifier: Apache-2.0
"""LoaderMethods: the methods of Stream that make data sets for machine learning libraries."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from tiscene.errors import requires_extra
from tiscene.frame.frame import Frame
from tiscene.stream.loaders.frame_samples import FrameSamples
from tiscene.stream.loaders.indexed_dataset import IndexedDataset
from tiscene.stream.stream_interface import StreamInterface

if TYPE_CHECKING:
    from tiscene.stream.loaders.torch_stream import TorchStream


class LoaderMethods:
    """Data sets of a stream for PyTorch, Grain and Hugging Face."""

    def torch(
        self: StreamInterface,
        *,
        frames: range | None = None,
        objects: bool = False,
        transform: Callable[[Frame], Any] | None = None,
        chunk: int = 1,
        drop_last: bool = False,
        rank: int | None = None,
        world_size: int | None = None,
    ) -> TorchStream:
        """Return an IterableDataset of PyTorch whose samples are dicts of tensors. The stream's position stays.

        Workers and ranks share the frames without loss or double. `StatefulDataLoader` saves and restores its state.
        Worker processes need `multiprocessing_context="spawn"` or "forkserver", and do not see later edits.

        Args:
            frames: indices of the frames; None: from the stream's position to its end, if it has one.
            objects: whether samples have the visible objects; batches then need `collate_fn=dataset.collate`.
            transform: makes the sample of a frame, in the worker; None: `index`, `time` and each buffer by name.
            chunk: number of consecutive frames that a worker renders in its turn. With the batch size of the
                DataLoader, batches are in the stream's order.
            drop_last: leave out the last frames where ranks would get unequal numbers of them.
            rank: of this process among those that train together; None: of `torch.distributed`, or torchrun's.
            world_size: number of those processes; None: as `rank`.

        Raises:
            MissingExtra: PyTorch is not installed.
            ArgumentError: an argument is invalid.
        """
        with requires_extra("torch"):
            from tiscene.stream.loaders.torch_stream import TorchStream
        return TorchStream(
            self,
            frames,
            FrameSamples(objects, transform),
            chunk=chunk,
            drop_last=drop_last,
            rank=rank,
            world_size=world_size,
        )

    def dataset(
        self: StreamInterface,
        *,
        frames: range | None = None,
        objects: bool = False,
        transform: Callable[[Frame], Any] | None = None,
    ) -> IndexedDataset:
        """Return a map-style data set of samples as dicts of NumPy arrays, for PyTorch's DataLoader and for Grain.

        Args:
            frames: indices of the frames; None: from the stream's position to its end.
            objects: whether samples have the visible objects; batches then need `collate_fn=dataset.collate`.
            transform: makes the sample of a frame; None: `index`, `time` and each buffer by name.

        Raises:
            ArgumentError: the stream is endless and `frames` is None.
        """
        return IndexedDataset(self, frames, FrameSamples(objects, transform))

    def huggingface(
        self: StreamInterface,
        *,
        frames: range | None = None,
        objects: bool = False,
        transform: Callable[[Frame], dict[str, Any]] | None = None,
        shards: int = 1,
    ) -> Any:
        """Return an IterableDataset of Hugging Face's library `datasets`, with `state_dict` and shards.

        Args:
            frames: indices of the frames; None: from the stream's position to its end, if it has one.
            objects: whether samples have the visible objects.
            transform: makes the sample of a frame, a dict; None: `index`, `time` and each buffer by name.
            shards: number of shards for workers and nodes: a multiple of their number.

        Raises:
            MissingExtra: the library is not installed.
            ArgumentError: an argument is invalid.
        """
        with requires_extra("huggingface"):
            from tiscene.stream.loaders import hugging_face
        return hugging_face.iterable_dataset(self, frames, FrameSamples(objects, transform), shards)
